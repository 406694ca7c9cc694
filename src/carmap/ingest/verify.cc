#include "carmap/ingest/verify.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>
#include <utility>

#include "carmap/base/status_macros.h"
#include "carmap/feature/default_vocabulary.h"
#include "carmap/format/tile_codec.h"
#include "carmap/ingest/evidence.h"
#include "carmap/ingest/journal.h"
#include "carmap/ingest/tile_words.h"
#include "carmap/slam/georeference_map.h"

namespace carmap {
namespace {

/// The tile as its patches make it of nothing. Errors: those of reading and applying them.
absl::StatusOr<Tile> Replayed(const TileVersion& version, const BaseMap& base, size_t& patches) {
  CARMAP_ASSIGN_OR_RETURN(const std::vector<StoredPatch> stored,
                          base.reader().ReadPatches(version.tile, 0));
  Tile tile{version.tile, 0, {}};
  for (const StoredPatch& one : stored) {
    CARMAP_ASSIGN_OR_RETURN(const Patch patch, DecodePatch(one.patch, "a patch"));
    CARMAP_ASSIGN_OR_RETURN(tile, AppliedAndVerified(patch, tile));
    ++patches;
  }
  if (tile.version == version.version) return tile;
  return absl::DataLossError(
      fmt::format("its patches lead to version {} of {}", tile.version, version.version));
}

absl::Status CheckTile(const Tile& tile, const std::set<uint32_t>& components) {
  if (!components.contains(tile.id.component)) {
    return absl::DataLossError("its component is not listed");
  }
  for (const LeanLandmark& landmark : tile.map.landmarks) {
    if (tile.map.keyframes[landmark.anchor_idx].is_stub) {
      return absl::DataLossError("a landmark is anchored at another tile's keyframe");
    }
  }
  return absl::OkStatus();
}

/// Puts back what the patches say, as a new version.
absl::Status Repair(const Tile& replayed, BaseMap& base) {
  Tile again = replayed;
  again.version = replayed.version + 1;
  Tile before = replayed;
  before.version = again.version + 1;
  TileChange change{.tile = again.id, .from_version = replayed.version};
  CARMAP_ASSIGN_OR_RETURN(change.patch, EncodePatch(MakePatch(replayed, again)));
  CARMAP_ASSIGN_OR_RETURN(change.inverse, EncodePatch(MakePatch(again, before)));
  const bool is_removed = again.map.keyframes.empty();
  if (!is_removed) {
    CARMAP_ASSIGN_OR_RETURN(change.bytes, EncodeTile(again));
    change.words = EncodeWords(WordsOf(DefaultVocabulary(), again.map));
  }
  LoggedChange entry{.kind = "repair",
                     .time = TimeText(),
                     .name = "carmap base verify --repair",
                     .component = again.id.component,
                     .tiles = {{again.id, again.version, is_removed}}};
  Commit commit;
  commit.tiles = {std::move(change)};
  commit.journal_text = ToJournal(entry);
  return base.Apply(commit).status();
}

/// Tiles of components that are not listed: where on the Earth a tile lies its cell tells.
std::vector<Component> UnlistedComponents(const std::vector<TileVersion>& tiles,
                                          const std::vector<Component>& listed, int cell_level) {
  std::vector<Component> unlisted;
  for (const TileVersion& tile : tiles) {
    const uint32_t id = tile.tile.component;
    const auto has_id = [&](const Component& component) { return component.id == id; };
    if (tile.is_removed || std::any_of(listed.begin(), listed.end(), has_id) ||
        std::any_of(unlisted.begin(), unlisted.end(), has_id)) {
      continue;
    }
    Component component{.id = id, .grid = {.is_on_earth = true, .level = cell_level}};
    component.grid.is_on_earth = IsCell(component.grid, tile.tile.cell);
    if (component.grid.is_on_earth) component.sigma_m = GpsOptions().sigma_m;
    unlisted.push_back(component);
  }
  return unlisted;
}

/// Drives that the journal tells of and that are listed under no key, so that they could be added
/// twice.
absl::StatusOr<std::vector<std::string>> UnlistedDrives(const std::vector<LoggedChange>& log,
                                                        const MapReader& reader) {
  std::vector<std::string> unlisted;
  for (const std::string& drive : ContributedDrives(log)) {
    bool is_listed = false;
    CARMAP_RETURN_IF_ERROR(
        reader.VisitContributions(KeyOf(drive), [&](std::string_view, std::string_view) {
          is_listed = true;
          return absl::OkStatus();
        }));
    if (!is_listed) unlisted.push_back(drive);
  }
  return unlisted;
}

/// Compares the lists with what tiles and journal tell, and mends them.
absl::Status CheckLists(const std::vector<LoggedChange>& log, Mending mending, BaseMap& base,
                        Verification& found) {
  CARMAP_ASSIGN_OR_RETURN(const std::vector<Component> listed, base.Components());
  CARMAP_ASSIGN_OR_RETURN(const std::vector<TileVersion> tiles, base.reader().ListTiles());
  const std::vector<Component> components = UnlistedComponents(tiles, listed, base.cell_level());
  CARMAP_ASSIGN_OR_RETURN(const std::vector<std::string> drives,
                          UnlistedDrives(log, base.reader()));
  if (components.empty() && drives.empty()) return absl::OkStatus();
  if (mending == Mending::kNone) {
    for (const Component& component : components) {
      found.problems.push_back(fmt::format("component {}: is not listed", component.id));
    }
    for (const std::string& drive : drives) {
      found.problems.push_back(fmt::format("drive {}: is not listed", drive));
    }
    return absl::OkStatus();
  }
  Commit commit;
  for (const Component& component : components) {
    commit.components.emplace_back(component.id, EncodeComponent(component));
  }
  for (const std::string& drive : drives) {
    commit.contributions.emplace_back(KeyOf(drive), "");
  }
  commit.journal_text =
      ToJournal({.kind = "repair", .time = TimeText(), .name = "carmap base verify --repair"});
  found.relisted_components = components.size();
  found.relisted_drives = drives.size();
  return base.Apply(commit).status();
}

void Count(const LeanMap& tile, Verification& found) {
  found.landmarks += tile.landmarks.size();
  found.keyframes += static_cast<size_t>(
      std::count_if(tile.keyframes.begin(), tile.keyframes.end(),
                    [](const LeanKeyframe& keyframe) { return !keyframe.is_stub; }));
}

/// Nothing of it can be made anew: the tile becomes empty, which whoever has it must fetch.
absl::Status Discard(const TileVersion& version, BaseMap& base) {
  Patch patch{
      .tile = version.tile, .from_version = version.version, .to_version = version.version + 1};
  patch.hash = HashOf({});
  TileChange change{.tile = version.tile, .from_version = version.version};
  CARMAP_ASSIGN_OR_RETURN(change.patch, EncodePatch(patch));
  change.inverse = change.patch;
  Commit commit;
  commit.tiles = {std::move(change)};
  commit.journal_text = ToJournal({.kind = "discard",
                                   .time = TimeText(),
                                   .name = "carmap base verify --discard",
                                   .component = version.tile.component,
                                   .tiles = {{version.tile, version.version + 1, true}}});
  CARMAP_RETURN_IF_ERROR(base.Apply(commit).status());
  return base.store().DropPatchesOf(version.tile);
}

/// Components of which no tile is left.
absl::Status EndEmptyComponents(BaseMap& base) {
  CARMAP_ASSIGN_OR_RETURN(const std::vector<Component> listed, base.Components());
  CARMAP_ASSIGN_OR_RETURN(const std::vector<TileVersion> tiles, base.reader().ListTiles());
  Commit commit;
  for (const Component& component : listed) {
    const bool has_tiles = std::any_of(tiles.begin(), tiles.end(), [&](const TileVersion& tile) {
      return tile.tile.component == component.id && !tile.is_removed;
    });
    if (!has_tiles) commit.components.emplace_back(component.id, "");
  }
  if (commit.components.empty()) return absl::OkStatus();
  commit.journal_text =
      ToJournal({.kind = "repair", .time = TimeText(), .name = "carmap base verify --repair"});
  return base.Apply(commit).status();
}

/// What passes saw and missed is not told anywhere else: where it is damaged, passes begin anew.
absl::Status CheckEvidence(Mending mending, BaseMap& base, Verification& found) {
  std::vector<TileId> tiles;
  CARMAP_RETURN_IF_ERROR(VisitEvidence(base.reader(), [&](TileId tile) { tiles.push_back(tile); }));
  Commit commit;
  for (const TileId& tile : tiles) {
    const absl::Status status = ReadEvidence(base.reader(), tile).status();
    if (status.ok()) continue;
    if (!absl::IsDataLoss(status)) return status;
    if (mending == Mending::kNone) {
      found.problems.emplace_back(status.message());
    } else {
      ++found.evidence_dropped;
      CARMAP_RETURN_IF_ERROR(DropEvidence(base.reader(), tile, commit));
    }
  }
  if (commit.withdrawn.empty()) return absl::OkStatus();
  commit.journal_text =
      ToJournal({.kind = "repair", .time = TimeText(), .name = "carmap base verify --repair"});
  return base.Apply(commit).status();
}

/// Looks at tiles one by one, and mends them.
class TileVerifier {
 public:
  TileVerifier(BaseMap& base, Mending mending, std::set<uint32_t> components, Verification& found)
      : base_(base), mending_(mending), components_(std::move(components)), found_(found) {}

  absl::Status Verify(const TileVersion& version) {
    const auto replayed = Replayed(version, base_, found_.patches);
    const bool is_history_short = absl::IsOutOfRange(replayed.status());
    const bool is_history_lost = !replayed.ok() && !is_history_short;
    found_.short_histories += is_history_short && !version.is_removed;
    if (!version.is_removed) {
      ++found_.tiles;
      const auto tile = base_.Read(version.tile);
      absl::Status status = tile.status();
      if (status.ok() && !*tile) status = absl::DataLossError("is not there");
      if (status.ok()) status = CheckTile(**tile, components_);
      if (status.ok() && replayed.ok() && HashOf((*tile)->map) != HashOf(replayed->map)) {
        status = absl::DataLossError("is not what its patches made it");
      }
      if (!status.ok()) return MendTile(version, status, replayed);
      Count((*tile)->map, found_);
    }
    return is_history_lost ? MendHistory(version, replayed.status()) : absl::OkStatus();
  }

 private:
  void AddProblem(const TileVersion& version, const char* what, const absl::Status& status) {
    found_.problems.push_back(fmt::format("tile {}/{:016x}: {}{}", version.tile.component,
                                          version.tile.cell, what, std::string(status.message())));
  }

  absl::Status MendTile(const TileVersion& version, const absl::Status& status,
                        const absl::StatusOr<Tile>& replayed) {
    if (mending_ != Mending::kNone && replayed.ok()) {
      ++found_.repaired;
      Count(replayed->map, found_);
      return Repair(*replayed, base_);
    }
    if (mending_ == Mending::kDiscard) {
      ++found_.discarded;
      return Discard(version, base_);
    }
    AddProblem(version, "", status);
    return absl::OkStatus();
  }

  absl::Status MendHistory(const TileVersion& version, const absl::Status& status) {
    if (mending_ != Mending::kNone) {
      ++found_.histories_cut;
      return base_.store().DropPatchesOf(version.tile);
    }
    AddProblem(version, "history: ", status);
    return absl::OkStatus();
  }

  BaseMap& base_;
  const Mending mending_;
  const std::set<uint32_t> components_;
  Verification& found_;
};

}  // namespace

absl::StatusOr<StoreRepair> RepairStore(const std::filesystem::path& folder) {
  return RepairRocksStore(folder, BaseMap::NewHeader(), ToJournal({.kind = "lost"}));
}

absl::StatusOr<Verification> Verify(BaseMap& base, Mending mending,
                                    const VerifyProgress& progress) {
  Verification found;
  CARMAP_ASSIGN_OR_RETURN(const std::vector<LoggedChange> log, ReadLog(base.reader()));
  found.journal_entries = log.size();
  found.lost_journal_entries = static_cast<size_t>(std::count_if(
      log.begin(), log.end(), [](const LoggedChange& change) { return change.kind == "lost"; }));
  CARMAP_RETURN_IF_ERROR(CheckLists(log, mending, base, found));
  CARMAP_ASSIGN_OR_RETURN(const std::vector<Component> listed, base.Components());
  std::set<uint32_t> components;
  for (const Component& component : listed) components.insert(component.id);
  CARMAP_ASSIGN_OR_RETURN(const std::vector<TileVersion> tiles, base.reader().ListTiles());
  TileVerifier verifier(base, mending, std::move(components), found);
  for (const TileVersion& version : tiles) {
    CARMAP_RETURN_IF_ERROR(verifier.Verify(version));
    if (progress) progress(static_cast<size_t>(&version - tiles.data()) + 1);
  }
  CARMAP_RETURN_IF_ERROR(CheckEvidence(mending, base, found));
  if (mending != Mending::kNone) CARMAP_RETURN_IF_ERROR(EndEmptyComponents(base));
  if (const absl::Status files = base.store().VerifyFiles(); !files.ok()) {
    found.problems.emplace_back(files.message());
  }
  return found;
}

}  // namespace carmap
