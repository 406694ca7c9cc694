#include "carmap/vehicle/diff_publisher.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <utility>

#include "carmap/base/status_macros.h"
#include "carmap/localize/frame_tracking.h"

namespace carmap {
namespace {

/// Keyframes of the road before a part that are looked at too: some of its landmarks were seen
/// there first.
constexpr double kLookBackM = 12;

double StepM(const LeanKeyframe& a, const LeanKeyframe& b) {
  return (b.map_from_camera.translation - a.map_from_camera.translation).norm();
}

double LengthM(const LeanMap& map, size_t begin) {
  double length_m = 0;
  for (size_t i = std::max<size_t>(begin, 1); i < map.keyframes.size(); ++i) {
    length_m += StepM(map.keyframes[i - 1], map.keyframes[i]);
  }
  return length_m;
}

/// The keyframe so far before another one, along the drive.
KeyframeId KeyframeBefore(const Map& map, KeyframeId id, double distance_m) {
  auto keyframe = map.keyframes().find(id);
  double driven_m = 0;
  while (keyframe != map.keyframes().begin() && driven_m < distance_m) {
    const auto before = std::prev(keyframe);
    driven_m +=
        (keyframe->second.map_from_camera.translation - before->second.map_from_camera.translation)
            .norm();
    keyframe = before;
  }
  return keyframe->first;
}

/// Some viewers of each landmark, that stand so far apart, tell nearly as much as all; the base has
/// keyframes of its own there. Where none of these saw it the last viewer stays.
void ThinViewers(const std::vector<size_t>& kept, LeanMap& map) {
  std::vector<bool> is_kept(map.keyframes.size(), false);
  for (const size_t i : kept) is_kept[i] = true;
  for (LeanLandmark& landmark : map.landmarks) {
    std::vector<uint32_t> viewers;
    std::copy_if(landmark.keyframe_idxs.begin(), landmark.keyframe_idxs.end(),
                 std::back_inserter(viewers), [&](uint32_t i) { return is_kept[i]; });
    if (viewers.empty()) viewers.push_back(landmark.keyframe_idxs.back());
    const auto distance_from = [&](uint32_t i) {
      return std::max(
          (map.keyframes[i].map_from_camera.translation - landmark.position_in_map).norm(), 1e-3);
    };
    const double levels =
        std::log(distance_from(landmark.anchor_idx) / distance_from(viewers.back())) /
        std::log(kLevelScale);
    landmark.anchor_level = static_cast<uint8_t>(
        std::clamp<long>(std::lround(landmark.anchor_level + levels), 0, kLevelCount - 1));
    landmark.anchor_idx = viewers.back();
    landmark.keyframe_idxs = std::move(viewers);
  }
}

/// With these landmarks alone, and the keyframes that they need and those of `path`.
LeanMap Reduced(const LeanMap& map, std::vector<LeanLandmark> landmarks,
                const std::vector<size_t>& path) {
  LeanMap reduced{.drives = map.drives, .keyframes = {}, .landmarks = std::move(landmarks)};
  std::vector<bool> stays(map.keyframes.size(), false);
  for (const size_t i : path) stays[i] = true;
  for (const LeanLandmark& landmark : reduced.landmarks) {
    for (const uint32_t i : landmark.keyframe_idxs) stays[i] = true;
  }
  std::vector<uint32_t> places(map.keyframes.size(), 0);
  for (size_t i = 0; i < map.keyframes.size(); ++i) {
    if (!stays[i]) continue;
    places[i] = static_cast<uint32_t>(reduced.keyframes.size());
    reduced.keyframes.push_back(map.keyframes[i]);
  }
  for (LeanLandmark& landmark : reduced.landmarks) {
    for (uint32_t& i : landmark.keyframe_idxs) i = places[i];
    landmark.anchor_idx = places[landmark.anchor_idx];
  }
  return reduced;
}

}  // namespace

/// Of the drive's own map: what the part tells of, with some of the road before it.
struct DiffPublisher::Stretch {
  StrippedMap stripped;
  KeyframeId first, last;
  size_t begin = 0;  ///< index of `first` in the stripped map
  bool is_last = false;

  static Stretch Of(const Map& own, const LeanDrive& drive, KeyframeId first, KeyframeId last,
                    double back_m, bool is_last) {
    Stretch stretch{StripStretch(own, drive, KeyframeBefore(own, first, back_m), last), first, last,
                    0, is_last};
    const auto& keyframes = stretch.stripped.lean.keyframes;
    while (keyframes[stretch.begin].id < first) ++stretch.begin;
    return stretch;
  }
  const LeanMap& map() const { return stripped.lean; }
  /// Keyframes from this one on, so far apart.
  std::vector<size_t> Path(size_t from, double spacing_m) const {
    std::vector<size_t> path;
    double since_m = spacing_m;
    for (size_t i = from; i < map().keyframes.size(); ++i) {
      if (i > from) since_m += StepM(map().keyframes[i - 1], map().keyframes[i]);
      if (since_m < spacing_m && i + 1 < map().keyframes.size()) continue;
      path.push_back(i);
      since_m = 0;
    }
    return path;
  }
};

void DiffPublisher::Take(Timestamp timestamp, KeyframeId frame, const TrackedFrame& own,
                         const VehiclePose& pose, const StereoRig& rig, const MapView& view,
                         const ReconstructedMap& base, const DenseDisparity* disparities) {
  if (!part_began_) part_began_ = timestamp;
  newest_ = timestamp;
  if (own.camera_from_previous) driven_m_ += own.camera_from_previous->translation.norm();
  for (const auto& tile : view.tiles()) tiles_[tile->id] = tile;
  sightings_.Take(base, rig, pose, disparities);
  const bool is_placed = pose.known_by == KnownBy::kMap && !view.tiles().empty() &&
                         SigmaM(pose.pose->covariance) <= options_.max_anchor_sigma_m;
  if (!is_placed || own.reference != frame) return;
  places_[frame] = {view.tiles().front()->id.component,
                    view.root_from_view() * pose.pose->camera_from_base.Inverse(),
                    SigmaM(pose.pose->covariance), SigmaRad(pose.pose->covariance)};
}

bool DiffPublisher::IsDue() const {
  return part_began_ && newest_->seconds() - part_began_->seconds() >= options_.every_s &&
         driven_m_ >= options_.min_driven_m;
}

std::optional<PublishedPart> DiffPublisher::Publish(const Map& own, const LeanDrive& drive,
                                                    const MapView& view,
                                                    const ReconstructedMap& base, bool is_last) {
  part_began_ = newest_;
  driven_m_ = 0;
  const size_t unfinished = is_last ? 0 : options_.unfinished_keyframes;
  if (own.keyframes().size() <= unfinished) return std::nullopt;
  const KeyframeId last =
      std::prev(own.keyframes().end(), static_cast<long>(unfinished) + 1)->first;
  const auto next = done_ ? own.keyframes().upper_bound(*done_) : own.keyframes().begin();
  if (next == own.keyframes().end() || next->first > last) return std::nullopt;
  const KeyframeId first = next->first;
  const Stretch stretch = Stretch::Of(own, drive, first, last, kLookBackM, is_last);

  PublishedPart part;
  part.diff.drive.drives = {drive};
  part.length_m = LengthM(stretch.map(), stretch.begin);
  part.landmarks_of_stretch = stretch.map().landmarks.size();
  if (const absl::Status status = AddNews(own, stretch, view, base, part); !status.ok()) {
    part.segment_because = std::string(status.message());
    AddSegment(Stretch::Of(own, drive, first, last, options_.overlap_m, is_last), part);
  }
  AddSightings(is_last, part);
  tiles_.clear();  // those of the view come again with the next frame
  done_ = last;
  if (part.diff.drive.landmarks.empty() && part.diff.sightings.empty()) return std::nullopt;
  part.diff.part = next_part_++;
  return part;
}

std::vector<AnchoredKeyframe> DiffPublisher::AnchorsOf(const LeanMap& stretch,
                                                       const MapView& view) const {
  std::vector<AnchoredKeyframe> anchors;
  if (view.tiles().empty()) return anchors;
  const BendOptions& bend = options_.fit.bend;
  const Rigid3 view_from_root = view.root_from_view().Inverse();
  for (uint32_t i = 0; i < stretch.keyframes.size(); ++i) {
    const auto place = places_.find(stretch.keyframes[i].id);
    if (place == places_.end() || place->second.component != view.tiles().front()->id.component) {
      continue;
    }
    anchors.push_back({i, view_from_root * place->second.root_from_camera,
                       std::max(place->second.sigma_m, bend.min_sigma_m),
                       std::max(place->second.sigma_rad, bend.min_sigma_rad), 1});
  }
  return anchors;
}

/// Of the keyframes from `begin` on, the way along the drive to the nearest anchor, at most.
double DiffPublisher::FarthestFromAnchorsM(const LeanMap& stretch, size_t begin,
                                           const std::vector<AnchoredKeyframe>& anchors) const {
  const size_t count = stretch.keyframes.size();
  std::vector<double> ways_m(count, std::numeric_limits<double>::infinity());
  for (const AnchoredKeyframe& anchor : anchors) ways_m[anchor.keyframe_idx] = 0;
  const auto shorten = [&](size_t from, size_t to) {
    const double step_m = StepM(stretch.keyframes[from], stretch.keyframes[to]);
    ways_m[to] = std::min(ways_m[to], ways_m[from] + step_m);
  };
  for (size_t i = 1; i < count; ++i) shorten(i - 1, i);
  for (size_t i = count; i-- > 1;) shorten(i, i - 1);
  return *std::max_element(ways_m.begin() + static_cast<long>(begin), ways_m.end());
}

/// What was seen and missed of the tiles since the last part.
void DiffPublisher::AddSightings(bool is_last, PublishedPart& part) {
  const std::map<LandmarkId, Sighting> released =
      sightings_.Release(is_last ? 0 : options_.behind_m);
  for (const auto& [id, tile] : tiles_) {
    TileSightings of_tile{.tile = id, .version = tile->version, .of_landmarks = {}};
    bool tells = false;
    for (const LeanLandmark& landmark : tile->map.landmarks) {
      const auto found = released.find(landmark.id);
      of_tile.of_landmarks.push_back(found == released.end() ? Sighting::kNone : found->second);
      part.seen += of_tile.of_landmarks.back() == Sighting::kSeen;
      part.missed += of_tile.of_landmarks.back() == Sighting::kMissed;
      part.seen_through += of_tile.of_landmarks.back() == Sighting::kSeenThrough;
      tells |= found != released.end();
    }
    if (tells) part.diff.sightings.push_back(std::move(of_tile));
  }
}

/// The landmarks of the stretch with these indices, with names that are theirs for good.
LeanMap DiffPublisher::Named(const StrippedMap& stripped, const std::vector<uint32_t>& landmarks) {
  LeanMap named = stripped.lean;
  named.landmarks.clear();
  for (const uint32_t i : landmarks) {
    const auto [name, is_first] = published_.try_emplace(stripped.sources[i], next_index_);
    next_index_ += is_first;
    named.landmarks.push_back(stripped.lean.landmarks[i]);
    named.landmarks.back().id.index = name->second;
  }
  std::sort(named.landmarks.begin(), named.landmarks.end(),
            [](const LeanLandmark& a, const LeanLandmark& b) { return a.id < b.id; });
  return named;
}

/// Where the stretch is known road. Errors: FailedPrecondition if it is not.
absl::Status DiffPublisher::AddNews(const Map& own, const Stretch& stretch, const MapView& view,
                                    const ReconstructedMap& base, PublishedPart& part) {
  std::vector<AnchoredKeyframe> anchors = AnchorsOf(stretch.map(), view);
  if (anchors.empty()) return absl::FailedPreconditionError("nothing of the base was seen on it");
  const double unknown_m = FarthestFromAnchorsM(stretch.map(), stretch.begin, anchors);
  if (unknown_m > options_.known_m) {
    return absl::FailedPreconditionError(
        fmt::format("up to {:.0f} m of it were driven without seeing the base", unknown_m));
  }
  CARMAP_ASSIGN_OR_RETURN(
      const FittedSegment fitted,
      FitLocalized(view.map(), base, stretch.map(), std::move(anchors), options_.fit));
  for (size_t k = stretch.begin; k < fitted.diff.drive.keyframes.size(); ++k) {
    const Eigen::Vector3d& place = fitted.diff.drive.keyframes[k].map_from_camera.translation;
    if (base.keyframe_centers.WithinRadius(place, options_.driven_m, 1).empty()) {
      return absl::FailedPreconditionError("it leads to where the base has no keyframe");
    }
  }
  const std::vector<uint32_t> news = NewLandmarks(
      base, fitted.diff.drive, fitted.diff.seen_again,
      [&](LandmarkId id) { return sightings_.HasSeen(id); }, options_.news);
  const auto is_due = [&](uint32_t i) {
    const LandmarkId source = stretch.stripped.sources[i];
    if (published_.contains(source)) return false;
    const KeyframeId last_seen = own.Find(source)->observations.back().keyframe_id;
    return stretch.is_last || last_seen <= stretch.last;
  };
  std::vector<uint32_t> due;
  std::copy_if(news.begin(), news.end(), std::back_inserter(due), is_due);
  LeanMap named = Named({fitted.diff.drive, stretch.stripped.sources}, due);
  ThinViewers(stretch.Path(0, options_.viewer_spacing_m), named);
  LeanMap reduced =
      Reduced(named, named.landmarks, stretch.Path(stretch.begin, options_.path_spacing_m));
  for (LeanKeyframe& keyframe : reduced.keyframes) keyframe.gps.reset();  // its pose tells
  const TileId frame{view.tiles().front()->id.component, view.frame_cell()};
  const Rigid3 tile_from_view =
      RootFromTile(view.grid(), frame.cell).Inverse() * view.root_from_view();
  part.diff.frame = frame;
  part.diff.drive = Moved(std::move(reduced), tile_from_view);
  return absl::OkStatus();
}

void DiffPublisher::AddSegment(const Stretch& stretch, PublishedPart& part) {
  std::vector<uint32_t> all(stretch.map().landmarks.size());
  for (uint32_t i = 0; i < all.size(); ++i) all[i] = i;
  part.diff.drive = Named(stretch.stripped, all);
}

}  // namespace carmap
