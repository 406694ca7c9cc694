// Times the search for a place in maps of 1, 10 and 100 km: frames that can be found and frames
// that cannot, with and without GPS.
//
// A large map is made of copies of a small one, side by side; their signatures are changed so much
// that a frame of the small one's drive is found in the first copy only.

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdlib>
#include <random>
#include <string>
#include <vector>

#include "carmap/base/file.h"
#include "carmap/base/stopwatch.h"
#include "carmap/base/summary.h"
#include "carmap/dataset/kitti_drive.h"
#include "carmap/feature/default_vocabulary.h"
#include "carmap/feature/stereo_features.h"
#include "carmap/format/lean_codec.h"
#include "carmap/localize/place_search.h"

namespace carmap {
namespace {

constexpr double kSpacingM = 1000;  // between the copies
constexpr int kColumns = 100;
constexpr int kChangedBits = 100;  // some of them back: 50 are other than before
const GpsFix kOrigin{49, 8.4, 110};

Eigen::Vector3d PlaceOfCopy(size_t copy) {
  return {kSpacingM * static_cast<double>(copy % kColumns), 0,
          kSpacingM * static_cast<double>(copy / kColumns)};
}

void ChangeBits(std::mt19937_64& random, Descriptor& descriptor) {
  for (int i = 0; i < kChangedBits; ++i) {
    const uint64_t bit = random() % kSignatureBits;
    descriptor.words[bit / 64] ^= uint64_t{1} << (bit % 64);
  }
}

/// `copies` of the map, of which only the first keeps its signatures, and that only if `is_true`.
LeanMap Enlarge(const LeanMap& map, size_t copies, bool is_true) {
  std::mt19937_64 random(1);
  const LocalEnu enu(kOrigin);
  LeanMap large;
  large.drives = map.drives;
  for (size_t copy = 0; copy < copies; ++copy) {
    const auto first_keyframe = static_cast<uint32_t>(large.keyframes.size());
    for (size_t i = 0; i < map.keyframes.size(); ++i) {
      LeanKeyframe keyframe = map.keyframes[i];
      keyframe.id = {map.drives.front().id, static_cast<uint32_t>(large.keyframes.size())};
      keyframe.map_from_camera.translation += PlaceOfCopy(copy);
      const Eigen::Vector3d& p = keyframe.map_from_camera.translation;
      keyframe.gps = enu.ToGps({p.x(), p.z(), 0});
      large.keyframes.push_back(keyframe);
    }
    for (LeanLandmark landmark : map.landmarks) {
      landmark.id = {map.drives.front().id, static_cast<uint32_t>(large.landmarks.size())};
      landmark.position_in_map += PlaceOfCopy(copy);
      for (uint32_t& keyframe_idx : landmark.keyframe_idxs) keyframe_idx += first_keyframe;
      landmark.anchor_idx += first_keyframe;
      if (copy > 0 || !is_true) ChangeBits(random, landmark.descriptor);
      large.landmarks.push_back(landmark);
    }
  }
  return large;
}

double LengthM(const LeanMap& map) {
  double length_m = 0;
  for (size_t i = 1; i < map.keyframes.size(); ++i) {
    length_m += (map.keyframes[i].map_from_camera.translation -
                 map.keyframes[i - 1].map_from_camera.translation)
                    .norm();
  }
  return length_m;
}

void TimeFrames(const ReconstructedMap& map, const StereoRig& rig,
                const std::vector<std::vector<Feature>>& frames, const std::optional<GpsFix>& gps,
                const std::string& what) {
  PlaceSearch search(map, {std::shared_ptr<const Vocabulary>(), &DefaultVocabulary()});
  const Stopwatch first_watch;
  search.Search(FeatureGrid({}, rig.camera.width, rig.camera.height), rig, gps);
  const double first_ms = first_watch.ElapsedMs();
  std::vector<double> frame_ms;
  size_t found = 0;
  for (const std::vector<Feature>& features : frames) {
    const FeatureGrid grid(features, rig.camera.width, rig.camera.height);
    const Stopwatch watch;
    const auto places = search.Search(grid, rig, gps);
    frame_ms.push_back(watch.ElapsedMs());
    if (!places.empty() && places.front().inliers.size() >= 30) ++found;
  }
  const Summary ms = Summarize(frame_ms);
  fmt::print("  {:<28} {:>4} of {} found, median {:>6.1f} ms, p99 {:>6.1f} ms, index {:.0f} ms\n",
             what, found, frames.size(), ms.median, ms.p99, first_ms);
}

int Run(const std::string& folder, const std::string& map_path, double max_km) {
  const auto drive = KittiDrive::Open(folder);
  const auto bytes = ReadFile(map_path, kMaxLeanFileBytes);
  const auto lean = bytes.ok() ? DecodeLeanMap(*bytes, map_path) : bytes.status();
  for (const absl::Status& status : {drive.status(), lean.status()}) {
    if (status.ok()) continue;
    fmt::print(stderr, "place_search_bench: {}\n", std::string(status.message()));
    return 1;
  }
  const StereoRig rig = lean->drives.front().rig;
  StereoFrontEnd front_end((*drive)->rig());
  std::vector<std::vector<Feature>> frames;
  while (const auto frame = (*drive)->Next()) {
    if (frame->status.ok()) frames.push_back(front_end.Extract(frame->left, frame->right));
  }
  for (double km = 1; km <= max_km; km *= 10) {
    const auto copies = static_cast<size_t>(std::ceil(1000 * km / LengthM(*lean)));
    for (const bool is_true : {true, false}) {
      const ReconstructedMap map = Reconstruct(Enlarge(*lean, copies, is_true), rig.camera.fx);
      fmt::print("{} km, {} keyframes, {} landmarks, {}\n", km, map.snapshot.keyframes.size(),
                 map.snapshot.landmarks.size(),
                 is_true ? "frames are in the map" : "frames are not in the map");
      TimeFrames(map, rig, frames, std::nullopt, "without GPS");
      TimeFrames(map, rig, frames, map.snapshot.keyframes[lean->keyframes.size() / 2].gps,
                 "with GPS");
    }
  }
  return 0;
}

}  // namespace
}  // namespace carmap

int main(int argc, char** argv) {
  const char* data = std::getenv("CARMAP_DATA");
  std::string drive = std::string(data ? data : CARMAP_DATA_DIR) + "/kitti06_000-050", map;
  double max_km = 10;
  CLI::App app{"Times the search for a place."};
  app.add_option("--drive", drive, "Folder in KITTI layout")->capture_default_str();
  app.add_option("--map", map, "Lean map of the same drive (carmap map)")->required();
  app.add_option("--max-km", max_km, "Largest map")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  return carmap::Run(drive, map, max_km);
}
