// What a segmentation network takes and gives: the JSON file beside it, checked when it is read.
//
// docs/segmenter_networks.md has the format. Plain values.
#pragma once

#include <absl/status/statusor.h>

#include <filesystem>
#include <opencv2/core/types.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "carmap/semantics/mobility.h"

namespace carmap {

struct NetworkDescription {
  std::filesystem::path network;    ///< the ONNX file
  std::string input_name;           ///< empty: the only one
  std::vector<double> mean, scale;  ///< by channel: the network takes (grey level - mean) * scale
  cv::Size fixed_size;              ///< empty: takes any size in multiples
  int multiple_of = 1, max_width = 0;  ///< pixels, without a fixed size
  std::vector<Mobility> of_class;      ///< by channel of the output

  int channels() const { return static_cast<int>(mean.size()); }
};

/// Reads NETWORK.json, or that beside NETWORK.onnx. Its network need not exist.
/// Errors, each naming file, cause and remedy: as ReadFile; anything but an object with the fields
/// of the format, of their types and within their bounds; classes that are unknown or of one
/// mobility only.
absl::StatusOr<NetworkDescription> ReadNetworkDescription(const std::filesystem::path& path);

/// The same of the text of a JSON file, which `json_path` names in errors.
absl::StatusOr<NetworkDescription> ParseNetworkDescription(std::string_view text,
                                                           const std::filesystem::path& json_path);

/// The size to which an image is brought for the network, whatever its proportions.
cv::Size NetworkInputSize(const NetworkDescription& description, cv::Size image);

}  // namespace carmap
