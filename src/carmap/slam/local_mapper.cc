#include "carmap/slam/local_mapper.h"

#include <absl/container/btree_map.h>

#include <algorithm>
#include <iterator>
#include <numeric>

#include "carmap/base/stopwatch.h"
#include "carmap/localize/landmark_matcher.h"
#include "carmap/slam/link_matches.h"
#include "carmap/slam/map_bundle.h"

namespace carmap {
namespace {

constexpr double kFuseRadiusPx = 3;

std::vector<KeyframeId> Without(std::vector<KeyframeId> ids, KeyframeId id) {
  std::erase(ids, id);
  return ids;
}

bool Contains(const std::vector<KeyframeId>& ids, KeyframeId id) {
  return std::find(ids.begin(), ids.end(), id) != ids.end();
}

std::vector<KeyframeId> Union(const std::vector<KeyframeId>& a, const std::vector<KeyframeId>& b) {
  std::vector<KeyframeId> both;
  std::set_union(a.begin(), a.end(), b.begin(), b.end(), std::back_inserter(both));
  return both;
}

Descriptor MedoidDescriptor(const Map& map, const Landmark& landmark) {
  std::vector<Descriptor> seen;
  for (const Observation& observation : landmark.observations) {
    seen.push_back(
        (*map.Find(observation.keyframe_id)->features)[observation.feature_idx].descriptor);
  }
  const auto total_distance = [&](const Descriptor& descriptor) {
    return std::accumulate(seen.begin(), seen.end(), 0, [&](int sum, const Descriptor& other) {
      return sum + HammingDistance(descriptor, other);
    });
  };
  return *std::min_element(seen.begin(), seen.end(), [&](const Descriptor& a, const Descriptor& b) {
    return total_distance(a) < total_distance(b);
  });
}

}  // namespace

std::shared_ptr<const LocalMap> LocalMapper::Insert(const NewKeyframe& new_keyframe) {
  const KeyframeId id = new_keyframe.keyframe.id;
  const auto run = [this](const char* step, auto&& make_edit) {
    const Stopwatch watch;
    const MapEdit edit = make_edit();
    ApplyStep(step, edit, watch.ElapsedMs());
  };
  TakeLabels(new_keyframe.labelled);
  if (new_keyframe.begins_part) {
    run("join", [&] { return LeavePart(); });
    open_part_ = OpenPart{id, new_keyframe.gap};
  }
  run("insert", [&] { return InsertKeyframe(new_keyframe); });
  std::vector<KeyframeId> window = WindowAround(map_, id, options_.window);
  std::optional<KeyframeId> joined_at;
  run("join", [&] { return JoinPart(id, joined_at); });
  if (joined_at) window = Union(window, WindowAround(map_, *joined_at, options_.window));
  run("find_known", [&] { return FindKnownLandmarks(id, window); });
  run("create", [&] { return CreateLandmarks(id); });
  run("find_in_neighbours", [&] { return FindInNeighbours(id, window); });
  run("refresh_descriptors", [&] { return RefreshDescriptors(id); });
  run("cull", [&] { return CullLandmarks(); });
  window = WindowAround(map_, id, options_.window);
  run("adjust", [&] { return AdjustWindow(window); });
  run("cull", [&] { return CullKeyframes(id, window); });
  return MapAround(id);
}

std::shared_ptr<const LocalMap> LocalMapper::MapAround(KeyframeId id) const {
  return std::make_shared<const LocalMap>(
      LocalMap{SnapshotOf(map_, WindowAround(map_, id, options_.window)), id, rig_});
}

std::optional<LocatedFrame> LocalMapper::Locate(const std::vector<Feature>& features,
                                                const Rigid3& predicted_map_from_camera) {
  const FeatureGrid grid(features, rig_.camera.width, rig_.camera.height);
  const std::vector<KeyframeId> all = KeyframesBefore(std::nullopt);
  auto found = FindNear(map_, all, grid, rig_, predicted_map_from_camera, options_.recovery);
  if (!found) found = FindAnywhere(map_, all, grid, rig_, options_.recovery);
  if (!found) return std::nullopt;
  LocatedFrame located{std::make_shared<const LocalMap>(
                           LocalMap{std::move(found->snapshot), found->keyframe_id, rig_}),
                       std::move(found->pose)};
  if (open_part_ && found->keyframe_id < open_part_->first) {
    const Stopwatch watch;
    const MapEdit edit = LeavePart();
    ApplyStep("join", edit, watch.ElapsedMs());
  }
  return located;
}

std::optional<Rigid3> LocalMapper::PoseOf(KeyframeId id) const {
  Rigid3 anchor_from_camera;
  for (auto anchor = anchors_.find(id); anchor != anchors_.end(); anchor = anchors_.find(id)) {
    anchor_from_camera = anchor->second.anchor_from_camera * anchor_from_camera;
    id = anchor->second.keyframe_id;
  }
  const Keyframe* keyframe = map_.Find(id);
  if (!keyframe) return std::nullopt;
  return keyframe->map_from_camera * anchor_from_camera;
}

void LocalMapper::EraseShortParts() {
  const std::vector<std::vector<KeyframeId>> parts = ConnectedParts(map_);
  const auto by_size = [](const auto& a, const auto& b) { return a.size() < b.size(); };
  const auto largest = std::max_element(parts.begin(), parts.end(), by_size);
  MapEdit edit{.base_version = map_.version()};
  for (auto part = parts.begin(); part != parts.end(); ++part) {
    if (part == largest || part->size() >= options_.min_part_keyframes) continue;
    edit.removed_keyframes.insert(edit.removed_keyframes.end(), part->begin(), part->end());
  }
  ApplyStep("cull", edit, 0);
}

void LocalMapper::TakeLabels(const std::vector<LabelledKeyframe>& labelled) {
  if (labelled.empty()) return;
  MapEdit edit{.base_version = map_.version()};
  for (const auto& [id, of_feature] : labelled) {
    edit.labelled_keyframes.push_back(
        {id, std::make_shared<const std::vector<Mobility>>(of_feature)});
  }
  ApplyStep("label", edit, 0);
}

void LocalMapper::Apply(const char* step, const MapEdit& edit) {
  const size_t left_out = carmap::Apply(edit, map_).value();  // none is of a version to come
  if (left_out > 0) left_out_[step] += left_out;
}

void LocalMapper::ApplyStep(const char* step, const MapEdit& edit, double elapsed_ms) {
  const Stopwatch watch;
  Apply(step, edit);
  step_ms_[step] += elapsed_ms + watch.ElapsedMs();
}

std::vector<KeyframeId> LocalMapper::KeyframesBefore(std::optional<KeyframeId> end) const {
  std::vector<KeyframeId> ids;
  for (const auto& [id, keyframe] : map_.keyframes()) {
    if (end && !(id < *end)) break;
    ids.push_back(id);
  }
  return ids;
}

/// Looks for the newest keyframe of an open part in the map before it. Until it is found, the part
/// lies where the speeds before and after the gap put it.
MapEdit LocalMapper::JoinPart(KeyframeId newest, std::optional<KeyframeId>& joined_at) {
  MapEdit nothing{.base_version = map_.version()};
  if (!open_part_ || newest == open_part_->first) return nothing;
  const Keyframe& keyframe = *map_.Find(newest);
  const FeatureGrid grid(*keyframe.features, rig_.camera.width, rig_.camera.height);
  const auto found = FindNear(map_, KeyframesBefore(open_part_->first), grid, rig_,
                              keyframe.map_from_camera, options_.recovery);
  const KeyframeId first = open_part_->first;
  const Gap gap = open_part_->gap;
  const size_t keyframes = open_part_->keyframes++;
  if (found || keyframes == options_.join_attempts) open_part_.reset();
  if (found) {
    joined_at = found->keyframe_id;
    return MovePart(map_, first,
                    (keyframe.map_from_camera * found->pose.camera_from_map).Inverse());
  }
  const auto map_from_reference = PoseOf(gap.reference);
  if (keyframes > 1 || !map_from_reference) return nothing;
  const Keyframe& first_keyframe = *map_.Find(first);
  const Rigid3 bridged = BridgeGap(
      gap, *map_from_reference, keyframe.map_from_camera.Inverse() * first_keyframe.map_from_camera,
      keyframe.timestamp.seconds() - first_keyframe.timestamp.seconds());
  return MovePart(map_, first, bridged * first_keyframe.map_from_camera.Inverse());
}

/// Gives up an open part, and its keyframes if they are too few to be of use.
MapEdit LocalMapper::LeavePart() {
  MapEdit edit{.base_version = map_.version()};
  if (open_part_ && open_part_->keyframes < options_.min_part_keyframes) {
    for (auto k = map_.keyframes().lower_bound(open_part_->first); k != map_.keyframes().end(); ++k)
      edit.removed_keyframes.push_back(k->first);
  }
  open_part_.reset();
  return edit;
}

MapEdit LocalMapper::InsertKeyframe(const NewKeyframe& new_keyframe) const {
  MapEdit edit{.base_version = map_.version()};
  edit.added_keyframes.push_back(new_keyframe.keyframe);
  for (const auto& [landmark_id, feature_idx] : new_keyframe.landmark_of_feature) {
    edit.added_observations.push_back(
        {landmark_id, {new_keyframe.keyframe.id, static_cast<int32_t>(feature_idx)}});
  }
  return edit;
}

/// Landmarks of the neighbourhood that tracking missed in the new keyframe.
MapEdit LocalMapper::FindKnownLandmarks(KeyframeId newest,
                                        const std::vector<KeyframeId>& window) const {
  MapEdit edit{.base_version = map_.version()};
  const Keyframe& keyframe = *map_.Find(newest);
  const MapSnapshot snapshot = SnapshotOf(map_, Without(window, newest));
  const auto unseen = SelectLandmarks(snapshot, [&](LandmarkId id) {
    return map_.Find(id)->observations.back().keyframe_id != newest;
  });
  const FeatureGrid grid(*keyframe.features, rig_.camera.width, rig_.camera.height);
  LinkMatches(map_, snapshot, newest,
              MatchByProjection(snapshot, unseen, grid, rig_, keyframe.map_from_camera.Inverse(),
                                {.radius_px = kFuseRadiusPx}),
              edit);
  return edit;
}

/// Corners with depth that belong to no landmark become one, by their finest feature with depth.
MapEdit LocalMapper::CreateLandmarks(KeyframeId newest) {
  MapEdit edit{.base_version = map_.version()};
  const Keyframe& keyframe = *map_.Find(newest);
  const std::vector<Feature>& features = *keyframe.features;
  auto of_corner = LandmarksOfCorners(map_, newest);
  std::vector<LandmarkId> created;
  for (uint32_t i = 0; i < features.size(); ++i) {
    const Feature& feature = features[i];
    auto& landmark_of_corner = of_corner[CornerOf(features, i)];
    if (landmark_of_corner || !feature.has_disparity() ||
        rig_.WithoutBias(feature.x_px, feature.disparity_px) < options_.min_new_disparity_px) {
      continue;
    }
    const LandmarkId id{drive_id_, next_landmark_index_++};
    landmark_of_corner = id;
    edit.added_landmarks.push_back({.id = id,
                                    .position_in_map = Triangulate(keyframe, feature),
                                    .descriptor = feature.descriptor,
                                    .observations = {{newest, static_cast<int32_t>(i)}}});
    created.push_back(id);
  }
  on_trial_.push_back(std::move(created));
  return edit;
}

/// The new landmarks in the keyframes before: they too saw most of them.
MapEdit LocalMapper::FindInNeighbours(KeyframeId newest,
                                      const std::vector<KeyframeId>& window) const {
  MapEdit edit{.base_version = map_.version()};
  const MapSnapshot snapshot = SnapshotOf(map_, {newest});
  const auto fresh = SelectLandmarks(
      snapshot, [&](LandmarkId id) { return map_.Find(id)->observations.size() == 1; });
  for (const KeyframeId& id : Without(window, newest)) {
    const Keyframe& keyframe = *map_.Find(id);
    const FeatureGrid grid(*keyframe.features, rig_.camera.width, rig_.camera.height);
    LinkMatches(map_, snapshot, id,
                MatchByProjection(snapshot, fresh, grid, rig_, keyframe.map_from_camera.Inverse(),
                                  {.radius_px = kFuseRadiusPx}),
                edit);
  }
  return edit;
}

/// The signature of a landmark becomes that of its observations which differs least from the
/// others.
MapEdit LocalMapper::RefreshDescriptors(KeyframeId newest) const {
  MapEdit edit{.base_version = map_.version()};
  for (const auto& link : map_.LandmarksOf(newest)) {
    if (link)
      edit.changed_descriptors.push_back({*link, MedoidDescriptor(map_, *map_.Find(*link))});
  }
  return edit;
}

/// Landmarks that did not prove themselves within their trial (§2: transient features are
/// filtered).
MapEdit LocalMapper::CullLandmarks() {
  MapEdit edit{.base_version = map_.version()};
  if (on_trial_.size() <= options_.trial_keyframes) return edit;
  for (const LandmarkId& id : on_trial_.front()) {
    const Landmark* landmark = map_.Find(id);
    if (landmark && landmark->observations.size() < options_.min_trial_observations) {
      edit.removed_landmarks.push_back(id);
    }
  }
  on_trial_.pop_front();
  return edit;
}

/// Keyframes that left the window and show nothing that others do not.
MapEdit LocalMapper::CullKeyframes(KeyframeId newest, const std::vector<KeyframeId>& window) {
  MapEdit edit{.base_version = map_.version()};
  std::vector<KeyframeId> candidates;
  for (const auto& [id, shared] :
       CovisibleKeyframes(map_, newest, options_.window.min_shared_landmarks)) {
    if (id == map_.keyframes().begin()->first) continue;
    if (!std::binary_search(window.begin(), window.end(), id)) candidates.push_back(id);
  }
  edit.removed_keyframes = RedundantKeyframes(map_, candidates, options_.culling);
  for (const KeyframeId& id : edit.removed_keyframes) {
    for (const auto& [other, shared] : CovisibleKeyframes(map_, id, 1)) {
      if (Contains(edit.removed_keyframes, other)) continue;
      anchors_[id] = {other,
                      map_.Find(other)->map_from_camera.Inverse() * map_.Find(id)->map_from_camera};
      break;
    }
  }
  return edit;
}

Eigen::Vector3d LocalMapper::Triangulate(const Keyframe& keyframe, const Feature& feature) const {
  return keyframe.map_from_camera *
         rig_.Triangulate({feature.x_px, feature.y_px},
                          rig_.WithoutBias(feature.x_px, feature.disparity_px));
}

MapEdit LocalMapper::AdjustWindow(const std::vector<KeyframeId>& window) {
  MapBundle problem =
      MakeMapBundle(map_, rig_, options_.noise, window, SharedLandmarks(map_, window));
  const BundleOptions bundle_options = OptionsFor(window.size());
  if (bundle_options.estimate_disparity_bias) ++bias_adjustments_;
  const BundleSummary summary = AdjustBundle(problem.bundle, bundle_options);
  rig_ = problem.bundle.rig;
  MapEdit edit = EditOf(problem, summary);
  MoveLoneLandmarks(edit);
  return edit;
}

BundleOptions LocalMapper::OptionsFor(size_t window_keyframes) const {
  const BiasOptions& bias = options_.bias;
  BundleOptions bundle = options_.bundle;
  bundle.estimate_disparity_bias = window_keyframes >= bias.min_keyframes;
  if (!bundle.estimate_disparity_bias) return bundle;
  const double settled = static_cast<double>(bias_adjustments_) / bias.settling_adjustments;
  bundle.bias_step_sigma_px = bias.step_sigma_rad * rig_.camera.fx / (1 + settled);
  bundle.max_bias_px = bias.max_rad * rig_.camera.fx;
  return bundle;
}

/// Landmarks that only one keyframe saw move with it.
void LocalMapper::MoveLoneLandmarks(MapEdit& edit) const {
  for (const auto& [id, map_from_camera] : edit.moved_keyframes) {
    Keyframe keyframe = *map_.Find(id);
    keyframe.map_from_camera = map_from_camera;
    for (const auto& link : map_.LandmarksOf(id)) {
      if (!link || map_.Find(*link)->observations.size() > 1) continue;
      const Feature& feature =
          (*keyframe.features)[map_.Find(*link)->observations.front().feature_idx];
      if (feature.disparity_px < options_.min_new_disparity_px) continue;
      edit.moved_landmarks.push_back({*link, Triangulate(keyframe, feature)});
    }
  }
}

}  // namespace carmap
