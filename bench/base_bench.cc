// Times what a base does with a segment of 1,000 keyframes, and with a diff of 10 s, when the base
// has 1, 10, 100 and 1,000 km.
//
// A large base is made of copies of one street of a kilometre, each with its own corners and far
// from the others, each its own component; the segment is of the first street. Everything is on
// disk, synced; one core. The yardstick is the base of 1 km in the same run.
#include <fmt/format.h>
#include <sys/resource.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include "carmap/base/stopwatch.h"
#include "carmap/base/summary.h"
#include "carmap/feature/default_vocabulary.h"
#include "carmap/geometry/geodesy.h"
#include "carmap/ingest/base_map.h"
#include "carmap/ingest/changes.h"
#include "carmap/ingest/contribute.h"
#include "carmap/ingest/journal.h"
#include "carmap/ingest/view_follower.h"
#include "carmap/map/test_street.h"

namespace carmap {
namespace {

constexpr double kStreetM = 1000;
constexpr StreetNoise kNoise{0.3, 4};

/// Ten kilometres from one to the next, in rows of a hundred.
GpsFix PlaceOf(int street) {
  return {49 + 0.09 * (street / 100), 8.4 + 0.14 * (street % 100), 115};
}

LeanMap DriveOf(const Street& street, int place, DriveId id, double from_m, double to_m,
                double lane_m) {
  const std::vector<Rigid3> poses = DriveAlong(lane_m, from_m, to_m, 1.0);
  LeanMap map = MapStreet(street, id, kStreetRig, poses, Rigid3(), kNoise);
  const LocalEnu enu(PlaceOf(place));
  for (size_t i = 0; i < map.keyframes.size(); ++i) {
    const Eigen::Vector3d& p = poses[i].translation;
    map.keyframes[i].gps = enu.ToGps({p.x(), p.z(), -p.y()});
  }
  return map;
}

void Exit(const absl::Status& status) {
  fmt::print(stderr, "base_bench: {}\n", std::string(status.message()));
  std::exit(1);
}

template <typename T>
T Must(absl::StatusOr<T> result) {
  if (!result.ok()) Exit(result.status());
  return *std::move(result);
}

Contribution Add(const LeanMap& segment, BaseMap& base, double& ms) {
  const Stopwatch watch;
  Contribution made = Must(Contribute(segment, "segment", base));
  ms = watch.ElapsedMs();
  return made;
}

double PeakMb() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_maxrss) * 1024e-6;
}

/// What a vehicle that is localized in the base saw of 140 m.
MapDiff DiffOf(const Street& street, DriveId id, uint32_t part, const BaseMap& base) {
  const double from_m = 100.0 + 140 * part;
  LeanMap drive = DriveOf(street, 0, id, from_m, from_m + 140, 0.3);
  const Component component = Must(base.Components()).front();
  std::vector<Eigen::Vector3d> places;
  for (const LeanKeyframe& keyframe : drive.keyframes) {
    places.push_back(EcefFromEnu(*keyframe.gps).translation);
  }
  const std::vector<TileId> tiles = Must(TilesNear(base.reader(), component, places, 60));
  const MapView view = Must(Changes(base).View(component, tiles.front().cell, tiles));
  FittedSegment fitted = Must(Fit(view.map(), drive));
  fitted.diff.part = part;
  fitted.diff.frame = {component.id, tiles.front().cell};
  fitted.diff.drive =
      Moved(fitted.diff.drive,
            RootFromTile(component.grid, tiles.front().cell).Inverse() * view.root_from_view());
  // What the base has already, a vehicle does not send again, but for a share to refine it.
  for (uint32_t i = 0; i < fitted.diff.drive.keyframes.size(); ++i) {
    fitted.diff.drive.keyframes[i].id.index += 1000 * part;
  }
  for (LeanLandmark& landmark : fitted.diff.drive.landmarks) landmark.id.index += 100'000 * part;
  for (SameLandmark& same : fitted.diff.seen_again) same.in_drive.index += 100'000 * part;
  return std::move(fitted.diff);
}

struct Times {
  double end_ms = 0, along_ms = 0, diff_ms = 0, open_ms = 0, first_view_ms = 0;
};

/// Opening, as a vehicle does, and the tiles around its first fix.
void TimeFirstView(const std::filesystem::path& folder, Times& times) {
  const Stopwatch watch;
  const auto base = Must(BaseMap::Open(folder, StoreAccess::kReadOnly));
  times.open_ms = watch.ElapsedMs();
  const Stopwatch view_watch;
  ViewFollower follower(*base, kStreetRig.camera.fx,
                        {std::shared_ptr<const Vocabulary>(), &DefaultVocabulary()});
  Must(follower.Follow(std::nullopt, PlaceOf(0), {}));
  times.first_view_ms = view_watch.ElapsedMs();
  fmt::print("    first view: {} keyframes, {} landmarks\n", follower.view().map().keyframes.size(),
             follower.view().map().landmarks.size());
}

Times TimeContributions(const std::filesystem::path& folder, uint64_t round) {
  Times times;
  const Street street = MakeStreet(1, 2 * kStreetM + 60);
  {
    const auto base = Must(BaseMap::Open(folder, StoreAccess::kReadWrite));
    const uint64_t id = 1'000'000 + 10 * round;
    // Of 1,000 keyframes the first hundred overlap the end of the base's street.
    Add(DriveOf(street, 0, {id, 1}, 900, 1900, 0.5), *base, times.end_ms);
    Add(DriveOf(street, 0, {id + 1, 1}, 0, 1000, 0.7), *base, times.along_ms);
    std::vector<double> diffs_ms;
    for (uint32_t i = 0; i < 6; ++i) {  // 10 s at 50 km/h, of one drive; the first warms up
      const MapDiff diff = DiffOf(street, {id + 2, 1}, i, *base);
      const Stopwatch watch;
      Must(Contribute(diff, "diff", *base));
      if (i > 0) diffs_ms.push_back(watch.ElapsedMs());
    }
    times.diff_ms = Summarize(diffs_ms).median;
  }
  TimeFirstView(folder, times);
  return times;
}

void Fill(BaseMap& base, int from, int to) {
  for (int i = from; i < to; ++i) {
    const Street street =
        MakeStreet(static_cast<uint64_t>(i) + 1, i == 0 ? 2 * kStreetM + 60 : kStreetM + 60);
    double ms = 0;
    Add(DriveOf(street, i, {static_cast<uint64_t>(i) + 1, 1}, 0, kStreetM, 0), base, ms);
    if ((i + 1) % 100 == 0) fmt::print(stderr, "base_bench: {} km\n", i + 1);
  }
}

int Run(const std::filesystem::path& folder, int max_km) {
  std::filesystem::remove_all(folder);
  Must(BaseMap::Create(folder));
  std::vector<Times> all;
  int filled = 0;
  fmt::print("segment of 1,000 keyframes into a base of copies of one street, on disk, synced\n");
  for (int km = 1; km <= max_km; km *= 10) {
    {
      const auto base = Must(BaseMap::Open(folder, StoreAccess::kReadWrite));
      Fill(*base, filled, km);
      filled = km;
    }
    // Each size has the first street as one drive left it: what was timed is another copy.
    const std::filesystem::path copy = folder.string() + ".copy";
    std::filesystem::remove_all(copy);
    std::filesystem::copy(folder, copy, std::filesystem::copy_options::recursive);
    all.push_back(TimeContributions(copy, 0));
    std::filesystem::remove_all(copy);
    const Times& t = all.back();
    const Times& one = all.front();
    fmt::print(
        "{:>5} km  overlap at an end {:>6.0f} ms ({:.2f}), all along {:>6.0f} ms ({:.2f}), "
        "140 m {:>5.1f} ms ({:.2f}), open {:>5.1f} ms, first view {:>5.1f} ms; peak {:.0f} MB\n",
        km, t.end_ms, t.end_ms / one.end_ms, t.along_ms, t.along_ms / one.along_ms, t.diff_ms,
        t.diff_ms / one.diff_ms, t.open_ms, t.first_view_ms, PeakMb());
    std::fflush(stdout);
  }
  std::filesystem::remove_all(folder);
  return 0;
}

}  // namespace
}  // namespace carmap

int main(int argc, char** argv) {
  CLI::App app("Times contributions to bases of 1 to 1,000 km.", "base_bench");
  std::string folder = "base_bench.base";
  int max_km = 100;
  app.add_option("--folder", folder, "Made for the bases, and removed")->capture_default_str();
  app.add_option("--max-km", max_km, "Largest base")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  return carmap::Run(folder, max_km);
}
