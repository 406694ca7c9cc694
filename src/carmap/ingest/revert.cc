#include "carmap/ingest/revert.h"

#include <absl/strings/match.h>
#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "carmap/base/status_macros.h"
#include "carmap/feature/default_vocabulary.h"
#include "carmap/format/tile_codec.h"
#include "carmap/ingest/changes.h"
#include "carmap/ingest/journal.h"
#include "carmap/map/by_id.h"

namespace carmap {
namespace {

absl::StatusOr<LoggedChange> FindContribution(const std::string& drive, const BaseMap& base) {
  CARMAP_ASSIGN_OR_RETURN(const std::vector<LoggedChange> log, ReadLog(base.reader()));
  std::optional<LoggedChange> found;
  for (const LoggedChange& change : log) {
    const bool is_of_drive =
        std::any_of(change.drives.begin(), change.drives.end(),
                    [&](const std::string& id) { return absl::StartsWith(id, drive); });
    if (!is_of_drive) continue;
    if (change.kind == "revert") {
      found.reset();
    } else if (change.kind == "add") {
      if (found) {
        return absl::InvalidArgumentError(
            fmt::format("{}: several drives begin with {}; write more digits (`carmap base log {}` "
                        "lists them)",
                        base.name(), drive, base.name()));
      }
      found = change;
    }
  }
  if (found) return *found;
  return absl::NotFoundError(
      fmt::format("{}: no drive of the base begins with {}; `carmap base log "
                  "{}` lists those that were added",
                  base.name(), drive, base.name()));
}

/// The landmark as the keyframes of this map see it, for comparison across maps.
struct Sighting {
  std::vector<KeyframeId> seen_by;
  KeyframeId anchor;
  Eigen::Vector3d p_in_anchor;

  Sighting(const LeanMap& map, const LeanLandmark& landmark)
      : anchor(map.keyframes[landmark.anchor_idx].id),
        p_in_anchor(PositionInAnchor(map, landmark)) {
    for (const uint32_t idx : landmark.keyframe_idxs) seen_by.push_back(map.keyframes[idx].id);
  }
  bool operator==(const Sighting& other) const {
    return seen_by == other.seen_by && anchor == other.anchor &&
           (p_in_anchor - other.p_in_anchor).norm() < 1e-5;
  }
};

/// One tile without what one contribution made of it.
class TileReversion {
 public:
  /// `drives` are those of the contribution, in hexadecimal digits.
  TileReversion(const Tile& now, const Patch& patch, const Patch& inverse,
                const std::set<std::string>& drives)
      : now_(now), patch_(patch), inverse_(inverse), drives_(drives) {}

  absl::StatusOr<Tile> Run(Reversion& made) {
    Patch undo{.tile = now_.id, .from_version = now_.version, .to_version = now_.version + 1};
    for (const LeanLandmark& before : inverse_.put.landmarks) {
      if (IsAsTheContributionLeftIt(before.id)) restored_[before.id] = {&inverse_.put, before};
    }
    made.landmarks_restored += restored_.size();
    for (const LeanLandmark& landmark : now_.map.landmarks) {
      if (!IsOfContribution(landmark.id.drive) &&
          (restored_.contains(landmark.id) || Strip(landmark))) {
        continue;
      }
      undo.removed_landmarks.push_back(landmark.id);
    }
    for (const LeanKeyframe& keyframe : now_.map.keyframes) {
      if (!IsOfContribution(keyframe.id.drive)) continue;
      undo.removed_keyframes.push_back(keyframe.id);
      made.keyframes_removed += !keyframe.is_stub;
    }
    made.landmarks_removed += undo.removed_landmarks.size();
    undo.put = RestoredMap();
    return Applied(undo, now_);
  }

 private:
  /// A landmark as it will be, and the map whose keyframes its list means.
  struct Restored {
    const LeanMap* of = nullptr;
    LeanLandmark landmark;
  };

  bool IsOfContribution(DriveId drive) const { return drives_.contains(ToHex(drive)); }

  /// What others changed since stays as they left it; what they removed stays away.
  bool IsAsTheContributionLeftIt(LandmarkId id) const {
    const LeanLandmark* put = FindById(patch_.put.landmarks, id);
    const LeanLandmark* now = FindById(now_.map.landmarks, id);
    if (put == nullptr) return now == nullptr;
    return now != nullptr && Sighting(patch_.put, *put) == Sighting(now_.map, *now);
  }

  /// Takes the contribution's keyframes from the landmark's list. False if it then hangs on
  /// nothing.
  bool Strip(const LeanLandmark& landmark) {
    LeanLandmark without = landmark;
    std::erase_if(without.keyframe_idxs,
                  [&](uint32_t idx) { return IsOfContribution(now_.map.keyframes[idx].id.drive); });
    if (without.keyframe_idxs.size() == landmark.keyframe_idxs.size()) return true;
    if (!std::binary_search(without.keyframe_idxs.begin(), without.keyframe_idxs.end(),
                            landmark.anchor_idx)) {
      return false;
    }
    restored_[landmark.id] = {&now_.map, std::move(without)};
    return true;
  }

  /// The restored landmarks with the keyframes that they name, where these stand now.
  LeanMap RestoredMap() const {
    LeanMap put;
    std::map<KeyframeId, LeanKeyframe> keyframes;
    std::set<DriveId> used;
    for (const auto& [id, restored] : restored_) {
      used.insert(id.drive);
      for (const uint32_t idx : restored.landmark.keyframe_idxs) {
        const LeanKeyframe& then = restored.of->keyframes[idx];
        const LeanKeyframe* now = FindById(now_.map.keyframes, then.id);
        keyframes.emplace(then.id, now != nullptr ? *now : then);
        used.insert(then.id.drive);
      }
    }
    for (const auto& [id, keyframe] : keyframes) put.keyframes.push_back(keyframe);
    for (const auto& [id, restored] : restored_) {
      LeanLandmark& landmark = put.landmarks.emplace_back(restored.landmark);
      const auto place_of = [&](uint32_t idx) {
        return static_cast<uint32_t>(FindById(put.keyframes, restored.of->keyframes[idx].id) -
                                     put.keyframes.data());
      };
      for (uint32_t& idx : landmark.keyframe_idxs) idx = place_of(idx);
      landmark.anchor_idx = place_of(landmark.anchor_idx);
      landmark.position_in_map = put.keyframes[landmark.anchor_idx].map_from_camera *
                                 PositionInAnchor(*restored.of, restored.landmark);
    }
    for (const DriveId& id : used) {
      const LeanDrive* now = FindDrive(now_.map.drives, id);
      put.drives.push_back(now != nullptr ? *now : *FindDrive(inverse_.put.drives, id));
    }
    return put;
  }

  const Tile& now_;
  const Patch &patch_, &inverse_;
  const std::set<std::string>& drives_;
  std::map<LandmarkId, Restored> restored_;
};

/// The tile's patch of this version.
absl::StatusOr<StoredPatch> PatchTo(const TileVersion& version, const BaseMap& base) {
  CARMAP_ASSIGN_OR_RETURN(std::vector<StoredPatch> patches,
                          base.reader().ReadPatches(version.tile, version.version - 1));
  if (patches.empty() || patches.front().to_version != version.version) {
    return absl::DataLossError(fmt::format("{}: a patch of tile {}/{:016x} is missing", base.name(),
                                           version.tile.component, version.tile.cell));
  }
  return std::move(patches.front());
}

}  // namespace

absl::StatusOr<Reversion> Revert(const std::string& drive, BaseMap& base) {
  CARMAP_ASSIGN_OR_RETURN(const LoggedChange added, FindContribution(drive, base));
  const std::set<std::string> drives(added.drives.begin(), added.drives.end());
  Reversion made{.name = added.name};
  Changes changes(base);
  for (const TileVersion& version : added.tiles) {
    CARMAP_ASSIGN_OR_RETURN(const auto now, base.Read(version.tile));
    if (version.is_removed || !now) {
      return absl::FailedPreconditionError(fmt::format(
          "{}: {} joined components, or was joined to another since; it cannot be taken back alone",
          base.name(), added.name));
    }
    CARMAP_ASSIGN_OR_RETURN(const StoredPatch stored, PatchTo(version, base));
    CARMAP_ASSIGN_OR_RETURN(const Patch patch, DecodePatch(stored.patch, base.name()));
    CARMAP_ASSIGN_OR_RETURN(const Patch inverse, DecodePatch(stored.inverse, base.name()));
    CARMAP_ASSIGN_OR_RETURN(Tile without, TileReversion(*now, patch, inverse, drives).Run(made));
    CARMAP_RETURN_IF_ERROR(changes.Put(std::move(without)));
  }
  Commit commit;
  CARMAP_RETURN_IF_ERROR(changes.AddTo(DefaultVocabulary(), commit));
  LoggedChange entry{.kind = "revert",
                     .time = TimeText(),
                     .name = added.name,
                     .drives = added.drives,
                     .component = added.component};
  for (const TileChange& change : commit.tiles) {
    entry.tiles.push_back({change.tile, change.from_version + 1, !change.bytes});
  }
  for (const std::string& id : added.drives) commit.withdrawn.push_back("drive/" + id);
  // A component of which nothing is left goes.
  CARMAP_ASSIGN_OR_RETURN(const std::vector<TileVersion> all, base.reader().ListTiles());
  const bool has_others = std::any_of(all.begin(), all.end(), [&](const TileVersion& tile) {
    const auto changed = std::find_if(entry.tiles.begin(), entry.tiles.end(),
                                      [&](const auto& t) { return t.tile == tile.tile; });
    const bool is_removed = changed != entry.tiles.end() ? changed->is_removed : tile.is_removed;
    return tile.tile.component == added.component && !is_removed;
  });
  if (!has_others) commit.components.emplace_back(added.component, "");
  commit.journal_text = ToJournal(entry);
  made.tiles = entry.tiles;
  CARMAP_ASSIGN_OR_RETURN(made.sequence, base.Apply(commit));
  return made;
}

}  // namespace carmap
