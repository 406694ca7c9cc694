// Fuzzes the decoders of tiles, patches and diffs and what is done with them: whatever the bytes,
// no crash, no exhausted memory; what is accepted comes back from its own bytes; patches lead from
// any tile to any other, and what patches and diffs leave is consistent.
//
// An input is one file or two: what the second says is then applied to the tile of the first.
//
//   cmake --preset fuzz && cmake --build --preset fuzz --target fuzzers
//   mkdir -p build/fuzz/corpus build/fuzz/samples
//   build/fuzz/bin/write_tile_samples build/fuzz/samples
//   build/fuzz/bin/decode_tile_fuzz -rss_limit_mb=1024 -max_len=16384 build/fuzz/corpus \
//       build/fuzz/samples
#include <cstdint>
#include <cstdlib>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "carmap/format/lean_codec.h"
#include "carmap/format/lean_map_testing.h"
#include "carmap/format/tile_codec.h"
#include "carmap/map/lean_map.h"
#include "carmap/map/map_diff.h"
#include "carmap/map/tile.h"
#include "carmap/update/apply_diff.h"
#include "repair_checksums.h"
#include "tile_samples.h"

namespace {

constexpr carmap::LeanEncodeOptions kFast{.zstd_level = 1};

void Check(bool condition) {
  if (!condition) std::abort();
}

/// False for what is not to be stored: it reaches too far, or its own file is smaller, and so is
/// what that may expand to.
bool ComesBack(const carmap::Tile& tile) {
  const absl::StatusOr<std::string> bytes = carmap::EncodeTile(tile, kFast);
  if (!bytes.ok()) return false;
  const absl::StatusOr<carmap::Tile> back = carmap::DecodeTile(*bytes, "encoded again");
  Check(back.ok());
  Check(back->id == tile.id && back->version == tile.version);
  Check(carmap::AreIdentical(back->map, carmap::Quantize(tile.map)));
  Check(carmap::HashOf(back->map) == carmap::HashOf(tile.map));
  return true;
}

void CheckComesBack(const carmap::Patch& patch) {
  const absl::StatusOr<std::string> bytes = carmap::EncodePatch(patch, kFast);
  if (!bytes.ok()) return;
  const absl::StatusOr<carmap::Patch> back = carmap::DecodePatch(*bytes, "encoded again");
  Check(back.ok());
  Check(back->tile == patch.tile && back->hash == patch.hash);
  Check(back->from_version == patch.from_version && back->to_version == patch.to_version);
  Check(back->removed_keyframes == patch.removed_keyframes);
  Check(back->removed_landmarks == patch.removed_landmarks);
  Check(carmap::AreIdentical(back->put, carmap::Quantize(patch.put)));
}

void CheckComesBack(const carmap::MapDiff& diff) {
  const absl::StatusOr<std::string> bytes = carmap::EncodeDiff(diff, kFast);
  if (!bytes.ok()) return;
  const absl::StatusOr<carmap::MapDiff> back = carmap::DecodeDiff(*bytes, "encoded again");
  Check(back.ok());
  Check(back->part == diff.part && back->frame == diff.frame);
  Check(back->seen_again == diff.seen_again);
  Check(carmap::AreIdentical(back->drive, carmap::Quantize(diff.drive)));
}

/// What is left of the tile by a patch that says nothing.
carmap::Tile Tidy(const carmap::Tile& tile) {
  const carmap::Patch nothing{
      .tile = tile.id, .from_version = tile.version, .to_version = tile.version + 1};
  const absl::StatusOr<carmap::Tile> tidy = carmap::Applied(nothing, tile);
  Check(tidy.ok());
  return *tidy;
}

/// The patch that makes the one of the other does so, through bytes too.
void PatchToTheOther(carmap::Tile from, carmap::Tile to) {
  from.map = carmap::Quantize(from.map);
  to.id = from.id;
  to.version = from.version;
  to = Tidy(to);
  to.map = carmap::Quantize(to.map);
  const carmap::Patch patch = carmap::MakePatch(from, to);
  Check(carmap::AppliedAndVerified(patch, from).ok());
  const absl::StatusOr<std::string> bytes = carmap::EncodePatch(patch, kFast);
  if (!bytes.ok()) return;
  const absl::StatusOr<carmap::Patch> received = carmap::DecodePatch(*bytes, "patch");
  Check(received.ok());
  Check(carmap::AppliedAndVerified(*received, from).ok());
}

void Use(const carmap::Tile& tile, const carmap::Tile& sample) {
  Check(carmap::CheckConsistency(tile.map).ok());
  if (!ComesBack(tile)) return;
  PatchToTheOther(sample, tile);
  PatchToTheOther(tile, sample);
}

/// As if it had been made for the tile.
void Use(carmap::Patch patch, const carmap::Tile& tile) {
  patch.tile = tile.id;
  patch.from_version = tile.version;
  patch.to_version = tile.version + 1;
  const absl::StatusOr<carmap::Tile> next = carmap::Applied(patch, tile);
  if (!next.ok()) return;
  Check(next->id == tile.id && next->version == patch.to_version);
  Check(carmap::CheckConsistency(next->map).ok());
  ComesBack(*next);
  patch.hash = carmap::HashOf(next->map);
  Check(carmap::AppliedAndVerified(patch, tile).ok());
  ++patch.hash;
  Check(!carmap::AppliedAndVerified(patch, tile).ok());
}

/// Each keyframe of the base is there and did not move.
bool Stays(const carmap::LeanMap& base, const carmap::LeanMap& merged) {
  auto place = merged.keyframes.begin();
  for (const carmap::LeanKeyframe& keyframe : base.keyframes) {
    while (place != merged.keyframes.end() && place->id < keyframe.id) ++place;
    if (place == merged.keyframes.end() || place->id != keyframe.id) return false;
    const carmap::Rigid3 &before = keyframe.map_from_camera, &after = place->map_from_camera;
    if (before.translation != after.translation) return false;
    if (before.rotation.coeffs() != after.rotation.coeffs()) return false;
  }
  return true;
}

void Use(const carmap::MapDiff& diff, const carmap::LeanMap& base) {
  const absl::StatusOr<carmap::LeanMap> merged = carmap::Apply(diff, base);
  if (!merged.ok()) return;
  Check(carmap::CheckConsistency(*merged).ok());
  Check(Stays(base, *merged));
  Check(merged->landmarks.size() <= base.landmarks.size() + diff.drive.landmarks.size());
  const absl::StatusOr<std::string> bytes = carmap::EncodeLeanMap(*merged, kFast);
  if (bytes.ok()) Check(carmap::DecodeLeanMap(*bytes, "merged").ok());
  const absl::StatusOr<carmap::LeanMap> twice = carmap::Apply(diff, *merged);
  if (!twice.ok()) return;
  Check(carmap::CheckConsistency(*twice).ok());
  Check(Stays(*merged, *twice));
}

void Decode(const std::vector<std::string>& files) {
  static const carmap::Tile sample = carmap::SampleTile();
  std::optional<carmap::Tile> decoded;
  for (const std::string& bytes : files) {
    const absl::StatusOr<carmap::Tile> tile = carmap::DecodeTile(bytes, "input");
    const absl::StatusOr<carmap::Patch> patch = carmap::DecodePatch(bytes, "input");
    const absl::StatusOr<carmap::MapDiff> diff = carmap::DecodeDiff(bytes, "input");
    Check(tile.ok() + patch.ok() + diff.ok() + carmap::DecodeLeanMap(bytes, "input").ok() <= 1);
    if (tile.ok()) {
      Use(*tile, sample);
      decoded = *tile;
    }
    if (patch.ok()) {
      CheckComesBack(*patch);
      Use(*patch, sample);
      if (decoded) Use(*patch, *decoded);
    }
    if (diff.ok()) {
      CheckComesBack(*diff);
      Use(*diff, sample.map);
      if (decoded) Use(*diff, decoded->map);
    }
  }
}

/// One or two, each with its magic.
std::vector<std::string> FilesOf(const std::string& bytes) {
  constexpr std::string_view kMagic(
      "\x89"
      "CMAP\r\n\x1a",
      8);
  const size_t second = bytes.find(kMagic, 1);
  if (second == std::string::npos) return {bytes};
  return {bytes.substr(0, second), bytes.substr(second)};
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  std::vector<std::string> files = FilesOf(std::string(reinterpret_cast<const char*>(data), size));
  Decode(files);
  for (std::string& bytes : files) carmap::RepairChecksums(bytes);
  Decode(files);
  return 0;
}
