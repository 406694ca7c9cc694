// A picture of a map from above: landmarks as dots, paths as lines, a grid in metres.
//
// The view is the camera's of the map's frame, from above: x to the right, z (forward) up. Pure
// functions.
#pragma once

#include <absl/status/status.h>

#include <Eigen/Core>
#include <filesystem>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "carmap/eval/canvas.h"

namespace carmap {

struct PicturePath {
  std::string name;  ///< for the legend, which leaves out what has none; ASCII
  Rgb colour;
  std::vector<Eigen::Vector3d> positions_in_map;
  bool as_dots = false;  ///< a dot at each position (keyframes) rather than a line
};

struct MapPicture {
  std::string title;  ///< ASCII
  std::vector<Eigen::Vector3d> landmarks_in_map;
  std::vector<PicturePath> paths;  ///< later ones are drawn over earlier ones
};

/// 8-bit BGR, at least 1000 px wide. Shows the paths and the landmarks up to 40 m around their
/// bounding box, whatever lies outside (without paths: around the middle 90 % of the landmarks).
/// Positions that are not finite are not drawn.
cv::Mat RenderMapPicture(const MapPicture& picture);

/// As PNG. Errors: as WriteFileAtomically.
absl::Status WriteMapPicture(const std::filesystem::path& path, const MapPicture& picture);

}  // namespace carmap
