// How well a segmenter tells static from non-static, against labels that are true (figure 17).
//
// Plain values; not thread-safe.
#pragma once

#include <array>
#include <cstddef>
#include <nlohmann/json_fwd.hpp>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "carmap/semantics/mobility.h"

namespace carmap {

/// How often what is truly so was told to be so. What is truly unknown is not counted.
class MobilityConfusion {
 public:
  void Add(Mobility truth, Mobility told, size_t count = 1);

  size_t count(Mobility truth, Mobility told) const {
    return counts_[static_cast<size_t>(truth)][static_cast<size_t>(told)];
  }
  size_t count(Mobility truth) const;

  // Shares from 0 to 1, NaN where there is nothing to divide by. Where nothing is told it is wrong.
  /// Of all that is told rightly.
  double Accuracy() const;
  /// Of what is truly `truth`, told to be `told`.
  double Share(Mobility truth, Mobility told) const;
  /// What is truly and told to be so, of what is one or the other (intersection over union).
  double Iou(Mobility mobility) const;

 private:
  std::array<std::array<size_t, 3>, 3> counts_{};  ///< by truth, by what was told
};

/// `told` brought to the size of an image: that of the pixel over the centre of each of the
/// image's.
cv::Mat AtImageSize(const cv::Mat& told, cv::Size image);

struct SegmentationScore {
  MobilityConfusion pixels, features;
  std::vector<double> frame_ms;  ///< one a frame, for the segmenter alone

  /// Mobility of each pixel, CV_8UC1; both of one size.
  void TakePixels(const cv::Mat& truth, const cv::Mat& told);
  void TakeFeatures(const std::vector<Mobility>& truth, const std::vector<Mobility>& told);
};

/// {frames pixels{accuracy static_iou non_static_iou} features{static non_static accuracy
/// non_static_found static_called_non_static} frame_ms{median mean p95 p99 max}
/// frames_per_second}; features' `static` and `non_static` are counts, the others shares; null
/// where there is nothing to divide by.
nlohmann::ordered_json ToJson(const SegmentationScore& score);

struct NamedSegmentationScore {
  std::string name;
  SegmentationScore score;
};
/// A table for a person to read, ending with a new line.
std::string ToText(const std::vector<NamedSegmentationScore>& scores);

}  // namespace carmap
