// To a fraction of a pixel, where in one image lies what surrounds a pixel of another.
//
// Pure function; every processor rounds alike, so all find the same.
#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <optional>

namespace carmap {

constexpr int kAlignmentRadius = 5;  ///< pixels around the middle of a patch, 11 x 11 in all
/// Columns right of the middle that are read, as rows are in whole vectors, though not all count.
constexpr int kAlignmentRightPx = 11;

/// Whether AlignPatch may be called for a patch around the pixel (x, y).
bool CanAlign(const cv::Mat& image, int x, int y);

/// Place in `right` whose surroundings look most like those of the pixel (x, y) of `left`, looked
/// for from `start` on by Gauss-Newton on both axes (Lucas and Kanade 1981); the images may differ
/// in brightness. Nothing if it leaves the image, or lies farther than `max_offset_px` above or
/// below `y`.
/// Both images: CV_8UC1. CanAlign(left, x, y).
std::optional<Eigen::Vector2d> AlignPatch(const cv::Mat& left, int x, int y, const cv::Mat& right,
                                          const Eigen::Vector2d& start, double max_offset_px);

}  // namespace carmap
