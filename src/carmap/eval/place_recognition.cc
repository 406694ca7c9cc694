#include "carmap/eval/place_recognition.h"

#include <algorithm>
#include <cstdint>

#include "carmap/index/word_index.h"

namespace carmap {
namespace {

/// After a cut in the images a keyframe is not similar to its predecessor.
constexpr float kLeastToPrevious = 0.05f;

bool AreNear(const Rigid3& a, const Rigid3& b, double distance_m, double angle_rad) {
  return (a.translation - b.translation).norm() <= distance_m &&
         a.rotation.angularDistance(b.rotation) <= angle_rad;
}

KeyframeId IdOf(size_t place_idx) { return {{}, static_cast<uint32_t>(place_idx)}; }

std::vector<double> PathLengths(const std::vector<ViewedPlace>& places) {
  std::vector<double> path_m(places.size(), 0);
  for (size_t i = 1; i < places.size(); ++i) {
    const auto& here = places[i].world_from_camera.translation;
    path_m[i] = path_m[i - 1] + (here - places[i - 1].world_from_camera.translation).norm();
  }
  return path_m;
}

/// The best candidate of a keyframe.
struct FirstCandidate {
  double relative_similarity = 0;
  bool is_same_place = false, is_revisit = false;
};

size_t CountWithoutError(const std::vector<FirstCandidate>& firsts) {
  double best_wrong = 0;
  for (const FirstCandidate& first : firsts) {
    if (!first.is_same_place) best_wrong = std::max(best_wrong, first.relative_similarity);
  }
  return static_cast<size_t>(std::count_if(firsts.begin(), firsts.end(), [&](const auto& first) {
    return first.is_revisit && first.is_same_place && first.relative_similarity > best_wrong;
  }));
}

}  // namespace

PlaceRecognition EvaluatePlaceRecognition(const std::vector<ViewedPlace>& places, size_t word_count,
                                          const PlaceRecognitionOptions& options) {
  const std::vector<double> path_m = PathLengths(places);
  const auto same_place = [&](size_t a, size_t b) {
    return AreNear(places[a].world_from_camera, places[b].world_from_camera, options.same_place_m,
                   options.same_place_rad);
  };
  PlaceRecognition result{.keyframes = places.size()};
  std::vector<FirstCandidate> firsts;
  WordIndex index(word_count);
  size_t known = 0;  // places in the index: the first ones
  for (size_t i = 1; i < places.size(); ++i) {
    for (; path_m[known] < path_m[i] - options.recent_m; ++known) {
      index.Add(IdOf(known), places[known].histogram);
    }
    const bool is_revisit =
        std::any_of(places.begin(), places.begin() + static_cast<ptrdiff_t>(known),
                    [&](const ViewedPlace& place) {
                      return AreNear(place.world_from_camera, places[i].world_from_camera,
                                     options.revisit_m, options.revisit_rad);
                    });
    result.revisits += is_revisit;
    const auto found =
        index.FindSimilar(places[i].histogram, {.max_count = PlaceRecognition::kRanks.back()});
    if (found.empty()) continue;
    const auto right = std::find_if(found.begin(), found.end(), [&](const SimilarKeyframe& other) {
      return same_place(i, other.id.index);
    });
    for (size_t rank = 0; is_revisit && rank < PlaceRecognition::kRanks.size(); ++rank) {
      const auto before = static_cast<size_t>(right - found.begin());
      result.found_among[rank] += right != found.end() && before < PlaceRecognition::kRanks[rank];
    }
    const float to_previous = Similarity(places[i].histogram, places[i - 1].histogram);
    firsts.push_back({found.front().similarity / std::max(to_previous, kLeastToPrevious),
                      right == found.begin(), is_revisit});
  }
  result.found_without_error = CountWithoutError(firsts);
  return result;
}

}  // namespace carmap
