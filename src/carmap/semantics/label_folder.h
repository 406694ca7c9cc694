// Labels that a drive brings along: the truth of a simulated one, or what another program made.
//
//   labels/000000.png   8-bit grey PNG of the left image: SemanticClass of each pixel, by frame
//   number
#pragma once

#include <absl/status/statusor.h>

#include <filesystem>
#include <memory>
#include <opencv2/core/types.hpp>

#include "carmap/semantics/segmenter.h"

namespace carmap {

/// A segmenter that reads `folder`. A frame without a file is unlabelled: all of it is kUnknown.
/// Errors: NotFound (no folder); InvalidArgument (no label in it; the first one is not as below).
/// Segment: InvalidArgument (labels not of the size `image` of the camera's images, not 8-bit grey,
/// or a value that is no class), and those of ReadIndexImage.
absl::StatusOr<std::unique_ptr<Segmenter>> OpenLabelFolder(const std::filesystem::path& folder,
                                                           cv::Size image);

}  // namespace carmap
