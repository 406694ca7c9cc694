#include <absl/time/time.h>
#include <fmt/format.h>

#include <CLI/App.hpp>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "apps/carmap/commands.h"
#include "apps/carmap/outputs.h"
#include "apps/carmap/reports.h"
#include "apps/carmap/time_option.h"
#include "carmap/base/status_macros.h"
#include "carmap/ingest/base_map.h"
#include "carmap/ingest/street_changes.h"

namespace carmap {
namespace {

struct Arguments {
  std::string base, since, out;
};

std::string TimeTextOf(int64_t unix_s) {
  return absl::FormatTime("%Y-%m-%dT%H:%M:%SZ", absl::FromUnixSeconds(unix_s), absl::UTCTimeZone());
}

/// RFC 7946: longitude first.
nlohmann::ordered_json GeoJsonOf(const std::vector<StreetChange>& changes) {
  auto features = nlohmann::ordered_json::array();
  for (const StreetChange& change : changes) {
    features.push_back(
        {{"type", "Feature"},
         {"geometry",
          {{"type", "Point"},
           {"coordinates",
            {change.place.longitude_deg, change.place.latitude_deg, change.place.altitude_m}}}},
         {"properties",
          {{"change", change.has_vanished ? "vanished" : "appeared"},
           {"since", TimeTextOf(change.since_s)},
           {"probability", change.probability},
           {"landmarks", change.landmarks},
           {"radius_m", change.radius_m},
           {"component", change.component}}}});
  }
  return {{"type", "FeatureCollection"}, {"features", std::move(features)}};
}

void Print(const std::vector<StreetChange>& changes) {
  for (const StreetChange& change : changes) {
    fmt::print("{}  {} {:.6f},{:.6f}: {} within {:.1f} m, {:.0f} % sure\n",
               TimeTextOf(change.since_s), change.has_vanished ? "vanished" : "appeared",
               change.place.latitude_deg, change.place.longitude_deg,
               Count(change.landmarks, "landmark"), change.radius_m, 100 * change.probability);
  }
  if (changes.empty()) fmt::print("nothing changed that a drive told of\n");
}

absl::StatusOr<ExitCode> RunChanges(const Arguments& arguments) {
  CARMAP_RETURN_IF_ERROR(CheckOutputs({arguments.out}, FoldersOfBase(arguments.base)));
  Timestamp since;
  if (!arguments.since.empty()) {
    CARMAP_ASSIGN_OR_RETURN(since, ParseTime("--since", arguments.since));
  }
  CARMAP_ASSIGN_OR_RETURN(const auto base, BaseMap::Open(arguments.base, StoreAccess::kReadOnly));
  CARMAP_ASSIGN_OR_RETURN(const std::vector<StreetChange> changes,
                          FindStreetChanges(*base, static_cast<int64_t>(since.seconds())));
  Print(changes);
  OutputFiles files;
  files.Write(arguments.out, [&] { return WriteReport(arguments.out, GeoJsonOf(changes)); });
  return files.Finish() ? kSuccess : kIncomplete;
}

}  // namespace

void AddBaseChanges(CLI::App& base, Command& chosen) {
  CLI::App* command =
      base.add_subcommand("changes", "Tell what appeared and vanished in the street");
  const auto arguments = std::make_shared<Arguments>();
  command->add_option("BASE", arguments->base, "Folder of the base map")->required();
  command
      ->add_option("--since", arguments->since,
                   "Only what is known since then: 2026-11-28T04:17:55Z, or seconds since 1970")
      ->type_name("TIME");
  command->add_option("--out", arguments->out, "Write them as GeoJSON, for any map viewer")
      ->type_name("F.geojson");
  command->footer(
      R"(Things of three landmarks and more, in parts of the base that lie on the Earth. A thing has vanished by
the passes of several drives (`carmap drive`, `carmap base add`), and appeared by the first drive that told
of it; how sure that is follows from who saw and missed it since. Times are those of the drives' passes, or, where
a drive did not know its time, of when it was added.

Exit codes: 0 done, 1 error, 2 wrong usage, 3 the file could not be written)");
  command->callback(
      [arguments, &chosen] { chosen = [arguments] { return RunChanges(*arguments); }; });
}

}  // namespace carmap
