// The segmentation network that comes with the program: for simulated worlds (docs/segmenter.md).
#pragma once

#include <absl/status/statusor.h>

#include <memory>
#include <opencv2/core/types.hpp>

#include "carmap/semantics/segmenter.h"

namespace carmap {

/// Errors: InvalidArgument for an `image` size that no network can be run on.
absl::StatusOr<std::unique_ptr<Segmenter>> MakeDefaultSegmenter(cv::Size image);

}  // namespace carmap
