#include <fmt/format.h>

#include <CLI/App.hpp>
#include <CLI/Validators.hpp>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "apps/carmap/commands.h"
#include "apps/carmap/outputs.h"
#include "apps/carmap/reports.h"
#include "carmap/base/file.h"
#include "carmap/base/status_macros.h"
#include "carmap/base/stopwatch.h"
#include "carmap/format/lean_codec.h"
#include "carmap/update/stitch.h"

namespace carmap {
namespace {

struct Arguments {
  std::string base, segment, out, report;
  std::string matching = "position";
  bool accept_suspect = false;
};

nlohmann::ordered_json SizeOf(const LeanMap& map, size_t bytes) {
  return {{"keyframes", map.keyframes.size()},
          {"landmarks", map.landmarks.size()},
          {"observations", ObservationCount(map)},
          {"bytes", bytes}};
}

/// What a suspect drive mapped would spoil a good map.
absl::Status CheckSound(const LeanMap& segment, const Arguments& arguments) {
  if (arguments.accept_suspect) return absl::OkStatus();
  for (const LeanDrive& drive : segment.drives) {
    if (drive.faults.none()) continue;
    return absl::FailedPreconditionError(fmt::format(
        "{}: its drive {} is suspect: {}; mend the drive and map it again, or take it as it "
        "is with --accept-suspect",
        arguments.segment, ToHex(drive.id), NamesOf(drive.faults)));
  }
  return absl::OkStatus();
}

absl::StatusOr<ExitCode> RunStitch(const Arguments& arguments) {
  const Stopwatch watch;
  // The new map may take the base map's name: it replaces the file at once or not at all.
  CARMAP_RETURN_IF_ERROR(CheckOutputs({arguments.out, arguments.report}, {arguments.segment}));
  CARMAP_RETURN_IF_ERROR(CheckOutputs({arguments.report}, {arguments.base}));
  CARMAP_ASSIGN_OR_RETURN(const std::string base_bytes,
                          ReadFile(arguments.base, kMaxLeanFileBytes));
  CARMAP_ASSIGN_OR_RETURN(const LeanMap base, DecodeLeanMap(base_bytes, arguments.base));
  CARMAP_ASSIGN_OR_RETURN(const std::string segment_bytes,
                          ReadFile(arguments.segment, kMaxLeanFileBytes));
  CARMAP_ASSIGN_OR_RETURN(const LeanMap segment, DecodeLeanMap(segment_bytes, arguments.segment));
  CARMAP_RETURN_IF_ERROR(CheckSound(segment, arguments));

  StitchOptions options;
  options.fit.locator.by_appearance = arguments.matching == "appearance";
  const auto stitched = Stitch(base, segment, options);
  if (!stitched.ok()) return WithName(arguments.segment, stitched.status());
  const auto bytes = EncodeLeanMap(stitched->map);
  if (!bytes.ok()) return WithName(arguments.out, bytes.status());
  OutputFiles files;
  if (!files.Write(arguments.out, [&] { return WriteFileAtomically(arguments.out, *bytes); })) {
    return kError;
  }
  const double wall_s = watch.ElapsedMs() * 1e-3;

  nlohmann::ordered_json report = ToJson(stitched->report);
  report["segment_keyframes_added"] = stitched->keyframes_added;
  report["base"] = SizeOf(base, base_bytes.size());
  report["segment"] = SizeOf(segment, segment_bytes.size());
  report["result"] = SizeOf(stitched->map, bytes->size());
  report["wall_s"] = wall_s;
  report["peak_rss_mb"] = PeakMemoryMb();
  files.Write(arguments.report, [&] { return WriteReport(arguments.report, report); });

  const FitReport& found = stitched->report;
  fmt::print("stitched      {} + {} of {} = {} in {:.1f} s\n",
             Count(base.keyframes.size(), "keyframe"), stitched->keyframes_added,
             segment.keyframes.size(), stitched->map.keyframes.size(), wall_s);
  fmt::print("overlap       {}, {} in both maps, {:.3f} m apart in the median\n",
             Count(found.segment_keyframes_overlapping, "keyframe"),
             Count(found.inliers, "landmark"), found.median_distance_m);
  fmt::print(
      "fit           lengths times {:.4f}, bent by {:.1f} % at most; keyframes {:.2f} m (median) "
      "from where the base's landmarks put them\n",
      found.scale, 100 * found.largest_strain, found.median_misfit_m);
  fmt::print("landmarks     {} + {} - {} duplicates = {}\n", base.landmarks.size(),
             segment.landmarks.size(), found.inliers, stitched->map.landmarks.size());
  fmt::print("map           {}, {} (base {}, segment {})\n", arguments.out,
             BytesText(static_cast<double>(bytes->size())),
             BytesText(static_cast<double>(base_bytes.size())),
             BytesText(static_cast<double>(segment_bytes.size())));
  return files.Finish() ? kSuccess : kIncomplete;
}

}  // namespace

void AddStitchCommand(CLI::App& app, Command& chosen) {
  CLI::App* command = app.add_subcommand("stitch", "Join a map segment to a base map");
  const auto arguments = std::make_shared<Arguments>();
  command->add_option("BASE", arguments->base, "Base map (.cmap)")->required();
  command
      ->add_option("SEGMENT", arguments->segment, "Map of another drive that overlaps it (.cmap)")
      ->required();
  command->add_option("--out", arguments->out, "The new map to write; may be BASE itself")
      ->required()
      ->type_name("NEW.cmap");
  command
      ->add_option("--matching", arguments->matching,
                   "How the overlap is found: position (GPS, places, then signatures), or "
                   "appearance, the baseline that it is compared with (position)")
      ->check(CLI::IsMember({"position", "appearance"}))
      ->type_name("M");
  command
      ->add_option("--report", arguments->report,
                   "Write overlap, scale, misfit (m) and sizes (bytes) as JSON")
      ->type_name("R.json");
  command->add_flag("--accept-suspect", arguments->accept_suspect,
                    "Take also the map of a drive that `carmap map` called suspect");
  command->footer(
      R"(The segment is found in the base map by what its keyframes see. BASE stays, the segment bends to it:
two drives measure lengths that differ by some tenths of a percent. Landmarks that both saw are kept
once, and keyframes are added only where BASE has none. A segment that does not overlap or
contradicts the base, or whose drive is suspect, is refused with the reason, and no file is written
or changed.

Example:
  carmap stitch base.cmap segment.cmap --out road.cmap

Exit codes: 0 done, 1 error (no map is written), 2 wrong usage, 3 map written but not the report)");
  command->callback(
      [arguments, &chosen] { chosen = [arguments] { return RunStitch(*arguments); }; });
}

}  // namespace carmap
