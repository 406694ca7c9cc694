// Semantic segmentation by a network (§3.3): any ONNX file whose output is a score for each of some
// Cityscapes classes, run on the processor by OpenCV.
//
// A network is run on as many threads as OpenCV may use (cv::setNumThreads). A file is as trusted
// as a program: what is truncated or not a network is refused, but OpenCV's reader was not made for
// files that mean harm.
#pragma once

#include <absl/status/statusor.h>

#include <filesystem>
#include <memory>
#include <opencv2/core/types.hpp>
#include <string_view>

#include "carmap/semantics/network_description.h"
#include "carmap/semantics/segmenter.h"

namespace carmap {

/// Loads NETWORK.onnx, as the NETWORK.json beside it describes, or the network that a NETWORK.json
/// names (docs/segmenter_networks.md), and runs it once on a blank `image`, the size of the
/// camera's images. It silences OpenCV's own log: the errors say it in one line.
///
/// Errors, each naming file, cause and remedy: those of ReadNetworkDescription; a network that is
/// missing, not ONNX, truncated, or of layers that OpenCV does not know; that has another input
/// than described, several outputs, or one that is not 1 x classes x rows x columns. Segment fails
/// where the network fails or a score is not a finite number.
absl::StatusOr<std::unique_ptr<Segmenter>> LoadOnnxSegmenter(const std::filesystem::path& path,
                                                             cv::Size image);

/// The same with the bytes of the ONNX file, which `description.network` names in errors.
absl::StatusOr<std::unique_ptr<Segmenter>> MakeOnnxSegmenter(std::string_view bytes,
                                                             NetworkDescription description,
                                                             cv::Size image);

}  // namespace carmap
