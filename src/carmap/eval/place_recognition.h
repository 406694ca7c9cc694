// How well a vocabulary recognizes places: for each keyframe of a drive with ground truth, whether
// the keyframes from where the road was driven before come first among those that it resembles.
//
// What is measured is only which candidates words propose, not what geometry makes of them.
// Pure functions, thread-safe.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "carmap/geometry/rigid3.h"
#include "carmap/index/word_histogram.h"

namespace carmap {

struct PlaceRecognitionOptions {
  double recent_m = 50;  ///< keyframes so far back along the path are not looked for
  double revisit_m = 4;  ///< a keyframe so near, and turned so little, makes a revisit …
  double revisit_rad = 0.5;
  double same_place_m = 10;  ///< … and one so near is the same place when it is found
  double same_place_rad = 0.8;
};

/// A keyframe: what it shows, and its true pose.
struct ViewedPlace {
  WordHistogram histogram;
  Rigid3 world_from_camera;
};

struct PlaceRecognition {
  static constexpr std::array<size_t, 4> kRanks = {1, 5, 10, 20};

  size_t keyframes = 0;
  size_t revisits = 0;  ///< keyframes whose place was driven through before
  /// Revisits for which one of the first kRanks[i] candidates is the same place.
  std::array<size_t, 4> found_among{};
  /// Revisits whose first candidate is the same place and more similar, relative to the keyframe's
  /// own predecessor, than any first candidate that is another place.
  size_t found_without_error = 0;
};

/// `places` in the order of the drive; `word_count` is the vocabulary's.
PlaceRecognition EvaluatePlaceRecognition(const std::vector<ViewedPlace>& places, size_t word_count,
                                          const PlaceRecognitionOptions& options = {});

}  // namespace carmap
