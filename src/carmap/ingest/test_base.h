// A base in memory and drives to fill it with, for the tests of this module.
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include "carmap/format/lean_codec.h"
#include "carmap/format/tile_codec.h"
#include "carmap/ingest/base_map.h"
#include "carmap/ingest/changes.h"
#include "carmap/ingest/contribute.h"
#include "carmap/ingest/journal.h"
#include "carmap/map/test_street.h"

namespace carmap {

inline const GpsFix kHere{49.0123, 8.4321, 115};
inline constexpr StreetNoise kNoise{0.3, 4};

/// A drive along part of a street, in a frame of its own; its fixes are off by so much.
struct Drive {
  uint64_t id = 1;
  double from_m = 0, to_m = 100, lane_m = 0;
  bool has_gps = true;
  Eigen::Vector3d gps_error{0, 0, 0};
};

/// Where the street lies: along the north.
inline Rigid3 EcefFromStreet() {
  return EcefFromEnu(kHere) * Rigid3{RotationExp({-M_PI / 2, 0, 0}), Eigen::Vector3d::Zero()};
}

inline LeanMap MapOf(const Street& street, const Drive& drive) {
  const std::vector<Rigid3> poses = DriveAlong(drive.lane_m, drive.from_m, drive.to_m);
  const Rigid3 map_from_street{RotationExp({0, 0.1 * static_cast<double>(drive.id), 0}),
                               {3.0 * static_cast<double>(drive.id), 0, 7}};
  LeanMap map = MapStreet(street, {drive.id, 5}, kStreetRig, poses, map_from_street, kNoise);
  for (size_t i = 0; drive.has_gps && i < map.keyframes.size(); ++i) {
    const Eigen::Vector3d place =
        EcefFromEnu(kHere).Inverse() * (EcefFromStreet() * poses[i].translation);
    map.keyframes[i].gps = LocalEnu(kHere).ToGps(place + drive.gps_error);
  }
  return map;
}

class BaseTest : public ::testing::Test {
 protected:
  std::unique_ptr<BaseMap> base_ =
      BaseMap::Over(MakeMemoryStore(BaseMap::NewHeader()), "base").value();

  Contribution Add(const LeanMap& segment) {
    const auto made = Contribute(segment, "segment.cmap", *base_);
    EXPECT_TRUE(made.ok()) << made.status();
    return made.value_or(Contribution{});
  }

  /// What a drive that is localized in the component proposes: this part of what it saw.
  MapDiff DiffOf(const LeanMap& drive, uint32_t component, uint32_t part) const {
    const MapView view = Whole(component);
    MapDiff diff = Fit(view.map(), drive).value().diff;
    diff.part = part;
    diff.frame = {component, view.frame_cell()};
    diff.drive = Moved(
        diff.drive, RootFromTile(view.grid(), view.frame_cell()).Inverse() * view.root_from_view());
    const auto rename = [&](auto& id, uint32_t per_part) { id.index += per_part * part; };
    for (LeanKeyframe& keyframe : diff.drive.keyframes) rename(keyframe.id, 1000);
    for (LeanLandmark& landmark : diff.drive.landmarks) rename(landmark.id, 100'000);
    for (SameLandmark& same : diff.seen_again) rename(same.in_drive, 100'000);
    return diff;
  }

  std::vector<TileVersion> AllTiles() const { return base_->reader().ListTiles().value(); }
  std::vector<LoggedChange> Log() const { return ReadLog(base_->reader()).value(); }

  std::vector<TileId> Tiles(uint32_t component) const {
    std::vector<TileId> tiles;
    for (const TileVersion& tile : AllTiles()) {
      if (tile.tile.component == component && !tile.is_removed) tiles.push_back(tile.tile);
    }
    return tiles;
  }

  MapView Whole(uint32_t component) const {
    const auto components = base_->Components().value();
    const auto found = std::find_if(components.begin(), components.end(),
                                    [&](const Component& c) { return c.id == component; });
    const std::vector<TileId> tiles = Tiles(component);
    return Changes(*base_).View(*found, tiles.front().cell, tiles).value();
  }

  /// Every tile from nothing by its patches, and back.
  void ExpectPatchesLeadToTiles() const {
    for (const TileVersion& version : AllTiles()) {
      Tile tile{version.tile, 0, {}};
      std::vector<Tile> versions = {tile};
      const auto patches = base_->reader().ReadPatches(version.tile, 0).value();
      for (const StoredPatch& stored : patches) {
        const auto next = AppliedAndVerified(DecodePatch(stored.patch, "patch").value(), tile);
        ASSERT_TRUE(next.ok()) << next.status();
        Tile undone = *next;
        Patch inverse = DecodePatch(stored.inverse, "inverse").value();
        const auto back = AppliedAndVerified(inverse, undone);
        ASSERT_TRUE(back.ok()) << back.status();
        EXPECT_EQ(HashOf(back->map), HashOf(tile.map));
        tile = *next;
      }
      EXPECT_EQ(tile.version, version.version);
      if (version.is_removed) {
        EXPECT_THAT(tile.map.keyframes, ::testing::IsEmpty());
        continue;
      }
      const auto stored = base_->Read(version.tile).value();
      EXPECT_EQ(HashOf(stored->map), HashOf(tile.map));
    }
  }
};

}  // namespace carmap
