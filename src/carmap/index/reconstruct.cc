#include "carmap/index/reconstruct.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <span>
#include <utility>

namespace carmap {
namespace {

/// Levels by which a feature rises when the focal length grows: it becomes larger in the image.
double LevelShift(double from_focal_length_px, double to_focal_length_px) {
  return std::log(to_focal_length_px / from_focal_length_px) / std::log(kLevelScale);
}

MapSnapshot MakeSnapshot(const LeanMap& map, double focal_length_px) {
  MapSnapshot snapshot;
  snapshot.keyframes.reserve(map.keyframes.size());
  for (const LeanKeyframe& keyframe : map.keyframes) {
    snapshot.keyframes.push_back(
        {keyframe.id, keyframe.timestamp, keyframe.map_from_camera, keyframe.gps, {}});
  }
  snapshot.landmarks.reserve(map.landmarks.size());
  std::vector<Eigen::Vector3d> viewers_in_map;
  for (uint32_t i = 0; i < map.landmarks.size(); ++i) {
    const LeanLandmark& lean = map.landmarks[i];
    viewers_in_map.clear();
    for (const uint32_t keyframe_idx : lean.keyframe_idxs) {
      viewers_in_map.push_back(map.keyframes[keyframe_idx].map_from_camera.translation);
      snapshot.keyframes[keyframe_idx].landmark_idxs.push_back(i);
    }
    SnapshotLandmark& landmark = snapshot.landmarks.emplace_back();
    landmark.id = lean.id;
    landmark.position_in_map = lean.position_in_map;
    landmark.descriptor = lean.descriptor;
    landmark.drive_count = lean.drive_count;
    const LeanKeyframe& anchor = map.keyframes[lean.anchor_idx];
    DeriveVisibility(viewers_in_map, anchor.map_from_camera.translation, lean.anchor_level,
                     landmark);
    const double seen_with_px = FindDrive(map.drives, anchor.id.drive)->rig.camera.fx;
    if (seen_with_px != focal_length_px) {
      landmark.level_at_1m += static_cast<float>(LevelShift(seen_with_px, focal_length_px));
    }
  }
  return snapshot;
}

Grouped<uint32_t> MakeKeyframesOfLandmark(const MapSnapshot& snapshot) {
  std::vector<size_t> begin(snapshot.landmarks.size() + 1, 0);
  for (const SnapshotKeyframe& keyframe : snapshot.keyframes) {
    for (const uint32_t landmark_idx : keyframe.landmark_idxs) ++begin[landmark_idx + 1];
  }
  std::partial_sum(begin.begin(), begin.end(), begin.begin());
  std::vector<uint32_t> viewers(begin.back());
  std::vector<size_t> next = begin;
  for (uint32_t i = 0; i < snapshot.keyframes.size(); ++i) {
    for (const uint32_t landmark_idx : snapshot.keyframes[i].landmark_idxs) {
      viewers[next[landmark_idx]++] = i;
    }
  }
  Grouped<uint32_t> keyframes_of_landmark;
  keyframes_of_landmark.ReserveValues(viewers.size());
  for (size_t i = 0; i < snapshot.landmarks.size(); ++i) {
    for (size_t k = begin[i]; k < begin[i + 1]; ++k) keyframes_of_landmark.Append(viewers[k]);
    keyframes_of_landmark.EndList();
  }
  return keyframes_of_landmark;
}

/// The part of a list that lies around one of its places.
std::span<const uint32_t> NeighboursInList(std::span<const uint32_t> list, size_t place) {
  const size_t begin = place - std::min(place, kMaxListNeighbours);
  return list.subspan(begin, std::min(place + kMaxListNeighbours + 1, list.size()) - begin);
}

bool SharesMore(const CovisibleKeyframe& a, const CovisibleKeyframe& b) {
  return std::pair(b.shared_landmarks, a.keyframe_idx) <
         std::pair(a.shared_landmarks, b.keyframe_idx);
}

Grouped<CovisibleKeyframe> MakeCovisibility(const MapSnapshot& snapshot,
                                            const Grouped<uint32_t>& keyframes_of_landmark) {
  Grouped<CovisibleKeyframe> covisible;
  std::vector<uint32_t> shared(snapshot.keyframes.size(), 0), touched;
  std::vector<uint32_t> place_in_list(snapshot.landmarks.size(), 0);  // of keyframe i
  std::vector<CovisibleKeyframe> neighbours;
  for (uint32_t i = 0; i < snapshot.keyframes.size(); ++i) {
    for (const uint32_t landmark_idx : snapshot.keyframes[i].landmark_idxs) {
      for (const uint32_t other :
           NeighboursInList(keyframes_of_landmark[landmark_idx], place_in_list[landmark_idx]++)) {
        if (shared[other]++ == 0) touched.push_back(other);
      }
    }
    neighbours.clear();
    for (const uint32_t other : touched) {
      if (other != i) neighbours.push_back({other, shared[other]});
      shared[other] = 0;
    }
    touched.clear();
    const size_t kept = std::min(neighbours.size(), kMaxCovisible);
    std::partial_sort(neighbours.begin(), neighbours.begin() + static_cast<ptrdiff_t>(kept),
                      neighbours.end(), SharesMore);
    neighbours.resize(kept);
    for (const CovisibleKeyframe& neighbour : neighbours) covisible.Append(neighbour);
    covisible.EndList();
  }
  return covisible;
}

KdTree TreeOfCenters(const std::vector<SnapshotKeyframe>& keyframes) {
  std::vector<Eigen::Vector3d> points;
  points.reserve(keyframes.size());
  for (const SnapshotKeyframe& keyframe : keyframes) {
    points.push_back(keyframe.map_from_camera.translation);
  }
  return KdTree(std::move(points));
}

KdTree TreeOfPositions(const std::vector<SnapshotLandmark>& landmarks) {
  std::vector<Eigen::Vector3d> points;
  points.reserve(landmarks.size());
  for (const SnapshotLandmark& landmark : landmarks) points.push_back(landmark.position_in_map);
  return KdTree(std::move(points));
}

}  // namespace

std::optional<GpsIndex> GpsIndex::Build(const std::vector<LeanKeyframe>& keyframes) {
  const auto first = std::find_if(keyframes.begin(), keyframes.end(),
                                  [](const LeanKeyframe& keyframe) { return keyframe.gps; });
  if (first == keyframes.end()) return std::nullopt;
  GpsIndex index(*first->gps);
  std::vector<Eigen::Vector3d> places;
  for (size_t begin = 0; begin < keyframes.size();) {
    size_t end = begin + 1;
    while (end < keyframes.size() && keyframes[end].id.drive == keyframes[begin].id.drive) ++end;
    index.PlaceDrive(keyframes, begin, end, places);
    begin = end;
  }
  index.tree_ = KdTree(std::move(places));
  return index;
}

void GpsIndex::PlaceDrive(const std::vector<LeanKeyframe>& keyframes, size_t begin, size_t end,
                          std::vector<Eigen::Vector3d>& places) {
  const auto add = [&](size_t keyframe_idx, const Eigen::Vector3d& place) {
    placed_.push_back(static_cast<uint32_t>(keyframe_idx));
    places.push_back(place);
  };
  const auto step_m = [&](size_t i) {
    return (keyframes[i].map_from_camera.translation - keyframes[i - 1].map_from_camera.translation)
        .norm();
  };

  std::optional<size_t> before;  // the last keyframe that had a fix
  for (size_t i = begin; i < end; ++i) {
    if (!keyframes[i].gps) continue;
    const Eigen::Vector3d place = OnPlane(*keyframes[i].gps);
    if (before) {
      const Eigen::Vector3d place_before = OnPlane(*keyframes[*before].gps);
      double total_m = 0, driven_m = 0;
      for (size_t j = *before + 1; j <= i; ++j) total_m += step_m(j);
      for (size_t j = *before + 1; j < i; ++j) {
        driven_m += step_m(j);
        const double fraction = total_m > 0 ? driven_m / total_m : 0;
        add(j, place_before + fraction * (place - place_before));
      }
    } else {
      for (size_t j = begin; j < i; ++j) unplaced_.push_back(static_cast<uint32_t>(j));
    }
    add(i, place);
    before = i;
  }
  for (size_t j = before ? *before + 1 : begin; j < end; ++j) {
    unplaced_.push_back(static_cast<uint32_t>(j));
  }
}

Eigen::Vector3d GpsIndex::OnPlane(const GpsFix& fix) const {
  Eigen::Vector3d p_in_enu = enu_.FromGps(fix);
  p_in_enu.z() = 0;
  return p_in_enu;
}

std::vector<uint32_t> GpsIndex::KeyframesNear(const GpsFix& fix, double radius_m,
                                              size_t max_count) const {
  std::vector<uint32_t> keyframe_idxs = tree_.WithinRadius(OnPlane(fix), radius_m, max_count);
  for (uint32_t& idx : keyframe_idxs) idx = placed_[idx];
  return keyframe_idxs;
}

ReconstructedMap Reconstruct(const LeanMap& map, std::optional<double> focal_length_px) {
  if (!focal_length_px && !map.drives.empty()) focal_length_px = map.drives.front().rig.camera.fx;
  ReconstructedMap result =
      IndexSnapshot(MakeSnapshot(map, focal_length_px.value_or(0)), focal_length_px.value_or(0));
  result.drives = map.drives;
  result.gps = GpsIndex::Build(map.keyframes);
  return result;
}

ReconstructedMap IndexSnapshot(MapSnapshot snapshot, double focal_length_px) {
  ReconstructedMap result;
  result.snapshot = std::move(snapshot);
  result.focal_length_px = focal_length_px;
  result.keyframes_of_landmark = MakeKeyframesOfLandmark(result.snapshot);
  result.keyframe_centers = TreeOfCenters(result.snapshot.keyframes);
  return result;
}

const Grouped<CovisibleKeyframe>& ReconstructedMap::covisible() const {
  return covisible_.Get([&] { return MakeCovisibility(snapshot, keyframes_of_landmark); });
}

const KdTree& ReconstructedMap::landmark_positions() const {
  return landmark_positions_.Get([&] { return TreeOfPositions(snapshot.landmarks); });
}

const StereoRig& RigOf(const ReconstructedMap& map, uint32_t keyframe_idx) {
  return FindDrive(map.drives, map.snapshot.keyframes[keyframe_idx].id.drive)->rig;
}

Feature FeatureOf(const ReconstructedMap& map, const SnapshotLandmark& landmark,
                  const StereoRig& rig, const Eigen::Vector3d& p_in_camera) {
  const Eigen::Vector3d uvd = rig.Project(p_in_camera);
  const double bias_px = rig.disparity_bias.At((uvd.x() - rig.camera.cx) / rig.camera.fx);
  const double level =
      PredictLevel(landmark, p_in_camera.norm()) + LevelShift(map.focal_length_px, rig.camera.fx);
  return {.x_px = static_cast<float>(uvd.x()),
          .y_px = static_cast<float>(uvd.y()),
          .disparity_px = static_cast<float>(uvd.z() + bias_px),
          .level = static_cast<uint8_t>(std::clamp<long>(std::lround(level), 0, kLevelCount - 1)),
          .descriptor = landmark.descriptor};
}

}  // namespace carmap
