// Fuzzes the decoder of lean maps and what is done with their maps: whatever the bytes, no crash,
// no exhausted memory, and a map that is accepted is consistent, comes back from its own bytes, can
// be rebuilt, localized in and stitched.
//
//   cmake --preset fuzz && cmake --build --preset fuzz --target decode_lean_map_fuzz
//   mkdir -p build/fuzz/corpus
//   build/fuzz/bin/decode_lean_map_fuzz -rss_limit_mb=1024 -max_len=16384 build/fuzz/corpus \
//       src/carmap/format/testdata
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "carmap/feature/default_vocabulary.h"
#include "carmap/feature/feature_grid.h"
#include "carmap/format/lean_codec.h"
#include "carmap/format/lean_map_testing.h"
#include "carmap/index/reconstruct.h"
#include "carmap/localize/keyframe_view.h"
#include "carmap/localize/place_search.h"
#include "carmap/update/stitch.h"
#include "repair_checksums.h"

namespace {

void Check(bool condition) {
  if (!condition) std::abort();
}

/// The same map under ids that it does not have, so that it can be stitched to itself.
carmap::LeanMap OfOtherDrives(const carmap::LeanMap& map) {
  std::map<carmap::DriveId, carmap::DriveId> other_of;
  carmap::DriveId other{0};
  for (const carmap::LeanDrive& drive : map.drives) {
    while (std::any_of(map.drives.begin(), map.drives.end(),
                       [&](const carmap::LeanDrive& d) { return d.id == other; })) {
      ++other.input;
    }
    other_of[drive.id] = other;
    ++other.input;
  }
  carmap::LeanMap renamed = map;
  for (carmap::LeanDrive& drive : renamed.drives) drive.id = other_of[drive.id];
  for (carmap::LeanKeyframe& keyframe : renamed.keyframes) {
    keyframe.id.drive = other_of[keyframe.id.drive];
  }
  for (carmap::LeanLandmark& landmark : renamed.landmarks) {
    landmark.id.drive = other_of[landmark.id.drive];
  }
  return renamed;
}

/// Looks for what the map's own keyframes see.
void Localize(const carmap::ReconstructedMap& map) {
  carmap::PlaceSearchOptions options;
  options.tracking.min_inliers = 4;
  options.min_agreeing_matches = 4;
  carmap::PlaceSearch search(
      map, {std::shared_ptr<const carmap::Vocabulary>(), &carmap::DefaultVocabulary()}, options);
  constexpr uint32_t kMaxFrames = 4;
  const auto count = static_cast<uint32_t>(map.snapshot.keyframes.size());
  for (uint32_t k = 0; k < std::min(count, kMaxFrames); ++k) {
    const carmap::KeyframeView view =
        carmap::ViewFrom(map, k, options.neighbourhood.covisible_neighbours);
    const carmap::StereoRig& rig = carmap::RigOf(map, k);
    const carmap::FeatureGrid grid(view.features, rig.camera.width, rig.camera.height);
    for (const auto& place : search.Search(grid, rig, map.snapshot.keyframes[k].gps)) {
      Check(carmap::IsRigid(place.camera_from_map));
    }
  }
}

void StitchToItself(const carmap::LeanMap& map) {
  carmap::StitchOptions options{
      .fit = {.min_keyframes = 1, .min_inliers = 6, .min_inlier_ratio = 0, .max_strain = 1e9}};
  options.fit.locator.min_inliers = 4;
  options.fit.locator.place_search.tracking.min_inliers = 4;
  options.fit.locator.place_search.min_agreeing_matches = 4;
  options.fit.bend.tracking.min_inliers = 4;
  const auto stitched = carmap::Stitch(map, OfOtherDrives(map), options);
  if (stitched.ok()) Check(carmap::CheckConsistency(stitched->map).ok());
}

void Decode(const std::string& bytes) {
  const absl::StatusOr<carmap::LeanMap> map = carmap::DecodeLeanMap(bytes, "input");
  if (!map.ok()) return;
  Check(carmap::CheckConsistency(*map).ok());
  Localize(carmap::Reconstruct(*map));
  StitchToItself(*map);
  const absl::StatusOr<std::string> again = carmap::EncodeLeanMap(*map, {.zstd_level = 1});
  if (!again.ok()) return;  // its own file is smaller, and so is what that may expand to
  const absl::StatusOr<carmap::LeanMap> back = carmap::DecodeLeanMap(*again, "encoded again");
  Check(back.ok());
  Check(carmap::AreIdentical(*back, carmap::Quantize(*map)));
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  std::string bytes(reinterpret_cast<const char*>(data), size);
  Decode(bytes);
  carmap::RepairChecksums(bytes);
  Decode(bytes);
  return 0;
}
