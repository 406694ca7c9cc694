#include "carmap/ingest/contribute.h"

#include <absl/time/clock.h>
#include <absl/time/time.h>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "carmap/base/status_macros.h"
#include "carmap/base/summary.h"
#include "carmap/feature/default_vocabulary.h"
#include "carmap/index/keyframe_tree.h"
#include "carmap/index/reconstruct.h"
#include "carmap/ingest/candidate_tiles.h"
#include "carmap/ingest/changes.h"
#include "carmap/ingest/journal.h"
#include "carmap/ingest/pass_memory.h"
#include "carmap/ingest/pose_constraints.h"
#include "carmap/map/by_id.h"

namespace carmap {
namespace {

/// `part` is absent for a whole drive.
absl::Status Admit(const LeanMap& segment, std::optional<uint32_t> part, const BaseMap& base,
                   const ContributeOptions& options) {
  CARMAP_RETURN_IF_ERROR(CheckConsistency(segment));
  if (segment.drives.empty()) {
    return absl::InvalidArgumentError("it names no drive; publish it again");
  }
  if (segment.landmarks.empty() && !part) {
    return absl::InvalidArgumentError("the map has no landmarks; map a longer drive");
  }
  for (const LeanDrive& drive : segment.drives) {
    if (drive.faults.any() && !options.accept_suspect) {
      return absl::FailedPreconditionError(fmt::format(
          "its drive {} is suspect: {}; mend the drive and map it again, or take it as it is with "
          "--accept-suspect",
          ToHex(drive.id), NamesOf(drive.faults)));
    }
    CARMAP_ASSIGN_OR_RETURN(const auto whole, base.reader().ReadContribution(KeyOf(drive.id)));
    if (whole) {
      return absl::AlreadyExistsError(
          fmt::format("its drive {} is in the base already", ToHex(drive.id)));
    }
    if (!part) continue;
    CARMAP_ASSIGN_OR_RETURN(const auto same,
                            base.reader().ReadContribution(KeyOf(drive.id, *part)));
    if (same) {
      return absl::AlreadyExistsError(
          fmt::format("part {} of its drive {} is in the base already", *part, ToHex(drive.id)));
    }
  }
  return absl::OkStatus();
}

/// The segment in the frame of a view of the component.
struct Placed {
  MapView view;
  FittedSegment fitted;
};

std::vector<Eigen::Vector3d> PlacesInRoot(const LeanMap& map, const Rigid3& root_from_map) {
  std::vector<Eigen::Vector3d> places;
  for (const LeanKeyframe& keyframe : map.keyframes) {
    places.push_back(root_from_map * keyframe.map_from_camera.translation);
  }
  return Thinned(places);
}

/// Whether the segment drives somewhere where the base has seen the road from its side: going the
/// other way it shows nothing that could be known again, and looking for it would take long.
bool LooksTheSameWay(const LeanMap& segment, const Rigid3& view_from_segment, const LeanMap& base,
                     double radius_m) {
  const KdTree of_base = TreeOfKeyframes(base);
  const auto forward = [](const Rigid3& pose) {
    return Eigen::Vector3d(pose.rotation * Eigen::Vector3d::UnitZ());
  };
  return std::any_of(segment.keyframes.begin(), segment.keyframes.end(),
                     [&](const LeanKeyframe& keyframe) {
                       const Rigid3 pose = view_from_segment * keyframe.map_from_camera;
                       const auto near = of_base.WithinRadius(pose.translation, radius_m);
                       return std::any_of(near.begin(), near.end(), [&](uint32_t i) {
                         return forward(pose).dot(forward(base.keyframes[i].map_from_camera)) > 0;
                       });
                     });
}

/// A map that is to be fitted, and where on the Earth it lies and heads, as far as that is known.
struct Segment {
  const LeanMap& map;
  std::optional<Rigid3> ecef_from_map;
};

std::optional<Rigid3> EcefFromMap(const LeanMap& map, const GpsOptions& options) {
  const auto georeference = SettledGeoreferenceOf(map, options);
  if (!georeference) return std::nullopt;
  return EcefFromEnu(georeference->origin) * georeference->enu_from_map;
}

/// Fits the segment to these tiles, and then to all tiles along the way that this tells.
absl::StatusOr<Placed> PlaceIn(const Segment& segment, const CandidateTiles& candidate,
                               const Changes& changes, const BaseMap& base,
                               const ContributeOptions& options) {
  constexpr int kMaxViews = 4;
  const uint64_t frame_cell = candidate.tiles.front().cell;
  std::vector<TileId> tiles = candidate.tiles;
  for (int i = 0;; ++i) {
    CARMAP_ASSIGN_OR_RETURN(MapView view, changes.View(candidate.component, frame_cell, tiles));
    if (i == 0 && segment.ecef_from_map && view.grid().is_on_earth &&
        !LooksTheSameWay(segment.map, view.root_from_view().Inverse() * *segment.ecef_from_map,
                         view.map(), options.radius_m)) {
      return absl::NotFoundError("the base has the road from the other side alone");
    }
    CARMAP_ASSIGN_OR_RETURN(FittedSegment fitted, Fit(view.map(), segment.map, options.fit));
    CARMAP_ASSIGN_OR_RETURN(
        const std::vector<TileId> along,
        TilesNear(base.reader(), candidate.component,
                  PlacesInRoot(fitted.diff.drive, view.root_from_view()), options.radius_m));
    std::vector<TileId> all;
    std::set_union(tiles.begin(), tiles.end(), along.begin(), along.end(), std::back_inserter(all));
    if (all == tiles || i + 1 == kMaxViews) return Placed{std::move(view), std::move(fitted)};
    tiles = std::move(all);
  }
}

/// A component that is this map alone: where its fixes say, or on a grid of its own.
struct NewComponent {
  Component component;
  MapView view;  ///< has no tiles
  LeanMap map;   ///< in its frame
};

NewComponent MakeComponent(const Segment& segment, uint32_t id, int cell_level,
                           const GpsOptions& options) {
  const bool is_on_earth = segment.ecef_from_map.has_value();
  const Component component{.id = id,
                            .grid = {.is_on_earth = is_on_earth, .level = cell_level},
                            .sigma_m = is_on_earth ? options.sigma_m : 0};
  const Rigid3 root_from_segment = segment.ecef_from_map.value_or(Rigid3());
  const Eigen::Vector3d first =
      root_from_segment * segment.map.keyframes.front().map_from_camera.translation;
  MapView view(component.grid, CellAt(component.grid, first), {});
  LeanMap map = Moved(segment.map, view.root_from_view().Inverse() * root_from_segment);
  return {component, std::move(view), std::move(map)};
}

/// Nothing without fixes, or in a component without GPS.
std::optional<double> GpsOffsetM(const LeanMap& segment, const LeanMap& fitted,
                                 const MapView& view) {
  if (!view.grid().is_on_earth) return std::nullopt;
  const Rigid3 view_from_root = view.root_from_view().Inverse();
  std::vector<double> offsets_m;
  for (size_t i = 0; i < segment.keyframes.size(); ++i) {
    if (!segment.keyframes[i].gps) continue;
    const Eigen::Vector3d offset =
        view_from_root * EcefFromEnu(*segment.keyframes[i].gps).translation -
        fitted.keyframes[i].map_from_camera.translation;
    offsets_m.push_back(std::hypot(offset.x(), offset.z()));
  }
  if (offsets_m.empty()) return std::nullopt;
  return Summarize(std::move(offsets_m)).median;
}

/// Records of `of` that `in` does not have; both ascending by id.
size_t CountMissing(const std::vector<LeanLandmark>& of, const std::vector<LeanLandmark>& in) {
  AscendingSearch search(in);
  return static_cast<size_t>(std::count_if(of.begin(), of.end(), [&](const LeanLandmark& landmark) {
    return search.Find(landmark.id) == nullptr;
  }));
}

/// What a diff tells of poses: the steps between its keyframes, each of which stands where the base
/// was seen from.
PoseConstraints ConstraintsOf(const MapDiff& diff, const LeanMap& base) {
  constexpr double kLocalizedSigmaM = 0.3, kLocalizedSigmaRad = 0.01;
  std::vector<DriveStep> steps;
  std::vector<AnchoredKeyframe> anchors;
  const std::vector<LeanKeyframe>& keyframes = diff.drive.keyframes;
  for (uint32_t i = 0; i < keyframes.size(); ++i) {
    if (i > 0 && keyframes[i - 1].id.drive == keyframes[i].id.drive) steps.push_back({i - 1, i});
    anchors.push_back({i, keyframes[i].map_from_camera, kLocalizedSigmaM, kLocalizedSigmaRad, 1});
  }
  PoseConstraints constraints = ConstraintsOf(diff.drive, std::move(steps));
  AddAnchors(base, diff.drive, anchors, constraints);
  return constraints;
}

class Contributor {
 public:
  Contributor(const LeanMap& segment, BaseMap& base, const ContributeOptions& options)
      : segment_(segment), base_(base), options_(options), changes_(base) {}

  /// A segment, which is to be fitted.
  absl::StatusOr<Contribution> Run(const std::string& name) {
    Begin(name);
    CARMAP_RETURN_IF_ERROR(Place());
    return CommitAll();
  }

  /// A diff, of which the segment is the drive's part.
  absl::StatusOr<Contribution> RunDiff(const std::string& name, const MapDiff& diff) {
    Begin(name);
    part_ = diff.part;
    CARMAP_RETURN_IF_ERROR(TakeSightings(diff.sightings));
    if (diff.is_placed()) {
      CARMAP_RETURN_IF_ERROR(TakeDiff(diff));
    } else if (!segment_.landmarks.empty()) {
      CARMAP_RETURN_IF_ERROR(Place());
    }
    return CommitAll();
  }

 private:
  /// Fits the segment, or makes a component of it.
  absl::Status Place() {
    CARMAP_ASSIGN_OR_RETURN(const std::vector<CandidateTiles> candidates, Candidates());
    ecef_from_segment_ = EcefFromMap(segment_, options_.gps);
    absl::Status contradiction;
    for (const CandidateTiles& candidate : candidates) {
      const absl::Status status = is_placed() ? Join(candidate) : FitTo(candidate);
      // Another component may be the right one: two may look alike.
      if (absl::IsFailedPrecondition(status)) {
        contradiction.Update(status);
        made_.contradicting.push_back(candidate.component.id);
      } else {
        CARMAP_RETURN_IF_ERROR(status);
      }
    }
    if (is_placed()) return absl::OkStatus();
    CARMAP_RETURN_IF_ERROR(contradiction);
    return BeginComponent();
  }

  absl::Status TakeDiff(const MapDiff& diff) {
    CARMAP_ASSIGN_OR_RETURN(const std::vector<Component> components, base_.Components());
    const auto component =
        std::find_if(components.begin(), components.end(),
                     [&](const Component& c) { return c.id == diff.frame.component; });
    if (component == components.end() || !IsCell(component->grid, diff.frame.cell)) {
      return absl::FailedPreconditionError(
          fmt::format("its frame, tile {}/{:016x}, is none of the base; fetch the tiles around and "
                      "localize anew",
                      diff.frame.component, diff.frame.cell));
    }
    const Rigid3 root_from_tile = RootFromTile(component->grid, diff.frame.cell);
    CARMAP_ASSIGN_OR_RETURN(const std::vector<TileId> tiles,
                            TilesNear(base_.reader(), *component,
                                      PlacesInRoot(diff.drive, root_from_tile), options_.radius_m));
    CARMAP_ASSIGN_OR_RETURN(MapView view, changes_.View(*component, diff.frame.cell, tiles));
    MapDiff in_view = diff;
    in_view.drive = Moved(diff.drive, view.root_from_view().Inverse() * root_from_tile);
    constraints_ = ConstraintsOf(in_view, view.map());
    made_.component = component->id;
    if (diff.drive.landmarks.empty()) return absl::OkStatus();
    for (const LeanLandmark& landmark : diff.drive.landmarks) news_.insert(landmark.id);
    return TakeSegment(*component, {std::move(view), {.diff = std::move(in_view)}});
  }

  void Begin(const std::string& name) {
    made_.name = name;
    for (const LeanDrive& drive : segment_.drives) made_.drives.push_back(drive.id);
    made_.keyframes = segment_.keyframes.size();
    made_.landmarks = segment_.landmarks.size();
  }

  absl::StatusOr<std::vector<CandidateTiles>> Candidates() const {
    CARMAP_ASSIGN_OR_RETURN(auto candidates, CandidatesByGps(segment_, base_, options_.radius_m));
    const bool has_gps =
        std::any_of(segment_.keyframes.begin(), segment_.keyframes.end(),
                    [](const LeanKeyframe& keyframe) { return keyframe.gps.has_value(); });
    CARMAP_ASSIGN_OR_RETURN(
        auto by_words,
        CandidatesByWords(WordsAlong(segment_, DefaultVocabulary()), base_, DefaultVocabulary(),
                          options_.max_word_tiles, /*on_earth_too=*/!has_gps));
    candidates.insert(candidates.end(), by_words.begin(), by_words.end());
    return candidates;
  }

  bool is_placed() const { return made_.fit || new_component_; }

  /// The first component that the segment fits takes it, unless it lies nowhere on the Earth and
  /// the segment does: then it becomes part of the segment's own.
  absl::Status FitTo(const CandidateTiles& candidate) {
    auto placed = PlaceIn({segment_, ecef_from_segment_}, candidate, changes_, base_, options_);
    if (absl::IsNotFound(placed.status())) return absl::OkStatus();
    CARMAP_RETURN_IF_ERROR(placed.status());
    if (!candidate.component.grid.is_on_earth && ecef_from_segment_) {
      CARMAP_RETURN_IF_ERROR(BeginComponent());
      return Absorb(candidate.component);
    }
    CARMAP_RETURN_IF_ERROR(TakeSegment(candidate.component, *placed));
    made_.fit = placed->fitted.report;
    constraints_ = ConstraintsOf(segment_, placed->fitted.steps);
    AddAnchors(placed->view.map(), segment_, placed->fitted.anchors, constraints_);
    if (placed->view.grid().is_on_earth) {
      ecef_from_segment_ = placed->view.root_from_view() *
                           placed->fitted.diff.drive.keyframes.front().map_from_camera *
                           segment_.keyframes.front().map_from_camera.Inverse();
    }
    made_.gps_offset_m = GpsOffsetM(segment_, placed->fitted.diff.drive, placed->view);
    return absl::OkStatus();
  }

  /// What the component's map becomes by what was placed in it.
  absl::StatusOr<LeanMap> Take(const Component& component, const Placed& placed) {
    ApplyOptions apply = options_.apply;
    // What only shows news does not show that anything else must go.
    constexpr double kAnyGrowth = 1e6;
    if (placed.fitted.diff.seen_again.empty()) apply.max_growth = kAnyGrowth;
    CARMAP_ASSIGN_OR_RETURN(LeanMap merged, Apply(placed.fitted.diff, placed.view.map(), apply));
    CARMAP_RETURN_IF_ERROR(changes_.Replace(component, placed.view, merged));
    return merged;
  }

  absl::Status TakeSegment(const Component& component, const Placed& placed) {
    const LeanMap& before = placed.view.map();
    CARMAP_ASSIGN_OR_RETURN(const LeanMap after, Take(component, placed));
    made_.component = component.id;
    made_.keyframes_added = after.keyframes.size() - before.keyframes.size();
    made_.landmarks_added = CountMissing(after.landmarks, before.landmarks);
    made_.landmarks_replaced = CountMissing(before.landmarks, after.landmarks);
    for (const SameLandmark& same : placed.fitted.diff.seen_again) {
      outcomes_.try_emplace(same.in_base, Sighting::kSeen);
    }
    return absl::OkStatus();
  }

  /// Another component that the segment fits, too, becomes part of the segment's.
  absl::Status Join(const CandidateTiles& candidate) {
    if (candidate.component.id == made_.component) return absl::OkStatus();
    const auto touches =
        PlaceIn({segment_, ecef_from_segment_}, candidate, changes_, base_, options_);
    if (absl::IsNotFound(touches.status())) return absl::OkStatus();
    CARMAP_RETURN_IF_ERROR(touches.status());
    return Absorb(candidate.component);
  }

  absl::Status Absorb(const Component& other) {
    CARMAP_ASSIGN_OR_RETURN(const std::vector<TileId> its_tiles, TilesOf(base_.reader(), other.id));
    CARMAP_ASSIGN_OR_RETURN(const MapView whole,
                            changes_.View(other, its_tiles.front().cell, its_tiles));
    CARMAP_ASSIGN_OR_RETURN(const Component own, OwnComponent());
    std::vector<TileId> around;
    for (const auto& tile : changes_.Changed()) {
      if (tile->id.component == own.id) around.push_back(tile->id);
    }
    auto placed = PlaceIn({whole.map(), std::nullopt}, {own, around}, changes_, base_, options_);
    if (!placed.ok()) {
      return absl::FailedPreconditionError(
          fmt::format("components {} and {} do not fit each other: {}", made_.component, other.id,
                      std::string(placed.status().message())));
    }
    CARMAP_RETURN_IF_ERROR(Take(own, *placed).status());
    AddAnchors(placed->view.map(), whole.map(), placed->fitted.anchors, constraints_);
    for (const TileId& id : its_tiles) CARMAP_RETURN_IF_ERROR(changes_.Put({id, 0, {}}));
    made_.joined.push_back(other.id);
    return absl::OkStatus();
  }

  /// The one that the segment is in by now.
  absl::StatusOr<Component> OwnComponent() const {
    if (new_component_) return *new_component_;
    CARMAP_ASSIGN_OR_RETURN(const std::vector<Component> components, base_.Components());
    return *std::find_if(components.begin(), components.end(),
                         [&](const Component& c) { return c.id == made_.component; });
  }

  absl::Status BeginComponent() {
    CARMAP_ASSIGN_OR_RETURN(const std::vector<Component> components, base_.Components());
    // Of those that ended, removed tiles tell: a number never means another component.
    CARMAP_ASSIGN_OR_RETURN(const std::vector<TileVersion> tiles, base_.reader().ListTiles());
    const uint32_t id = std::max(components.empty() ? 0 : components.back().id,
                                 tiles.empty() ? 0 : tiles.back().tile.component) +
                        1;
    const NewComponent made =
        MakeComponent({segment_, ecef_from_segment_}, id, base_.cell_level(), options_.gps);
    CARMAP_RETURN_IF_ERROR(changes_.Replace(made.component, made.view, made.map));
    constraints_ = ConstraintsOf(segment_, StepsOf(Reconstruct(segment_)));
    new_component_ = made.component;
    made_.component = id;
    made_.is_new_component = true;
    made_.keyframes_added = made_.keyframes;
    made_.landmarks_added = made_.landmarks;
    return absl::OkStatus();
  }

  /// What the drive says of landmarks, whatever became of their tiles since.
  absl::Status TakeSightings(const std::vector<TileSightings>& sightings) {
    for (const TileSightings& seen : sightings) {
      tiles_seen_.insert(seen.tile);
      CARMAP_ASSIGN_OR_RETURN(const auto landmarks,
                              LandmarksOfVersion(seen.tile, seen.version, base_));
      if (!landmarks || landmarks->size() != seen.of_landmarks.size()) {
        ++made_.sightings_ignored;
        continue;
      }
      for (size_t i = 0; i < landmarks->size(); ++i) {
        const Sighting outcome = seen.of_landmarks[i];
        if (outcome != Sighting::kNone) outcomes_[(*landmarks)[i]] = outcome;
        made_.seen += outcome == Sighting::kSeen;
        made_.missed += outcome == Sighting::kMissed;
        made_.seen_through += outcome == Sighting::kSeenThrough;
      }
    }
    // A vehicle that is not where it thinks misses everything.
    const size_t told = outcomes_.size();
    made_.is_doubted =
        told >= options_.min_doubted &&
        static_cast<double>(made_.seen) < options_.min_seen_share * static_cast<double>(told);
    if (made_.is_doubted) outcomes_.clear();
    return absl::OkStatus();
  }

  /// Unix time of the drive's pass; where it is not known, now.
  int64_t PassTimeS() const {
    const LeanDrive& drive = segment_.drives.front();
    if (!drive.unix_start || segment_.keyframes.empty()) return absl::ToUnixSeconds(absl::Now());
    return static_cast<int64_t>(drive.unix_start->seconds() +
                                segment_.keyframes.front().timestamp.seconds());
  }

  /// The drive's pass joins the others of the tiles that it saw, and what is gone by them goes.
  absl::Status Remember(Commit& commit) {
    for (const auto& tile : changes_.Changed()) tiles_seen_.insert(tile->id);
    if (tiles_seen_.empty() || segment_.drives.empty()) return absl::OkStatus();
    PassMemory memory(changes_, base_, options_.persistence);
    CARMAP_RETURN_IF_ERROR(memory.Load({tiles_seen_.begin(), tiles_seen_.end()}));
    memory.AddPass(segment_.drives.front().id, PassTimeS(), outcomes_,
                   {options_.light_m, options_.light_prior});
    memory.AddNews(news_);
    CARMAP_ASSIGN_OR_RETURN(const PassConsequences consequences, memory.Draw(changes_));
    made_.landmarks_vanished = consequences.vanished;
    made_.landmarks_confirmed = consequences.confirmed;
    made_.landmarks_refuted = consequences.refuted;
    made_.landmarks_returned = consequences.returned;
    memory.AddTo(commit);
    return absl::OkStatus();
  }

  absl::StatusOr<Contribution> CommitAll() {
    Commit commit;
    CARMAP_RETURN_IF_ERROR(Remember(commit));
    CARMAP_RETURN_IF_ERROR(changes_.AddTo(DefaultVocabulary(), commit));
    if (new_component_) {
      commit.components.emplace_back(new_component_->id, EncodeComponent(*new_component_));
    }
    for (const uint32_t joined : made_.joined) commit.components.emplace_back(joined, "");
    made_.tiles = VersionsAfter(commit);
    made_.patch_bytes = PatchBytesOf(commit);
    CARMAP_ASSIGN_OR_RETURN(std::string constraints, EncodeConstraints(constraints_));
    made_.constraint_bytes = constraints.size();
    for (const DriveId& drive : made_.drives) {
      commit.contributions.emplace_back(part_ ? KeyOf(drive, *part_) : KeyOf(drive),
                                        std::exchange(constraints, {}));
    }
    commit.journal_text = ToJournal(made_);
    CARMAP_ASSIGN_OR_RETURN(made_.sequence, base_.Apply(commit));
    return made_;
  }

  const LeanMap& segment_;
  BaseMap& base_;
  const ContributeOptions& options_;
  Changes changes_;
  std::optional<Component> new_component_;
  std::optional<Rigid3> ecef_from_segment_;  ///< by its fixes, or by where it was fitted
  std::optional<uint32_t> part_;             ///< of a diff
  Contribution made_;
  PoseConstraints constraints_;
  std::map<LandmarkId, Sighting> outcomes_;  ///< of landmarks of the base, by the drive
  std::set<TileId> tiles_seen_;
  std::set<LandmarkId> news_;  ///< of a diff
};

/// Others committed to the same tiles, or to what is remembered of them: admitted, what is there
/// under its key is no part of the drive.
bool IsOvertaken(const absl::Status& status) {
  return absl::IsAborted(status) || absl::IsAlreadyExists(status);
}

}  // namespace

absl::StatusOr<Contribution> Contribute(const LeanMap& segment, const std::string& name,
                                        BaseMap& base, const ContributeOptions& options) {
  CARMAP_RETURN_IF_ERROR(Admit(segment, std::nullopt, base, options));
  for (int attempt = 1;; ++attempt) {
    auto made = Contributor(segment, base, options).Run(name);
    if (!IsOvertaken(made.status()) || attempt == options.max_attempts) return made;
  }
}

absl::StatusOr<Contribution> Contribute(const MapDiff& diff, const std::string& name, BaseMap& base,
                                        const ContributeOptions& options) {
  CARMAP_RETURN_IF_ERROR(Admit(diff.drive, diff.part, base, options));
  for (int attempt = 1;; ++attempt) {
    auto made = Contributor(diff.drive, base, options).RunDiff(name, diff);
    if (!IsOvertaken(made.status()) || attempt == options.max_attempts) return made;
  }
}

}  // namespace carmap
