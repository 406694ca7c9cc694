// The segmenter that a user names on the command line.
#pragma once

#include <absl/status/statusor.h>

#include <filesystem>
#include <memory>
#include <opencv2/core/types.hpp>
#include <string>

#include "carmap/semantics/segmenter.h"

namespace carmap {

/// `choice` is "none" (null is returned), "default" (the program's own), "labels" (those in the
/// folder `drive`), a folder of labels, or a network NETWORK.onnx or NETWORK.json. `image` is the
/// size of the camera's images. Errors: those of OpenLabelFolder and LoadOnnxSegmenter;
/// InvalidArgument for anything else.
absl::StatusOr<std::shared_ptr<Segmenter>> MakeSegmenter(const std::string& choice,
                                                         const std::filesystem::path& drive,
                                                         cv::Size image);

}  // namespace carmap
