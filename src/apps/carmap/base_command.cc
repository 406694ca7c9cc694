#include <fmt/format.h>
#include <fmt/ranges.h>

#include <CLI/App.hpp>
#include <CLI/Validators.hpp>
#include <algorithm>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "apps/carmap/base_picture.h"
#include "apps/carmap/commands.h"
#include "apps/carmap/outputs.h"
#include "apps/carmap/patch_files.h"
#include "apps/carmap/reports.h"
#include "carmap/base/file.h"
#include "carmap/base/progress.h"
#include "carmap/base/status_macros.h"
#include "carmap/base/stopwatch.h"
#include "carmap/format/lean_codec.h"
#include "carmap/format/tile_codec.h"
#include "carmap/ingest/adjust.h"
#include "carmap/ingest/base_map.h"
#include "carmap/ingest/changes.h"
#include "carmap/ingest/contribute.h"
#include "carmap/ingest/explain.h"
#include "carmap/ingest/journal.h"
#include "carmap/ingest/revert.h"
#include "carmap/ingest/verify.h"

namespace carmap {
namespace {

struct Arguments {
  std::string base, out, report, picture, patches, drive, what;
  std::vector<std::string> segments;
  std::optional<uint32_t> component;
  size_t kept_patches = 16;
  bool accept_suspect = false, json = false, repair = false, discard = false;
};

using Run = absl::StatusOr<ExitCode> (*)(const Arguments&);

absl::StatusOr<ExitCode> Init(const Arguments& arguments) {
  CARMAP_ASSIGN_OR_RETURN(const auto base, BaseMap::Create(arguments.base));
  fmt::print("base          {}, empty; `carmap base add {} SEGMENT.cmap` fills it\n",
             arguments.base, arguments.base);
  return kSuccess;
}

// Adding.

struct Added {
  Contribution contribution;
  double wall_s = 0;
};

absl::StatusOr<Added> AddSegment(const std::string& path, const Arguments& arguments,
                                 BaseMap& base) {
  const Stopwatch watch;
  ContributeOptions options;
  options.accept_suspect = arguments.accept_suspect;
  CARMAP_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(path, kMaxLeanFileBytes));
  absl::StatusOr<Contribution> made;
  if (IsDiff(bytes)) {
    CARMAP_ASSIGN_OR_RETURN(const MapDiff diff, DecodeDiff(bytes, path));
    made = Contribute(diff, NameOf(path), base, options);
  } else {
    CARMAP_ASSIGN_OR_RETURN(const LeanMap segment, DecodeLeanMap(bytes, path));
    made = Contribute(segment, NameOf(path), base, options);
  }
  if (!made.ok()) return WithName(path, made.status());
  return Added{*std::move(made), watch.ElapsedMs() * 1e-3};
}

void PrintAdded(const std::string& path, const Added& added) {
  const Contribution& made = added.contribution;
  std::string where = fmt::format("component {}", made.component);
  if (made.is_new_component && made.joined.empty()) {
    where += ", new: it touches nothing that was there";
  }
  if (made.is_new_component && !made.joined.empty()) where += ", new, on the Earth";
  if (!made.joined.empty()) {
    where += fmt::format(", to which it joins {}", fmt::join(made.joined, ", "));
  }
  fmt::print("added         {}: {}; {:.2f} s\n", path, where, added.wall_s);
  for (const uint32_t other : made.contradicting) {
    fmt::print("  apart       component {} resembles it, but does not fit\n", other);
  }
  if (made.fit) {
    const FitReport& fit = *made.fit;
    fmt::print(
        "  fit         {} overlap, {:.2f} m (median) from where the base's landmarks put them; "
        "lengths times {:.4f}, bent by {:.1f} % at most\n",
        Count(fit.segment_keyframes_overlapping, "keyframe"), fit.median_misfit_m, fit.scale,
        100 * fit.largest_strain);
  }
  fmt::print("  new         {} of {}, {} of {}", made.keyframes_added,
             Count(made.keyframes, "keyframe"), made.landmarks_added,
             Count(made.landmarks, "landmark"));
  if (made.landmarks_replaced > 0) {
    fmt::print("; {} that fewer drives saw made way", made.landmarks_replaced);
  }
  fmt::print("\n");
  if (made.seen + made.missed + made.seen_through > 0) {
    fmt::print("  passes by   {} seen, {} missed, {} seen through\n", Count(made.seen, "landmark"),
               made.missed, made.seen_through);
  }
  if (made.is_doubted) {
    fmt::print(
        "  doubted     it saw so little of what it should have seen that misses do not count\n");
  }
  if (made.sightings_ignored > 0) {
    fmt::print("  too old     what it saw of {}, whose patches since are no longer kept\n",
               Count(made.sightings_ignored, "tile"));
  }
  if (made.landmarks_confirmed > 0) {
    fmt::print("  confirmed   {} that one drive alone had told of\n",
               Count(made.landmarks_confirmed, "landmark"));
  }
  if (made.landmarks_refuted > 0) {
    fmt::print("  refuted     {} that one drive alone had told of, and others did not see\n",
               Count(made.landmarks_refuted, "landmark"));
  }
  if (made.landmarks_returned > 0) {
    fmt::print("  returned    {} of the new had vanished before\n", made.landmarks_returned);
  }
  if (made.landmarks_vanished > 0) {
    fmt::print("  vanished    {}, by this drive and others before\n",
               Count(made.landmarks_vanished, "landmark"));
  }
  fmt::print("  tiles       {} changed; patches of {}\n", made.tiles.size(),
             BytesText(static_cast<double>(made.patch_bytes)));
}

nlohmann::ordered_json ToJson(const std::string& path, const Added& added) {
  const Contribution& made = added.contribution;
  nlohmann::ordered_json json = {{"segment", path},
                                 {"drives", nlohmann::ordered_json::array()},
                                 {"component", made.component},
                                 {"is_new_component", made.is_new_component},
                                 {"joined_components", made.joined},
                                 {"contradicting_components", made.contradicting},
                                 {"keyframes", made.keyframes},
                                 {"keyframes_added", made.keyframes_added},
                                 {"landmarks", made.landmarks},
                                 {"landmarks_added", made.landmarks_added},
                                 {"landmarks_replaced", made.landmarks_replaced},
                                 {"seen", made.seen},
                                 {"missed", made.missed},
                                 {"seen_through", made.seen_through},
                                 {"is_doubted", made.is_doubted},
                                 {"sightings_ignored", made.sightings_ignored},
                                 {"landmarks_confirmed", made.landmarks_confirmed},
                                 {"landmarks_refuted", made.landmarks_refuted},
                                 {"landmarks_returned", made.landmarks_returned},
                                 {"landmarks_vanished", made.landmarks_vanished},
                                 {"tiles_changed", made.tiles.size()},
                                 {"patch_bytes", made.patch_bytes},
                                 {"constraint_bytes", made.constraint_bytes},
                                 {"journal_entry", made.sequence},
                                 {"wall_s", added.wall_s}};
  for (const DriveId& drive : made.drives) json["drives"].push_back(ToHex(drive));
  if (made.fit) json["fit"] = ToJson(*made.fit);
  if (made.gps_offset_m) json["gps_offset_m"] = *made.gps_offset_m;
  return json;
}

/// Whether the segment's fixes are about where it was fitted; if not, says so on standard error.
bool CheckGpsOffset(const std::string& path, const Contribution& made) {
  constexpr double kMaxOffsetM = 25;  // more than GPS errs in the mean of a drive, in a town
  if (!made.gps_offset_m || *made.gps_offset_m <= kMaxOffsetM) return true;
  PrintProblem(fmt::format(
      "{}: was added, but its fixes lie {:.0f} m (median) from where the base's landmarks put it; "
      "the fixes of one of the two are wrong",
      path, *made.gps_offset_m));
  return false;
}

/// Each segment by itself: one that is refused costs none of the others.
absl::StatusOr<ExitCode> Add(const Arguments& arguments) {
  std::vector<std::string> inputs = arguments.segments;
  AddFiles(FoldersOfBase(arguments.base), inputs);
  CARMAP_RETURN_IF_ERROR(CheckOutputs({arguments.report, arguments.picture}, inputs));
  CARMAP_ASSIGN_OR_RETURN(const auto base, BaseMap::Open(arguments.base, StoreAccess::kReadWrite));
  nlohmann::ordered_json report = {{"added", nlohmann::ordered_json::array()},
                                   {"refused", nlohmann::ordered_json::array()}};
  std::vector<DriveId> drives;
  bool agrees_with_gps = true;
  OutputFiles files;
  Progress progress("adding", arguments.segments.size());
  for (const std::string& path : arguments.segments) {
    const auto added = AddSegment(path, arguments, *base);
    if (added.ok()) {
      PrintAdded(path, *added);
      agrees_with_gps &= CheckGpsOffset(path, added->contribution);
      std::fflush(stdout);  // it is in the base, whatever happens to this process
      files.Write(arguments.patches, [&] {
        return WritePatches(base->reader(), added->contribution.tiles, arguments.patches);
      });
      report["added"].push_back(ToJson(path, *added));
      drives.insert(drives.end(), added->contribution.drives.begin(),
                    added->contribution.drives.end());
    } else {
      PrintProblem(std::string(added.status().message()));
      report["refused"].push_back(
          {{"segment", path}, {"reason", std::string(added.status().message())}});
    }
    if (arguments.segments.size() > 1) {
      progress.Update(report["added"].size() + report["refused"].size());
    }
  }
  report["peak_rss_mb"] = PeakMemoryMb();
  files.Write(arguments.report, [&] { return WriteReport(arguments.report, report); });
  files.Write(arguments.picture,
              [&] { return WriteBasePicture(arguments.picture, *base, {}, drives); });
  const bool is_written = files.Finish();
  if (report["added"].empty()) return kError;
  return is_written && report["refused"].empty() && agrees_with_gps ? kSuccess : kIncomplete;
}

// Looking.

struct ComponentSize {
  Component component;
  size_t tiles = 0, damaged = 0, keyframes = 0, landmarks = 0;
  std::set<DriveId> drives;
  uint64_t bytes = 0;
};

/// Of tiles that cannot be read it says so on standard error, and leaves them out.
absl::StatusOr<std::vector<ComponentSize>> Measure(const BaseMap& base) {
  CARMAP_ASSIGN_OR_RETURN(const std::vector<Component> components, base.Components());
  CARMAP_ASSIGN_OR_RETURN(const std::vector<TileVersion> tiles, base.reader().ListTiles());
  std::vector<ComponentSize> sizes;
  for (const Component& component : components) {
    ComponentSize& size = sizes.emplace_back(ComponentSize{.component = component});
    for (const TileVersion& version : tiles) {
      if (version.tile.component != component.id || version.is_removed) continue;
      const auto read = base.Read(version.tile);
      if (absl::IsDataLoss(read.status())) {
        PrintProblem(std::string(read.status().message()));
        ++size.damaged;
        continue;
      }
      CARMAP_RETURN_IF_ERROR(read.status());
      const Tile& tile = **read;
      CARMAP_ASSIGN_OR_RETURN(const auto stored, base.reader().ReadTile(version.tile));
      ++size.tiles;
      size.bytes += stored->bytes.size();
      size.landmarks += tile.map.landmarks.size();
      for (const LeanKeyframe& keyframe : tile.map.keyframes) size.keyframes += !keyframe.is_stub;
      for (const LeanDrive& drive : tile.map.drives) size.drives.insert(drive.id);
    }
  }
  return sizes;
}

nlohmann::ordered_json ToJson(const ComponentSize& size) {
  return {{"component", size.component.id},    {"on_earth", size.component.grid.is_on_earth},
          {"sigma_m", size.component.sigma_m}, {"tiles", size.tiles},
          {"keyframes", size.keyframes},       {"landmarks", size.landmarks},
          {"drives", size.drives.size()},      {"bytes", size.bytes}};
}

absl::StatusOr<ExitCode> Info(const Arguments& arguments) {
  CARMAP_RETURN_IF_ERROR(CheckOutputs({arguments.picture}, FoldersOfBase(arguments.base)));
  CARMAP_ASSIGN_OR_RETURN(const auto base, BaseMap::Open(arguments.base, StoreAccess::kReadOnly));
  CARMAP_ASSIGN_OR_RETURN(const std::vector<ComponentSize> sizes, Measure(*base));
  CARMAP_ASSIGN_OR_RETURN(const std::vector<LoggedChange> log, ReadLog(base->reader()));
  if (arguments.json) {
    nlohmann::ordered_json json = {{"journal_entries", log.size()},
                                   {"cell_level", base->cell_level()},
                                   {"components", nlohmann::ordered_json::array()}};
    for (const ComponentSize& size : sizes) json["components"].push_back(ToJson(size));
    fmt::print("{}", JsonText(json));
  } else {
    fmt::print("base          {}, {}, {} in the journal\n", arguments.base,
               Count(sizes.size(), "component"), log.size());
    for (const ComponentSize& size : sizes) {
      fmt::print("component {:<4}{}: {}, {}, {}, {}, {}\n", size.component.id,
                 size.component.grid.is_on_earth ? "on the Earth" : "without GPS",
                 Count(size.drives.size(), "drive"), Count(size.tiles, "tile"),
                 Count(size.keyframes, "keyframe"), Count(size.landmarks, "landmark"),
                 BytesText(static_cast<double>(size.bytes)));
    }
  }
  OutputFiles files;
  files.Write(arguments.picture,
              [&] { return WriteBasePicture(arguments.picture, *base, arguments.component, {}); });
  const bool is_whole = std::all_of(sizes.begin(), sizes.end(),
                                    [](const ComponentSize& size) { return size.damaged == 0; });
  return files.Finish() && is_whole ? kSuccess : kIncomplete;
}

absl::StatusOr<ExitCode> Log(const Arguments& arguments) {
  CARMAP_ASSIGN_OR_RETURN(const auto base, BaseMap::Open(arguments.base, StoreAccess::kReadOnly));
  if (arguments.json) {
    auto json = nlohmann::ordered_json::array();
    for (uint64_t first = 1;; first = json.size() + 1) {
      CARMAP_ASSIGN_OR_RETURN(const auto entries, base->reader().ReadJournal(first, 256));
      for (const JournalEntry& entry : entries) {
        auto parsed = nlohmann::ordered_json::parse(entry.text, nullptr, false);
        json.push_back({{"entry", entry.sequence}, {"change", std::move(parsed)}});
      }
      if (entries.empty()) break;
    }
    fmt::print("{}", JsonText(json));
    return kSuccess;
  }
  CARMAP_ASSIGN_OR_RETURN(const std::vector<LoggedChange> log, ReadLog(base->reader()));
  for (const LoggedChange& change : log) {
    fmt::print("{:>6}  {}  {:<7}component {}, {}: {}", change.sequence, change.time, change.kind,
               change.component, Count(change.tiles.size(), "tile"), OneLine(change.name));
    if (change.kind == "add") {
      fmt::print(", {} and {} new", Count(change.keyframes_added, "keyframe"),
                 Count(change.landmarks_added, "landmark"));
    }
    fmt::print("\n");
    for (const std::string& drive : change.drives) fmt::print("        drive {}\n", drive);
  }
  if (log.empty()) fmt::print("nothing was added to {} yet\n", arguments.base);
  return kSuccess;
}

/// What of a store is damaged, so that no single tile is concerned, is made anew from the rest.
absl::Status RestoreStore(const Arguments& arguments) {
  CARMAP_ASSIGN_OR_RETURN(const StoreRepair made, RepairStore(arguments.base));
  fmt::print("restored      the store from what can be read of it; its files as they were: {}\n",
             made.damaged.string());
  if (made.lost_commits > 0) {
    PrintProblem(fmt::format(
        "{}: the newest {} lost; add their maps again", arguments.base,
        made.lost_commits == 1 ? "commit is" : fmt::format("{} commits are", made.lost_commits)));
  }
  return absl::OkStatus();
}

std::string Entries(size_t count) {
  return count == 1 ? "1 entry" : fmt::format("{} entries", count);
}

void PrintVerified(const Verification& found) {
  fmt::print("verified      {}, {}, {}; {} and {} in the journal\n", Count(found.tiles, "tile"),
             Count(found.keyframes, "keyframe"), Count(found.landmarks, "landmark"),
             found.patches == 1 ? "1 patch" : fmt::format("{} patches", found.patches),
             Entries(found.journal_entries));
  if (found.repaired > 0) {
    fmt::print("repaired      {}, from its patches\n", Count(found.repaired, "tile"));
  }
  if (found.evidence_dropped > 0) {
    fmt::print("forgotten     what passes saw and missed of {}\n",
               Count(found.evidence_dropped, "tile"));
  }
  if (found.histories_cut > 0) {
    fmt::print("cut           the history of {}: what is older cannot be taken back or told\n",
               Count(found.histories_cut, "tile"));
  }
  if (found.short_histories > 0) {
    fmt::print("history       of {} begins later, as it was compacted or is lost\n",
               Count(found.short_histories, "tile"));
  }
  if (found.discarded > 0) {
    fmt::print("discarded     {}: map the road again\n", Count(found.discarded, "tile"));
  }
  if (found.relisted_components + found.relisted_drives > 0) {
    fmt::print("listed again  {}, {}\n", Count(found.relisted_components, "component"),
               Count(found.relisted_drives, "drive"));
  }
  if (found.lost_journal_entries > 0) {
    fmt::print("lost          {} of the journal: what they added stays, and cannot be taken back\n",
               Entries(found.lost_journal_entries));
  }
}

absl::StatusOr<Verification> VerifyOnce(const Arguments& arguments) {
  Mending mending = arguments.repair ? Mending::kRepair : Mending::kNone;
  if (arguments.discard) mending = Mending::kDiscard;
  const StoreAccess access =
      mending == Mending::kNone ? StoreAccess::kReadOnly : StoreAccess::kReadWrite;
  CARMAP_ASSIGN_OR_RETURN(const auto base, BaseMap::Open(arguments.base, access));
  CARMAP_ASSIGN_OR_RETURN(const std::vector<TileVersion> tiles, base->reader().ListTiles());
  Progress progress("verifying", tiles.size());
  return carmap::Verify(*base, mending, [&](size_t done) { progress.Update(done); });
}

absl::StatusOr<ExitCode> Verify(const Arguments& arguments) {
  const bool mends = arguments.repair || arguments.discard;
  auto found = VerifyOnce(arguments);
  if (mends && (absl::IsDataLoss(found.status()) || (found.ok() && !found->problems.empty()))) {
    CARMAP_RETURN_IF_ERROR(RestoreStore(arguments));
    found = VerifyOnce(arguments);
  }
  CARMAP_RETURN_IF_ERROR(found.status());
  PrintVerified(*found);
  for (const std::string& problem : found->problems) {
    PrintProblem(fmt::format("{}: {}", arguments.base, problem));
  }
  if (found->problems.empty()) return kSuccess;
  PrintProblem(mends ? fmt::format("{}: these cannot be made anew; `carmap base verify {} "
                                   "--discard` removes such tiles, so that their road can be "
                                   "mapped again",
                                   arguments.base, arguments.base)
                     : fmt::format("{}: damaged; `carmap base verify {} --repair` makes anew what "
                                   "its history still tells",
                                   arguments.base, arguments.base));
  return kError;
}

absl::Status NoSuchComponent(const Arguments& arguments) {
  return absl::NotFoundError(
      fmt::format("{}: has no such component; `carmap base info {}` lists them", arguments.base,
                  arguments.base));
}

absl::StatusOr<ExitCode> Export(const Arguments& arguments) {
  CARMAP_RETURN_IF_ERROR(CheckOutputs({arguments.out}, FoldersOfBase(arguments.base)));
  CARMAP_ASSIGN_OR_RETURN(const auto base, BaseMap::Open(arguments.base, StoreAccess::kReadOnly));
  CARMAP_ASSIGN_OR_RETURN(const std::vector<ComponentSize> sizes, Measure(*base));
  const auto chosen =
      arguments.component
          ? std::find_if(sizes.begin(), sizes.end(),
                         [&](const auto& s) { return s.component.id == *arguments.component; })
          : std::max_element(sizes.begin(), sizes.end(), [](const auto& a, const auto& b) {
              return a.landmarks < b.landmarks;
            });
  if (chosen == sizes.end()) {
    return NoSuchComponent(arguments);
  }
  CARMAP_ASSIGN_OR_RETURN(const MapView view, WholeComponent(*base, chosen->component));
  CARMAP_ASSIGN_OR_RETURN(const std::string bytes, EncodeLeanMap(view.map()));
  CARMAP_RETURN_IF_ERROR(WriteFileAtomically(arguments.out, bytes));
  fmt::print("exported      component {} to {}: {}, {}, {}\n", chosen->component.id, arguments.out,
             Count(view.map().keyframes.size(), "keyframe"),
             Count(view.map().landmarks.size(), "landmark"),
             BytesText(static_cast<double>(bytes.size())));
  if (!arguments.component && sizes.size() > 1) {
    fmt::print("  the largest of {} components; --component chooses another\n", sizes.size());
  }
  return kSuccess;
}

absl::StatusOr<ExitCode> Revert(const Arguments& arguments) {
  CARMAP_ASSIGN_OR_RETURN(const auto base, BaseMap::Open(arguments.base, StoreAccess::kReadWrite));
  CARMAP_ASSIGN_OR_RETURN(const Reversion made, carmap::Revert(arguments.drive, *base));
  fmt::print("reverted      {}: {} and {} removed, {} as before; {} changed\n", made.name,
             Count(made.keyframes_removed, "keyframe"), Count(made.landmarks_removed, "landmark"),
             Count(made.landmarks_restored, "landmark"), Count(made.tiles.size(), "tile"));
  if (made.keyframes_kept > 0) {
    fmt::print("  kept        {}, on which landmarks of other drives hang\n",
               Count(made.keyframes_kept, "keyframe"));
  }
  return kSuccess;
}

// Maintaining.

void PrintAdjusted(const Adjustment& made) {
  if (!made.sequence) {
    fmt::print("component {:<4}as it was: {} of {} contributions would move by {:.3f} m at most\n",
               made.component, Count(made.keyframes, "keyframe"), made.contributions,
               made.largest_move_m);
    return;
  }
  fmt::print("component {:<4}{} of {} contributions moved by {:.2f} m (median), {:.2f} m at most\n",
             made.component, Count(made.keyframes, "keyframe"), made.contributions,
             made.median_move_m, made.largest_move_m);
  fmt::print(
      "  measured    {} and {}: {:.2f} of a standard deviation off (root mean square), before "
      "{:.2f}\n",
      Count(made.steps, "step"), Count(made.anchors, "anchor"), made.misfit_after,
      made.misfit_before);
  fmt::print("  tiles       {} changed; patches of {}\n", made.tiles.size(),
             BytesText(static_cast<double>(made.patch_bytes)));
}

nlohmann::ordered_json ToJson(const Adjustment& made) {
  return {{"component", made.component},
          {"keyframes", made.keyframes},
          {"contributions", made.contributions},
          {"steps", made.steps},
          {"anchors", made.anchors},
          {"misfit_before", made.misfit_before},
          {"misfit_after", made.misfit_after},
          {"median_move_m", made.median_move_m},
          {"largest_move_m", made.largest_move_m},
          {"tiles_changed", made.tiles.size()},
          {"patch_bytes", made.patch_bytes},
          {"journal_entry", made.sequence ? nlohmann::ordered_json(*made.sequence) : nullptr}};
}

/// Each component by itself: one that is refused costs none of the others.
absl::StatusOr<ExitCode> Adjust(const Arguments& arguments) {
  CARMAP_RETURN_IF_ERROR(
      CheckOutputs({arguments.report, arguments.picture}, FoldersOfBase(arguments.base)));
  CARMAP_ASSIGN_OR_RETURN(const auto base, BaseMap::Open(arguments.base, StoreAccess::kReadWrite));
  CARMAP_ASSIGN_OR_RETURN(std::vector<Component> components, base->Components());
  if (arguments.component) {
    std::erase_if(components, [&](const Component& c) { return c.id != *arguments.component; });
    if (components.empty()) return NoSuchComponent(arguments);
  }
  if (components.empty()) fmt::print("{} is empty: nothing to adjust\n", arguments.base);
  nlohmann::ordered_json report = {{"adjusted", nlohmann::ordered_json::array()},
                                   {"refused", nlohmann::ordered_json::array()}};
  Progress progress("adjusting", components.size());
  for (const Component& component : components) {
    const auto made = carmap::Adjust(component, *base);
    if (made.ok()) {
      PrintAdjusted(*made);
      std::fflush(stdout);
      report["adjusted"].push_back(ToJson(*made));
    } else {
      PrintProblem(std::string(made.status().message()));
      report["refused"].push_back(
          {{"component", component.id}, {"reason", std::string(made.status().message())}});
    }
    progress.Update(report["adjusted"].size() + report["refused"].size());
  }
  OutputFiles files;
  files.Write(arguments.report, [&] { return WriteReport(arguments.report, report); });
  files.Write(arguments.picture,
              [&] { return WriteBasePicture(arguments.picture, *base, arguments.component, {}); });
  const bool is_written = files.Finish();
  if (report["adjusted"].empty() && !report["refused"].empty()) return kError;
  return is_written && report["refused"].empty() ? kSuccess : kIncomplete;
}

absl::StatusOr<ExitCode> Compact(const Arguments& arguments) {
  CARMAP_ASSIGN_OR_RETURN(const auto base, BaseMap::Open(arguments.base, StoreAccess::kReadWrite));
  CARMAP_RETURN_IF_ERROR(base->store().DropPatches(arguments.kept_patches));
  fmt::print(
      "compacted     {}: each tile has its newest {} at most\n", arguments.base,
      arguments.kept_patches == 1 ? "patch" : fmt::format("{} patches", arguments.kept_patches));
  return kSuccess;
}

absl::StatusOr<ExitCode> Explain(const Arguments& arguments) {
  CARMAP_ASSIGN_OR_RETURN(const auto base, BaseMap::Open(arguments.base, StoreAccess::kReadOnly));
  CARMAP_ASSIGN_OR_RETURN(const std::vector<std::string> lines,
                          carmap::Explain(arguments.what, *base));
  for (const std::string& line : lines) fmt::print("{}\n", line);
  return kSuccess;
}

// The command line.

CLI::App* AddAction(CLI::App& base, const char* name, const char* what, Run run,
                    const std::shared_ptr<Arguments>& arguments, Command& chosen) {
  CLI::App* action = base.add_subcommand(name, what);
  action->add_option("BASE", arguments->base, "Folder of the base map")->required();
  action->callback(
      [arguments, run, &chosen] { chosen = [arguments, run] { return run(*arguments); }; });
  return action;
}

constexpr const char* kFooter =
    R"(A base is a folder that holds the map of many drives: in tiles, with the history of each. Segments are
fitted to what is there; what touches nothing becomes a component of its own until a drive connects
the two. Each command reads and writes only the tiles that it needs. Nothing that a command reported
as added is lost, whatever happens to the machine. One command at a time may change a base; others
may look at it meanwhile.

Example:
  carmap base init town.base
  carmap base add town.base monday.cmap tuesday.cmap
  carmap base info town.base --picture town.png
  carmap localize wednesday --map town.base

`carmap base COMMAND --help` explains each.)";

}  // namespace

void AddBaseCommand(CLI::App& app, Command& chosen) {
  CLI::App* base = app.add_subcommand("base", "Keep a base map that grows with each drive");
  base->require_subcommand(1);
  base->footer(kFooter);
  const auto arguments = std::make_shared<Arguments>();

  AddAction(*base, "init", "Make an empty base", Init, arguments, chosen)
      ->footer(
          "The folder must not be there yet, or be empty.\n\n"
          "Exit codes: 0 done, 1 error, 2 wrong usage");

  CLI::App* add = AddAction(*base, "add", "Add segments", Add, arguments, chosen);
  add->add_option("SEGMENT", arguments->segments,
                  "Maps of drives (.cmap), or parts that `carmap drive` published (.cmdiff)")
      ->required();
  add->add_option("--patches", arguments->patches,
                  "Folder for the patches of the tiles that change, for vehicles that drive "
                  "meanwhile (`carmap drive --patches`)")
      ->type_name("FOLDER");
  add->add_flag("--accept-suspect", arguments->accept_suspect,
                "Take also maps of drives that `carmap map` called suspect");
  add->add_option("--report", arguments->report, "Write what became of each as JSON (m, bytes, s)")
      ->type_name("R.json");
  add->add_option("--picture", arguments->picture, "Draw the base from above, with what was added")
      ->type_name("P.png");
  add->footer(
      R"(Each segment is added whole or not at all, one after the other; one that is refused costs none of the
others. Its place is looked for by its GPS fixes, without them by what its keyframes see. The base's
keyframes stay and the segment bends to them; what both saw is kept once; keyframes are added only
where the base has none. A segment that contradicts the base, that fits in two places, or whose
drive is suspect, is refused with the reason.

What is far from its fixes once it is fitted is added, and a line says so: one of the two is wrong.

What a part of `carmap drive` saw and missed counts as a pass of its drive, once a drive. A landmark that several
drives should have seen and did not, or saw through, is taken to have vanished and goes, with what
stood around it; what a single drive told of and others would hardly have missed goes too.

Exit codes: 0 done, 1 nothing was added (or only standard output cannot be written; `carmap base log`
tells), 2 wrong usage, 3 some were added but not all, fixes contradict the base, or a file could not be
written)");

  CLI::App* info = AddAction(*base, "info", "Say what a base holds", Info, arguments, chosen);
  info->add_flag("--json", arguments->json, "Print JSON");
  info->add_option("--component", arguments->component, "Draw this one (default: the largest)")
      ->type_name("N");
  info->add_option("--picture", arguments->picture, "Draw a component from above, with its tiles")
      ->type_name("P.png");
  info->footer(
      "Exit codes: 0 done, 1 error, 2 wrong usage, 3 a tile is damaged or the picture could not be "
      "written");

  CLI::App* log = AddAction(*base, "log", "Tell who changed what, when", Log, arguments, chosen);
  log->add_flag("--json", arguments->json, "Print JSON, with all tiles and versions");
  log->footer("Exit codes: 0 done, 1 error, 2 wrong usage");

  AddBaseChanges(*base, chosen);

  CLI::App* verify =
      AddAction(*base, "verify", "Check a base, tile by tile", Verify, arguments, chosen);
  verify->add_flag("--repair", arguments->repair,
                   "Make damaged tiles anew, where their history is whole");
  verify->add_flag("--discard", arguments->discard,
                   "The same, and remove tiles that cannot be made anew");
  verify->footer(
      R"(Reads every tile and every patch: a tile must be readable, consistent, and what its patches made it.
With --repair a base of which more than tiles is damaged is restored from what can still be read, too; its
files as they were stay beside it, in rocksdb.damaged.1, to be removed once all is well.

Exit codes: 0 sound (or all repaired), 1 damaged, or an error, 2 wrong usage)");

  CLI::App* export_ =
      AddAction(*base, "export", "Write a component as one map file", Export, arguments, chosen);
  export_->add_option("--out", arguments->out, "The map to write")->required()->type_name("M.cmap");
  export_->add_option("--component", arguments->component, "Which (default: the largest)")
      ->type_name("N");
  export_->footer(
      "The map's frame has its origin at a tile's centre: x east, y down, z north, metres.\n\n"
      "Exit codes: 0 done, 1 error, 2 wrong usage");

  CLI::App* revert =
      AddAction(*base, "revert", "Take a contribution back", Revert, arguments, chosen);
  revert
      ->add_option("DRIVE", arguments->drive, "Its drive: first digits of the id that `log` tells")
      ->required();
  revert->footer(
      R"(What nobody touched since becomes what it was before, to the last bit. Of what others changed later,
what the drive alone saw goes; keyframes of it on which landmarks of others hang stay. The history
keeps both steps. What joined components, or was joined to another since, cannot be taken back alone, nor can
what is older than the patches that `compact` kept.

Exit codes: 0 done, 1 error (nothing is changed, unless only standard output cannot be written), 2
wrong usage)");

  CLI::App* adjust = AddAction(*base, "adjust", "Let all drives share the misfit of closed loops",
                               Adjust, arguments, chosen);
  adjust
      ->add_option("--component", arguments->component, "Adjust this one (default: each by itself)")
      ->type_name("N");
  adjust->add_option("--report", arguments->report, "Write what became of each as JSON (m, bytes)")
      ->type_name("R.json");
  adjust->add_option("--picture", arguments->picture, "Draw a component from above, as it is then")
      ->type_name("P.png");
  adjust->footer(
      R"(While drives are added the base stays and each segment bends to it, so that the last drive around a
block takes all of the misfit. This moves all keyframes to where every drive's own steps, what held each
drive to the base, and the fixes of all drives agree best; landmarks ride on their keyframes. Worth its
while after drives have closed loops, or when many drives know better than the first where on the Earth
the road is. Vehicles get it as patches of poses.

A component that would move by more than 25 m is left as it is: its fixes contradict its drives.

Exit codes: 0 done, or nothing to move, 1 error or refused (nothing is changed, unless only standard output
cannot be written; `carmap base log` tells), 2 wrong usage, 3 some components were refused, or a file could
not be written)");

  CLI::App* compact = AddAction(*base, "compact", "Forget old patches", Compact, arguments, chosen);
  compact
      ->add_option("--keep", arguments->kept_patches,
                   "So many of the newest patches of each tile stay")
      ->check(CLI::Range(1, 1'000'000))
      ->type_name("N")
      ->capture_default_str();
  compact->footer(
      R"(Patches are what vehicles fetch that have an older version, and what `revert`, `explain` and `verify
--repair` work with: what is older than those kept can then not be taken back, told or repaired any more.
The journal stays whole.

Exit codes: 0 done, 1 error, 2 wrong usage)");

  CLI::App* explain = AddAction(*base, "explain", "Tell the history of a landmark or a place",
                                Explain, arguments, chosen);
  explain
      ->add_option(
          "WHAT", arguments->what,
          "A landmark, DRIVE:INDEX, or a place on the Earth, LATITUDE,LONGITUDE in degrees")
      ->required();
  explain->footer(
      "Example:\n  carmap base explain town.base 49.0123,8.4321\n\n"
      "Exit codes: 0 done, 1 error, 2 wrong usage");
}

}  // namespace carmap
