#include "carmap/format/tile_codec.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <algorithm>
#include <string>
#include <vector>

#include "carmap/format/lean_map_testing.h"

namespace carmap {
namespace {

using ::testing::HasSubstr;

constexpr TileId kTile{7, 0x4797064e40000000};

Tile TileOf(LeanMap map, uint64_t version = 1) { return {kTile, version, Quantize(map)}; }

/// The map without a share of its records, and with others moved or seen by fewer: what may become
/// of it, backwards.
LeanMap Changed(const LeanMap& map, uint64_t seed) {
  LeanMap changed = map;
  uint64_t state = seed;
  const auto one_in = [&](uint64_t n) {
    state = state * 6364136223846793005u + 1442695040888963407u;
    return (state >> 33) % n == 0;
  };
  std::erase_if(changed.landmarks, [&](const LeanLandmark&) { return one_in(4); });
  for (LeanLandmark& landmark : changed.landmarks) {
    if (one_in(3)) landmark.position_in_map.x() += 0.25;
    if (landmark.keyframe_idxs.size() > 1 && one_in(3)) {
      const bool drops_first = landmark.anchor_idx != landmark.keyframe_idxs.front();
      if (drops_first) landmark.keyframe_idxs.erase(landmark.keyframe_idxs.begin());
    }
  }
  for (LeanKeyframe& keyframe : changed.keyframes) {
    if (one_in(3)) keyframe.map_from_camera.translation.z() += 0.5;
  }
  return changed;
}

/// What Applied leaves of it: no stub that sees nothing, no drive that nothing refers to.
Tile Tidy(const Tile& tile) {
  Patch nothing{.tile = tile.id, .from_version = tile.version, .to_version = tile.version + 1};
  Tile tidy = Applied(nothing, tile).value();
  tidy.version = tile.version;
  tidy.map = Quantize(tidy.map);
  return tidy;
}

TEST(TileCodec, BringsTilesBack) {
  const Tile tile = TileOf(RandomStreet(3), 42);
  const auto back = DecodeTile(EncodeTile(tile).value(), "bytes");
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->id, kTile);
  EXPECT_EQ(back->version, 42u);
  EXPECT_TRUE(AreIdentical(back->map, tile.map));
}

/// What tells drives that pass nothing new, of so many landmarks of two tiles.
MapDiff Sightings(size_t landmarks, uint64_t seed) {
  MapDiff diff{.frame = kTile, .drive = {}, .seen_again = {}, .sightings = {}};
  for (const uint64_t cell : {kTile.cell, kTile.cell + 2}) {
    TileSightings tile{.tile = {7, cell}, .version = 3, .of_landmarks = {}};
    for (size_t i = 0; i < landmarks; ++i) {
      seed = seed * 6364136223846793005u + 1442695040888963407u;
      tile.of_landmarks.push_back(static_cast<Sighting>(seed >> 62));
    }
    diff.sightings.push_back(std::move(tile));
  }
  return diff;
}

TEST(TileCodec, BringsSightingsBack) {
  for (size_t landmarks = 0; landmarks < 40; ++landmarks) {
    const MapDiff diff = Sightings(landmarks, landmarks);
    const auto back = DecodeDiff(EncodeDiff(diff).value(), "bytes");
    ASSERT_TRUE(back.ok()) << back.status();
    ASSERT_EQ(back->sightings.size(), 2u);
    for (size_t i = 0; i < 2; ++i) {
      EXPECT_EQ(back->sightings[i].tile, diff.sightings[i].tile);
      EXPECT_EQ(back->sightings[i].version, 3u);
      EXPECT_EQ(back->sightings[i].of_landmarks, diff.sightings[i].of_landmarks);
    }
  }
}

TEST(TileCodec, SightingsCostNoMoreMemoryThanTheirBytesAllow) {
  MapDiff nothing = Sightings(100'000, 1);
  for (TileSightings& tile : nothing.sightings) {
    std::fill(tile.of_landmarks.begin(), tile.of_landmarks.end(), Sighting::kNone);
  }
  const std::string bytes = EncodeDiff(nothing).value();
  EXPECT_GT(bytes.size() * 64, 200'000u);
  EXPECT_TRUE(DecodeDiff(bytes, "bytes").ok());
}

TEST(TileCodec, RefusesTilesOutOfOrder) {
  MapDiff diff = Sightings(4, 1);
  std::swap(diff.sightings[0], diff.sightings[1]);
  EXPECT_TRUE(absl::IsInvalidArgument(EncodeDiff(diff).status()));
}

TEST(TileCodec, BringsDiffsBack) {
  MapDiff diff{.part = 3, .frame = kTile, .drive = Quantize(RandomStreet(4))};
  for (uint32_t i = 0; i < 9; ++i) {
    diff.seen_again.push_back({{{1, 2}, i}, diff.drive.landmarks[10 - i].id});
  }
  const auto back = DecodeDiff(EncodeDiff(diff).value(), "bytes");
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->part, 3u);
  EXPECT_EQ(back->frame, kTile);
  EXPECT_EQ(back->seen_again, diff.seen_again);
  EXPECT_TRUE(back->sightings.empty());
  EXPECT_TRUE(AreIdentical(back->drive, diff.drive));
}

TEST(TileCodec, KeepsKindsApart) {
  const Tile tile = TileOf(RandomStreet(3));
  const std::string of_tile = EncodeTile(tile).value(), of_map = EncodeLeanMap(tile.map).value();
  const auto message = [](const auto& result) { return std::string(result.status().message()); };
  EXPECT_THAT(message(DecodeLeanMap(of_tile, "a")),
              HasSubstr("a: is a tile of a base map, not a map"));
  EXPECT_THAT(message(DecodeTile(of_map, "a")), HasSubstr("a: is not a tile of a base map"));
  EXPECT_THAT(message(DecodePatch(of_tile, "a")),
              HasSubstr("is a tile of a base map, not a patch"));
}

TEST(TileCodecProperty, PatchesGiveTheSameTileThroughBytes) {
  EXPECT_TRUE(rc::check([] {
    RandomMapOptions options;
    options.drives = *rc::gen::inRange<uint32_t>(1, 4);
    options.keyframes_per_drive = *rc::gen::inRange<uint32_t>(1, 12);
    const LeanMap map = RandomStreet(*rc::gen::arbitrary<uint64_t>(), options);
    std::vector<Tile> versions = {Tidy(TileOf(map, 1))};
    for (uint64_t version = 2; version < 5; ++version) {
      versions.push_back(
          Tidy(TileOf(Changed(versions.back().map, *rc::gen::arbitrary<uint64_t>()), version)));
    }
    Tile tile = versions.front();
    for (size_t i = 1; i < versions.size(); ++i) {
      const Patch patch = MakePatch(versions[i - 1], versions[i]);
      const auto received = DecodePatch(EncodePatch(patch).value(), "bytes");
      RC_ASSERT(received.ok());
      const auto next = AppliedAndVerified(*received, tile);
      RC_ASSERT(next.ok());
      RC_ASSERT(HashOf(next->map) == HashOf(versions[i].map));
      RC_ASSERT(*EncodeTile(*next) == *EncodeTile(versions[i]));
      RC_ASSERT(!AppliedAndVerified(*received, *next).ok());
      tile = *next;
    }
    // And back again, as contributions are reverted.
    Tile first = versions.front();
    first.version = tile.version + 1;
    const Patch back = MakePatch(tile, first);
    RC_ASSERT(HashOf(AppliedAndVerified(back, tile)->map) == HashOf(versions.front().map));
  }));
}

TEST(TileCodec, SeesThatAnotherTileWasMeant) {
  const Tile first = Tidy(TileOf(RandomStreet(5)));
  const Tile second = Tidy(TileOf(Changed(first.map, 9), 2));
  const Patch patch = MakePatch(first, second);
  Tile damaged = first;
  for (LeanLandmark& landmark : damaged.map.landmarks) landmark.descriptor.words[0] ^= 1;
  const absl::Status status = AppliedAndVerified(patch, damaged).status();
  EXPECT_TRUE(absl::IsDataLoss(status));
  EXPECT_THAT(std::string(status.message()), HasSubstr("fetch the tile"));
}

TEST(TileCodecProperty, DamageNeverGoesUnnoticed) {
  const Tile first = Tidy(TileOf(RandomStreet(5)));
  const Tile second = Tidy(TileOf(Changed(first.map, 9), 2));
  const std::string good = EncodePatch(MakePatch(first, second)).value();
  EXPECT_TRUE(rc::check([&] {
    std::string bytes = good;
    const size_t position = *rc::gen::inRange<size_t>(0, bytes.size());
    const char old = bytes[position];
    bytes[position] = static_cast<char>(*rc::gen::arbitrary<char>());
    RC_PRE(bytes[position] != old);
    RC_ASSERT(!DecodePatch(bytes, "bytes").ok());
  }));
}

}  // namespace
}  // namespace carmap
