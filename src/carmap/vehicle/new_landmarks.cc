#include "carmap/vehicle/new_landmarks.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "carmap/index/kd_tree.h"

namespace carmap {
namespace {

double DistanceM(const LeanMap& map, const LeanLandmark& landmark) {
  return (landmark.position_in_map - map.keyframes[landmark.anchor_idx].map_from_camera.translation)
      .norm();
}

/// The drive's landmarks by whether the base has them.
class Recognition {
 public:
  Recognition(const LeanMap& drive, const std::vector<SameLandmark>& seen_again,
              const NewLandmarkOptions& options)
      : options_(options) {
    std::set<LandmarkId> known;
    for (const SameLandmark& same : seen_again) known.insert(same.in_drive);
    std::vector<Eigen::Vector3d> places;
    for (const LeanLandmark& landmark : drive.landmarks) {
      places.push_back(landmark.position_in_map);
      is_known_.push_back(known.contains(landmark.id));
    }
    tree_ = KdTree(std::move(places));
    known_share_ = static_cast<double>(known.size()) / static_cast<double>(is_known_.size());
  }

  bool IsKnown(uint32_t idx) const { return is_known_[idx]; }

  /// Of the likelihoods that what stands there is new and that it is known, the log of the ratio,
  /// of whatever is taken for one thing.
  double LogRatio(const Eigen::Vector3d& place) const {
    const double share = std::max(ShareAround(place), options_.false_share);
    const double if_known = std::log(options_.false_share / share);
    const double if_unknown = std::log((1 - options_.false_share) / (1 - share));
    const size_t most =
        *std::max_element(options_.thing_landmarks.begin(), options_.thing_landmarks.end());
    double sum = 0, best = 0;
    size_t count = 0;
    for (const uint32_t idx : tree_.WithinRadius(place, options_.thing_m, most)) {
      sum += is_known_[idx] ? if_known : if_unknown;
      ++count;
      const auto& sizes = options_.thing_landmarks;
      if (std::find(sizes.begin(), sizes.end(), count) != sizes.end()) best = std::max(best, sum);
    }
    return best;
  }

 private:
  /// Of what stands around the place, the share that the drive recognises.
  double ShareAround(const Eigen::Vector3d& place) const {
    constexpr size_t kEnough = 1024;
    const auto around = tree_.WithinRadius(place, options_.light_m, kEnough);
    const auto known =
        std::count_if(around.begin(), around.end(), [&](uint32_t i) { return is_known_[i]; });
    return (static_cast<double>(known) + options_.light_prior * known_share_) /
           (static_cast<double>(around.size()) + options_.light_prior);
  }

  const NewLandmarkOptions& options_;
  std::vector<bool> is_known_;
  double known_share_ = 0;
  KdTree tree_;
};

/// Whether a landmark of the base that the drive saw lies where this one does.
bool IsInBase(const ReconstructedMap& base, const Eigen::Vector3d& place, double radius_m,
              const std::function<bool(LandmarkId)>& is_seen) {
  const auto near = base.landmark_positions().WithinRadius(place, radius_m);
  return std::any_of(near.begin(), near.end(),
                     [&](uint32_t idx) { return is_seen(base.snapshot.landmarks[idx].id); });
}

}  // namespace

std::vector<uint32_t> NewLandmarks(const ReconstructedMap& base, const LeanMap& drive,
                                   const std::vector<SameLandmark>& seen_again,
                                   const std::function<bool(LandmarkId)>& is_seen,
                                   const NewLandmarkOptions& options) {
  if (drive.landmarks.empty()) return {};
  const Recognition recognition(drive, seen_again, options);
  std::vector<std::pair<double, uint32_t>> likely;
  for (uint32_t i = 0; i < drive.landmarks.size(); ++i) {
    const LeanLandmark& landmark = drive.landmarks[i];
    const double distance_m = DistanceM(drive, landmark);
    if (recognition.IsKnown(i) || distance_m > options.max_distance_m) continue;
    const double log_ratio = recognition.LogRatio(landmark.position_in_map);
    if (log_ratio < options.min_log_ratio ||
        IsInBase(base, landmark.position_in_map, options.same_m + options.same_ratio * distance_m,
                 is_seen)) {
      continue;
    }
    likely.emplace_back(-log_ratio, i);
  }
  std::sort(likely.begin(), likely.end());
  likely.resize(std::min(
      likely.size(),
      static_cast<size_t>(options.max_share * static_cast<double>(drive.landmarks.size()))));
  std::vector<uint32_t> news;
  for (const auto& [_, i] : likely) news.push_back(i);
  std::sort(news.begin(), news.end());
  return news;
}

}  // namespace carmap
