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
#include "carmap/ingest/evidence.h"
#include "carmap/ingest/journal.h"
#include "carmap/map/by_id.h"

namespace carmap {
namespace {

/// What the drive contributed and was not taken back, in parts or as a whole, the newest first.
absl::StatusOr<std::vector<LoggedChange>> FindContributions(const std::string& drive,
                                                            const std::vector<LoggedChange>& log,
                                                            const BaseMap& base) {
  constexpr size_t kMinDigits = 6;
  if (drive.size() < kMinDigits) {
    return absl::InvalidArgumentError(
        fmt::format("'{}' is too short for a drive's id; write {} digits or more (`carmap base log "
                    "{}` lists them)",
                    drive, kMinDigits, base.name()));
  }
  std::vector<LoggedChange> found;
  std::set<std::string> ids;
  for (const LoggedChange& change : log) {
    std::vector<std::string> named;
    std::copy_if(change.drives.begin(), change.drives.end(), std::back_inserter(named),
                 [&](const std::string& id) { return absl::StartsWith(id, drive); });
    if (named.empty()) continue;
    if (change.kind == "revert") {
      found.clear();
      ids.clear();
    } else if (change.kind == "add") {
      ids.insert(named.begin(), named.end());
      found.insert(found.begin(), change);
    }
  }
  if (ids.size() > 1) {
    return absl::InvalidArgumentError(
        fmt::format("{}: several drives begin with {}; write more digits (`carmap base log {}` "
                    "lists them)",
                    base.name(), drive, base.name()));
  }
  if (!found.empty()) return found;
  if (std::any_of(log.begin(), log.end(),
                  [](const LoggedChange& change) { return change.kind == "lost"; })) {
    return absl::NotFoundError(
        fmt::format("{}: no entry of the journal tells of a drive that begins with {}; some are "
                    "lost, and what they added cannot be taken back",
                    base.name(), drive));
  }
  return absl::NotFoundError(
      fmt::format("{}: no drive of the base begins with {}; `carmap base log "
                  "{}` lists those that were added",
                  base.name(), drive, base.name()));
}

/// Whether a later contribution moved the tile into another component.
bool WasJoined(const TileVersion& tile, const std::vector<LoggedChange>& log) {
  return std::any_of(log.begin(), log.end(), [&](const LoggedChange& change) {
    return change.kind == "add" &&
           std::any_of(change.tiles.begin(), change.tiles.end(), [&](const TileVersion& removed) {
             return removed.is_removed && removed.tile == tile.tile &&
                    removed.version > tile.version;
           });
  });
}

/// The landmark as the keyframes of this map see it, for comparison across maps.
struct Sighting {
  std::vector<KeyframeId> seen_by;
  KeyframeId anchor;
  Eigen::Vector3d p_in_anchor;
  uint8_t drive_count = 0;

  Sighting(const LeanMap& map, const LeanLandmark& landmark)
      : anchor(map.keyframes[landmark.anchor_idx].id),
        p_in_anchor(PositionInAnchor(map, landmark)),
        drive_count(landmark.drive_count) {
    for (const uint32_t idx : landmark.keyframe_idxs) seen_by.push_back(map.keyframes[idx].id);
  }
  bool operator==(const Sighting& other) const {
    return seen_by == other.seen_by && anchor == other.anchor && drive_count == other.drive_count &&
           (p_in_anchor - other.p_in_anchor).norm() < 1e-5;
  }
};

/// One tile without what one contribution made of it. What others have come to rely on stays:
/// landmarks of the contribution that they saw too, and keyframes on which their landmarks hang.
class TileReversion {
 public:
  /// `drives` are those of the contribution, `others` those that remain, in hexadecimal digits.
  TileReversion(const Tile& now, const Patch& patch, const Patch& inverse,
                const std::set<std::string>& drives, const std::set<std::string>& others)
      : now_(now), patch_(patch), inverse_(inverse), drives_(drives), others_(others) {}

  absl::StatusOr<Tile> Run(Reversion& made) {
    Patch undo{.tile = now_.id, .from_version = now_.version, .to_version = now_.version + 1};
    for (const LeanLandmark& before : inverse_.put.landmarks) Restore(before);
    made.landmarks_restored += becomes_.size();
    for (const LeanLandmark& landmark : now_.map.landmarks) {
      if (!becomes_.contains(landmark.id) && !Keep(landmark)) {
        undo.removed_landmarks.push_back(landmark.id);
      }
    }
    StripLists(undo.removed_landmarks);
    for (const LeanKeyframe& keyframe : now_.map.keyframes) {
      const bool is_its_own = drives_.contains(ToHex(keyframe.id.drive));
      if (Goes(keyframe.id)) {
        undo.removed_keyframes.push_back(keyframe.id);
        made.keyframes_removed += is_its_own && !keyframe.is_stub;
      } else {
        made.keyframes_kept += is_its_own && !keyframe.is_stub;
      }
    }
    made.landmarks_removed += undo.removed_landmarks.size();
    undo.put = PutMap();
    return Applied(undo, now_);
  }

 private:
  /// A landmark as it will be, and the map whose keyframes its list means.
  struct Future {
    const LeanMap* of = nullptr;
    LeanLandmark landmark;
  };

  /// Of a drive that was added and not taken back.
  bool Remains(DriveId drive) const { return others_.contains(ToHex(drive)); }

  /// What others changed since stays as they left it; what they removed stays away.
  bool IsAsTheContributionLeftIt(LandmarkId id) const {
    const LeanLandmark* put = FindById(patch_.put.landmarks, id);
    const LeanLandmark* now = FindById(now_.map.landmarks, id);
    if (put == nullptr) return now == nullptr && Remains(id.drive);
    return now != nullptr && Sighting(patch_.put, *put) == Sighting(now_.map, *now);
  }

  /// As it was before, if nobody touched it since and its anchor is still there.
  void Restore(const LeanLandmark& before) {
    const KeyframeId anchor = inverse_.put.keyframes[before.anchor_idx].id;
    if (!IsAsTheContributionLeftIt(before.id)) return;
    if (!Remains(anchor.drive) && !FindById(now_.map.keyframes, anchor)) return;
    becomes_[before.id] = {&inverse_.put, before};
    anchors_.insert(anchor);
  }

  bool WasSeenByTheContribution(LandmarkId id) const {
    const LeanLandmark* put = FindById(patch_.put.landmarks, id);
    const LeanLandmark* before = FindById(inverse_.put.landmarks, id);
    return drives_.contains(ToHex(id.drive)) ||
           (put != nullptr && before != nullptr && put->drive_count > before->drive_count);
  }

  /// With one drive less, if the contribution saw it. False if no other did.
  bool Keep(const LeanLandmark& landmark) {
    if (WasSeenByTheContribution(landmark.id)) {
      if (landmark.drive_count == 1) return false;
      Future& future = becomes_[landmark.id] = {&now_.map, landmark};
      --future.landmark.drive_count;
    }
    anchors_.insert(now_.map.keyframes[landmark.anchor_idx].id);
    return true;
  }

  /// Keyframes of drives that were taken back, unless something hangs on them.
  bool Goes(KeyframeId keyframe) const {
    return !Remains(keyframe.drive) && !anchors_.contains(keyframe);
  }

  void StripLists(const std::vector<LandmarkId>& removed) {
    const auto strip = [&](const LeanMap& map, LeanLandmark& landmark) {
      return std::erase_if(landmark.keyframe_idxs,
                           [&](uint32_t idx) { return Goes(map.keyframes[idx].id); }) > 0;
    };
    for (auto& [id, future] : becomes_) strip(*future.of, future.landmark);
    for (const LeanLandmark& landmark : now_.map.landmarks) {
      if (becomes_.contains(landmark.id) ||
          std::binary_search(removed.begin(), removed.end(), landmark.id)) {
        continue;
      }
      LeanLandmark without = landmark;
      if (strip(now_.map, without)) becomes_[landmark.id] = {&now_.map, without};
    }
  }

  /// The landmarks as they will be with the keyframes that they name, where these stand now.
  LeanMap PutMap() const {
    LeanMap put;
    std::map<KeyframeId, LeanKeyframe> keyframes;
    std::set<DriveId> used;
    for (const auto& [id, future] : becomes_) {
      used.insert(id.drive);
      for (const uint32_t idx : future.landmark.keyframe_idxs) {
        const LeanKeyframe& then = future.of->keyframes[idx];
        const LeanKeyframe* now = FindById(now_.map.keyframes, then.id);
        keyframes.emplace(then.id, now != nullptr ? *now : then);
        used.insert(then.id.drive);
      }
    }
    for (const auto& [id, keyframe] : keyframes) put.keyframes.push_back(keyframe);
    for (const auto& [id, future] : becomes_) {
      LeanLandmark& landmark = put.landmarks.emplace_back(future.landmark);
      const auto place_of = [&](uint32_t idx) {
        return static_cast<uint32_t>(FindById(put.keyframes, future.of->keyframes[idx].id) -
                                     put.keyframes.data());
      };
      for (uint32_t& idx : landmark.keyframe_idxs) idx = place_of(idx);
      landmark.anchor_idx = place_of(landmark.anchor_idx);
      landmark.position_in_map = put.keyframes[landmark.anchor_idx].map_from_camera *
                                 PositionInAnchor(*future.of, future.landmark);
    }
    for (const DriveId& id : used) {
      const LeanDrive* now = FindDrive(now_.map.drives, id);
      put.drives.push_back(now != nullptr ? *now : *FindDrive(inverse_.put.drives, id));
    }
    return put;
  }

  const Tile& now_;
  const Patch &patch_, &inverse_;
  const std::set<std::string>&drives_, &others_;
  std::map<LandmarkId, Future> becomes_;
  std::set<KeyframeId> anchors_;  ///< of all landmarks that stay
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

/// All that contributions of these drives are listed under.
absl::StatusOr<std::vector<std::string>> KeysOf(const std::set<std::string>& drives,
                                                const BaseMap& base) {
  std::vector<std::string> keys;
  for (const std::string& id : drives) {
    CARMAP_RETURN_IF_ERROR(
        base.reader().VisitContributions(KeyOf(id), [&](std::string_view key, std::string_view) {
          keys.emplace_back(key);
          return absl::OkStatus();
        }));
  }
  return keys;
}

/// Whether the component has tiles after these changes.
absl::StatusOr<bool> HasTilesLeft(uint32_t component, const std::vector<TileVersion>& changed,
                                  const BaseMap& base) {
  CARMAP_ASSIGN_OR_RETURN(const std::vector<TileVersion> all, base.reader().ListTiles());
  return std::any_of(all.begin(), all.end(), [&](const TileVersion& tile) {
    const auto change = std::find_if(changed.begin(), changed.end(),
                                     [&](const auto& t) { return t.tile == tile.tile; });
    const bool is_removed = change != changed.end() ? change->is_removed : tile.is_removed;
    return tile.tile.component == component && !is_removed;
  });
}

/// Takes one contribution out of what is changed so far.
absl::Status TakeBack(const LoggedChange& added, const std::vector<LoggedChange>& log,
                      const std::set<std::string>& drives, const std::set<std::string>& others,
                      const BaseMap& base, Changes& changes, Reversion& made) {
  for (const TileVersion& version : added.tiles) {
    CARMAP_ASSIGN_OR_RETURN(const auto now, changes.Read(version.tile));
    if (version.is_removed || WasJoined(version, log)) {
      return absl::FailedPreconditionError(fmt::format(
          "{}: {} joined components, or was joined to another since; it cannot be taken back alone",
          base.name(), added.name));
    }
    if (!now) continue;  // nothing of it is left
    CARMAP_ASSIGN_OR_RETURN(const StoredPatch stored, PatchTo(version, base));
    CARMAP_ASSIGN_OR_RETURN(const Patch patch, DecodePatch(stored.patch, base.name()));
    CARMAP_ASSIGN_OR_RETURN(const Patch inverse, DecodePatch(stored.inverse, base.name()));
    CARMAP_ASSIGN_OR_RETURN(Tile without,
                            TileReversion(*now, patch, inverse, drives, others).Run(made));
    CARMAP_RETURN_IF_ERROR(changes.Put(std::move(without)));
  }
  return absl::OkStatus();
}

/// What these drives saw and missed counts no longer.
absl::Status ForgetPasses(const std::set<std::string>& drives, const BaseMap& base,
                          Commit& commit) {
  std::vector<TileId> tiles;
  CARMAP_RETURN_IF_ERROR(VisitEvidence(base.reader(), [&](TileId tile) { tiles.push_back(tile); }));
  for (const TileId& tile : tiles) {
    CARMAP_ASSIGN_OR_RETURN(const StoredEvidence stored, ReadEvidence(base.reader(), tile));
    TileEvidence without = stored.evidence;
    for (const DriveId& drive : stored.evidence.Drives()) {
      if (drives.contains(ToHex(drive))) without.RemovePass(drive);
    }
    if (!(without == stored.evidence)) ReplaceEvidence(tile, stored.revision, without, commit);
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<Reversion> Revert(const std::string& drive, BaseMap& base) {
  CARMAP_ASSIGN_OR_RETURN(const std::vector<LoggedChange> log, ReadLog(base.reader()));
  CARMAP_ASSIGN_OR_RETURN(const std::vector<LoggedChange> added,
                          FindContributions(drive, log, base));
  std::set<std::string> drives, others = ContributedDrives(log);
  for (const LoggedChange& change : added) {
    drives.insert(change.drives.begin(), change.drives.end());
  }
  for (const std::string& id : drives) others.erase(id);
  Reversion made{.name = added.front().name};
  Changes changes(base);
  for (const LoggedChange& change : added) {
    CARMAP_RETURN_IF_ERROR(TakeBack(change, log, drives, others, base, changes, made));
  }
  Commit commit;
  CARMAP_RETURN_IF_ERROR(changes.AddTo(DefaultVocabulary(), commit));
  LoggedChange entry{.kind = "revert",
                     .time = TimeText(),
                     .name = made.name,
                     .drives = {drives.begin(), drives.end()},
                     .component = added.front().component};
  entry.tiles = VersionsAfter(commit);
  CARMAP_ASSIGN_OR_RETURN(commit.withdrawn, KeysOf(drives, base));
  CARMAP_RETURN_IF_ERROR(ForgetPasses(drives, base, commit));
  // A component of which nothing is left goes.
  for (const LoggedChange& change : added) {
    CARMAP_ASSIGN_OR_RETURN(const bool is_left, HasTilesLeft(change.component, entry.tiles, base));
    const bool is_listed =
        std::any_of(commit.components.begin(), commit.components.end(),
                    [&](const auto& put) { return put.first == change.component; });
    if (!is_left && !is_listed) commit.components.emplace_back(change.component, "");
  }
  commit.journal_text = ToJournal(entry);
  made.tiles = entry.tiles;
  CARMAP_ASSIGN_OR_RETURN(made.sequence, base.Apply(commit));
  return made;
}

}  // namespace carmap
