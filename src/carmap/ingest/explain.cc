#include "carmap/ingest/explain.h"

#include <absl/strings/match.h>
#include <absl/strings/numbers.h>
#include <absl/strings/str_split.h>
#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <optional>
#include <utility>

#include "carmap/base/status_macros.h"
#include "carmap/format/tile_codec.h"
#include "carmap/ingest/evidence.h"
#include "carmap/ingest/journal.h"

namespace carmap {
namespace {

std::string NameOf(const TileId& tile) {
  return fmt::format("tile {}/{:016x}", tile.component, tile.cell);
}

/// Which entry of the journal made a version of a tile.
class History {
 public:
  explicit History(std::vector<LoggedChange> log) : log_(std::move(log)) {
    for (const LoggedChange& change : log_) {
      for (const TileVersion& tile : change.tiles) by_version_[{tile.tile, tile.version}] = &change;
    }
  }
  const std::vector<LoggedChange>& log() const { return log_; }

  std::string Told(const TileId& tile, uint64_t version) const {
    const auto found = by_version_.find({tile, version});
    if (found == by_version_.end()) return fmt::format("version {}", version);
    const LoggedChange& change = *found->second;
    return fmt::format("{}  entry {}, {} of {}", change.time, change.sequence, change.kind,
                       change.name);
  }

 private:
  std::vector<LoggedChange> log_;
  std::map<std::pair<TileId, uint64_t>, const LoggedChange*> by_version_;
};

const LeanLandmark* Find(const LeanMap& map, const std::string& drive, uint32_t index) {
  for (const LeanLandmark& landmark : map.landmarks) {
    if (landmark.id.index == index && absl::StartsWith(ToHex(landmark.id.drive), drive)) {
      return &landmark;
    }
  }
  return nullptr;
}

void TellNow(const LeanMap& map, const LeanLandmark& landmark, std::vector<std::string>& lines) {
  std::map<DriveId, size_t> views;
  for (const uint32_t idx : landmark.keyframe_idxs) ++views[map.keyframes[idx].id.drive];
  lines.push_back(fmt::format(
      "landmark {}:{} is seen by {} keyframes, its anchor is "
      "{}:{}, {:.1f} m away",
      ToHex(landmark.id.drive), landmark.id.index, landmark.keyframe_idxs.size(),
      ToHex(map.keyframes[landmark.anchor_idx].id.drive),
      map.keyframes[landmark.anchor_idx].id.index, PositionInAnchor(map, landmark).norm()));
  for (const auto& [drive, count] : views) {
    lines.push_back(fmt::format("  {} keyframes of drive {}", count, ToHex(drive)));
  }
}

/// What each patch of the tile did to the landmark.
absl::Status TellPatches(const TileId& tile, const std::string& drive, uint32_t index,
                         const History& history, const BaseMap& base,
                         std::vector<std::string>& lines) {
  const auto patches = base.reader().ReadPatches(tile, 0);
  if (absl::IsOutOfRange(patches.status())) {
    lines.push_back(fmt::format("  {}: its history was compacted", NameOf(tile)));
    return absl::OkStatus();
  }
  CARMAP_RETURN_IF_ERROR(patches.status());
  bool is_there = false;
  for (const StoredPatch& stored : *patches) {
    CARMAP_ASSIGN_OR_RETURN(const Patch patch, DecodePatch(stored.patch, base.name()));
    const bool is_removed = std::any_of(
        patch.removed_landmarks.begin(), patch.removed_landmarks.end(), [&](const LandmarkId& id) {
          return id.index == index && absl::StartsWith(ToHex(id.drive), drive);
        });
    const LeanLandmark* put = Find(patch.put, drive, index);
    if (put == nullptr && !is_removed) continue;
    const char* what = is_removed ? "removed" : is_there ? "seen again" : "added";
    const std::string views =
        put ? fmt::format(", seen by {} keyframes since", put->keyframe_idxs.size()) : "";
    lines.push_back(fmt::format("  {}: {}{}; {}", history.Told(tile, stored.to_version), what,
                                views, NameOf(tile)));
    is_there = !is_removed;
  }
  return absl::OkStatus();
}

/// What drives that passed saw of it.
absl::Status TellPasses(TileId tile, LandmarkId landmark, const BaseMap& base,
                        std::vector<std::string>& lines) {
  CARMAP_ASSIGN_OR_RETURN(const StoredEvidence stored, ReadEvidence(base.reader(), tile));
  const TileEvidence::Counts counts = stored.evidence.CountsOf(landmark);
  lines.push_back(fmt::format(
      "passes        {} seen, {} missed, {} seen through, of {} in its tile{}", counts.seen,
      counts.missed, counts.seen_through, stored.evidence.pass_count(),
      stored.evidence.IsAwaited(landmark) ? "; one drive alone has seen it so far" : ""));
  return absl::OkStatus();
}

absl::StatusOr<std::vector<std::string>> ExplainLandmark(const std::string& drive, uint32_t index,
                                                         const BaseMap& base) {
  CARMAP_ASSIGN_OR_RETURN(std::vector<LoggedChange> log, ReadLog(base.reader()));
  const History history(std::move(log));
  std::vector<std::string> now, before;
  CARMAP_ASSIGN_OR_RETURN(const std::vector<TileVersion> tiles, base.reader().ListTiles());
  for (const TileVersion& version : tiles) {
    const bool is_of_drive =
        std::any_of(history.log().begin(), history.log().end(), [&](const LoggedChange& change) {
          return std::any_of(change.tiles.begin(), change.tiles.end(),
                             [&](const auto& t) { return t.tile == version.tile; }) &&
                 (change.drives.empty() ||
                  std::any_of(change.drives.begin(), change.drives.end(),
                              [&](const auto& id) { return absl::StartsWith(id, drive); }));
        });
    if (!is_of_drive) continue;
    if (!version.is_removed) {
      CARMAP_ASSIGN_OR_RETURN(const auto tile, base.Read(version.tile));
      if (const LeanLandmark* landmark = tile ? Find(tile->map, drive, index) : nullptr) {
        TellNow(tile->map, *landmark, now);
        CARMAP_RETURN_IF_ERROR(TellPasses(version.tile, landmark->id, base, now));
      }
    }
    CARMAP_RETURN_IF_ERROR(TellPatches(version.tile, drive, index, history, base, before));
  }
  if (now.empty() && !before.empty()) now.push_back("the base does not have it any more");
  now.insert(now.end(), before.begin(), before.end());
  if (!now.empty()) return now;
  return absl::NotFoundError(
      fmt::format("{}: never had a landmark {}:{}; it may have been merged with another's when it "
                  "was added",
                  base.name(), drive, index));
}

absl::StatusOr<std::vector<std::string>> ExplainPlace(const GpsFix& place, const BaseMap& base) {
  constexpr double kNearM = 30;
  CARMAP_ASSIGN_OR_RETURN(std::vector<LoggedChange> log, ReadLog(base.reader()));
  const History history(std::move(log));
  CARMAP_ASSIGN_OR_RETURN(const std::vector<Component> components, base.Components());
  const Eigen::Vector3d p_in_root = EcefFromEnu(place).translation;
  std::vector<std::string> lines;
  for (const Component& component : components) {
    if (!component.grid.is_on_earth) continue;
    CARMAP_ASSIGN_OR_RETURN(const std::vector<TileId> tiles,
                            TilesNear(base.reader(), component, {p_in_root}, kNearM));
    for (const TileId& id : tiles) {
      CARMAP_ASSIGN_OR_RETURN(const auto tile, base.Read(id));
      if (!tile) continue;
      Eigen::Vector3d p_in_tile = RootFromTile(component.grid, id.cell).Inverse() * p_in_root;
      const auto is_near = [&](const Eigen::Vector3d& p) {
        return (p - p_in_tile).head<2>().norm() <= kNearM;
      };
      std::map<DriveId, std::pair<size_t, size_t>> by_drive;
      for (const LeanKeyframe& keyframe : tile->map.keyframes) {
        if (!keyframe.is_stub && is_near(keyframe.map_from_camera.translation)) {
          ++by_drive[keyframe.id.drive].first;
        }
      }
      for (const LeanLandmark& landmark : tile->map.landmarks) {
        if (is_near(landmark.position_in_map)) ++by_drive[landmark.id.drive].second;
      }
      if (by_drive.empty()) continue;
      lines.push_back(
          fmt::format("{}, version {}, within {:.0f} m:", NameOf(id), tile->version, kNearM));
      for (const auto& [drive, counts] : by_drive) {
        lines.push_back(fmt::format("  drive {}: {} keyframes, {} landmarks", ToHex(drive),
                                    counts.first, counts.second));
      }
      for (uint64_t version = 1; version <= tile->version; ++version) {
        lines.push_back(fmt::format("  {}", history.Told(id, version)));
      }
    }
  }
  if (!lines.empty()) return lines;
  return absl::NotFoundError(fmt::format("{}: has nothing within {:.0f} m of {:.6f},{:.6f}",
                                         base.name(), kNearM, place.latitude_deg,
                                         place.longitude_deg));
}

}  // namespace

absl::StatusOr<std::vector<std::string>> Explain(const std::string& what, const BaseMap& base) {
  const std::vector<std::string> landmark = absl::StrSplit(what, ':');
  uint32_t index = 0;
  if (landmark.size() == 2 && !landmark[0].empty() && absl::SimpleAtoi(landmark[1], &index)) {
    return ExplainLandmark(landmark[0], index, base);
  }
  const std::vector<std::string> place = absl::StrSplit(what, ',');
  GpsFix fix;
  if (place.size() == 2 && absl::SimpleAtod(place[0], &fix.latitude_deg) &&
      absl::SimpleAtod(place[1], &fix.longitude_deg) && IsValid(fix)) {
    return ExplainPlace(fix, base);
  }
  return absl::InvalidArgumentError(
      fmt::format("{}: is neither a landmark, DRIVE:INDEX, nor a place, LATITUDE,LONGITUDE", what));
}

}  // namespace carmap
