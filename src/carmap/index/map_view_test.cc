#include "carmap/index/map_view.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>

#include "carmap/map/test_street.h"

namespace carmap {
namespace {

constexpr CellGrid kEarth;

/// A street of 300 m that runs north-east from here, as one map and cut into its tiles.
struct CutStreet {
  LeanMap map = MapStreet(MakeStreet(5, 330), {7}, kStreetRig, DriveAlong(0, 0, 300), Rigid3());
  Rigid3 root_from_map =
      EcefFromEnu({49.01, 8.43, 115}) *
      Rigid3{RotationExp({-M_PI / 2, 0, 0}) * RotationExp({0, 0.7, 0}), Eigen::Vector3d::Zero()};
  std::vector<std::shared_ptr<const Tile>> tiles;

  CutStreet() {
    std::map<uint64_t, Tile> by_cell;
    std::vector<uint64_t> cells;
    for (const LeanKeyframe& keyframe : map.keyframes) {
      cells.push_back(CellAt(kEarth, root_from_map * keyframe.map_from_camera.translation));
      by_cell[cells.back()].id = {1, cells.back()};
    }
    for (auto& [cell, tile] : by_cell) {
      LeanMap part = Moved(map, RootFromTile(kEarth, cell).Inverse() * root_from_map);
      for (size_t i = 0; i < part.keyframes.size(); ++i) {
        part.keyframes[i].is_stub = cells[i] != cell;
      }
      std::erase_if(part.landmarks, [&](const LeanLandmark& landmark) {
        return cells[landmark.anchor_idx] != cell;
      });
      const Tile raw{tile.id, 1, part};
      tile = Applied({.tile = tile.id, .from_version = 1, .to_version = 2}, raw).value();
      tiles.push_back(std::make_shared<const Tile>(tile));
    }
  }
};

TEST(MapView, PutsTilesTogetherAgain) {
  const CutStreet street;
  ASSERT_GT(street.tiles.size(), 2u);
  const MapView view(kEarth, street.tiles[1]->id.cell, street.tiles);
  const LeanMap& map = view.map();
  ASSERT_TRUE(CheckConsistency(map).ok()) << CheckConsistency(map);
  ASSERT_EQ(map.keyframes.size(), street.map.keyframes.size());
  ASSERT_EQ(map.landmarks.size(), street.map.landmarks.size());
  const Rigid3 view_from_map = view.root_from_view().Inverse() * street.root_from_map;
  for (size_t i = 0; i < map.keyframes.size(); ++i) {
    EXPECT_FALSE(map.keyframes[i].is_stub);
    EXPECT_LT((map.keyframes[i].map_from_camera.translation -
               view_from_map * street.map.keyframes[i].map_from_camera.translation)
                  .norm(),
              1e-6);
    EXPECT_LT((EcefFromEnu(*map.keyframes[i].gps).translation -
               street.root_from_map * street.map.keyframes[i].map_from_camera.translation)
                  .norm(),
              1e-3);
  }
  for (size_t i = 0; i < map.landmarks.size(); ++i) {
    EXPECT_EQ(map.landmarks[i].id, street.map.landmarks[i].id);
    EXPECT_EQ(map.landmarks[i].keyframe_idxs, street.map.landmarks[i].keyframe_idxs);
    EXPECT_LT(
        (map.landmarks[i].position_in_map - view_from_map * street.map.landmarks[i].position_in_map)
            .norm(),
        1e-6);
  }
}

TEST(MapView, LooksLikeADrivesOwnMap) {
  const CutStreet street;
  const MapView view(kEarth, street.tiles[0]->id.cell, street.tiles);
  const Rigid3& pose = view.map().keyframes.front().map_from_camera;
  EXPECT_GT((pose.rotation * Eigen::Vector3d::UnitY()).y(), 0.99) << "down is down";
}

TEST(MapView, HasStubsOfWhatItLacks) {
  const CutStreet street;
  const MapView view(kEarth, street.tiles[1]->id.cell, {street.tiles[1]});
  size_t own = 0, stubs = 0;
  for (uint32_t i = 0; i < view.map().keyframes.size(); ++i) {
    EXPECT_EQ(view.map().keyframes[i].is_stub, view.TileOf(i) == 1u);
    view.map().keyframes[i].is_stub ? ++stubs : ++own;
  }
  EXPECT_GT(own, 10u);
  EXPECT_GT(stubs, 0u);
  EXPECT_EQ(view.map().landmarks.size(), street.tiles[1]->map.landmarks.size());
  const auto rebuilt = view.Rebuild(kStreetRig.camera.fx);
  EXPECT_EQ(rebuilt->snapshot.landmarks.size(), view.map().landmarks.size());
}

TEST(MapView, KeepsPosesWhenTilesComeAndGo) {
  const CutStreet street;
  const uint64_t frame = street.tiles[0]->id.cell;
  const MapView part(kEarth, frame, {street.tiles[1]}), whole(kEarth, frame, street.tiles);
  std::map<KeyframeId, Rigid3> poses;
  for (const LeanKeyframe& keyframe : whole.map().keyframes) {
    poses[keyframe.id] = keyframe.map_from_camera;
  }
  for (const LeanKeyframe& keyframe : part.map().keyframes) {
    EXPECT_LT((keyframe.map_from_camera.translation - poses[keyframe.id].translation).norm(), 1e-6);
  }
}

}  // namespace
}  // namespace carmap
