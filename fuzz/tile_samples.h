// A small tile of a street, what becomes of it, and what another drive proposes to it: where the
// fuzzer of tiles, patches and diffs begins.
//
// The same on every machine. Pure functions, thread-safe.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/format/lean_codec.h"
#include "carmap/format/lean_map_testing.h"
#include "carmap/map/lean_map.h"
#include "carmap/map/map_diff.h"
#include "carmap/map/tile.h"

namespace carmap {

inline Tile SampleTile() {
  const RandomMapOptions street{.drives = 2, .keyframes_per_drive = 4, .landmarks_per_keyframe = 3};
  return {.id = {7, 0x4797064e40000000}, .version = 1, .map = Quantize(RandomStreet(3, street))};
}

/// Its last keyframe went, with the landmarks anchored there; others moved, or are seen by more.
inline Tile SampleNextTile() {
  Tile tile = SampleTile();
  ++tile.version;
  LeanMap& map = tile.map;
  const auto gone = static_cast<uint32_t>(map.keyframes.size() - 1);
  map.keyframes.pop_back();
  std::erase_if(map.landmarks, [&](const LeanLandmark& l) { return l.anchor_idx == gone; });
  for (LeanLandmark& landmark : map.landmarks) std::erase(landmark.keyframe_idxs, gone);
  map.keyframes[1].map_from_camera.translation.z() += 0.5;
  for (size_t i = 0; i < map.landmarks.size(); i += 2) {
    LeanLandmark& landmark = map.landmarks[i];
    landmark.position_in_map.x() += 0.25;
    if (landmark.keyframe_idxs.back() + 1 < gone) landmark.keyframe_idxs.push_back(gone - 1);
  }
  map.landmarks.erase(map.landmarks.begin() + 1);
  tile.map = Quantize(map);
  return tile;
}

/// Two drives that saw what the tile has, the first three metres beside its keyframes.
inline MapDiff SampleDiff() {
  const Tile tile = SampleTile();
  MapDiff diff{.part = 1, .frame = tile.id, .drive = tile.map, .seen_again = {}, .sightings = {}};
  LeanMap& map = diff.drive;
  for (LeanDrive& drive : map.drives) ++drive.id.options;
  for (LeanKeyframe& keyframe : map.keyframes) {
    ++keyframe.id.drive.options;
    if (keyframe.id.drive == map.drives[0].id) keyframe.map_from_camera.translation.x() += 3;
  }
  for (size_t i = 0; i < map.landmarks.size(); ++i) {
    ++map.landmarks[i].id.drive.options;
    if (i % 3 != 0) diff.seen_again.push_back({tile.map.landmarks[i].id, map.landmarks[i].id});
  }
  map = Quantize(map);
  TileSightings seen{.tile = tile.id, .version = tile.version, .of_landmarks = {}};
  for (size_t i = 0; i < tile.map.landmarks.size(); ++i) {
    seen.of_landmarks.push_back(static_cast<Sighting>(i % 4));
  }
  diff.sightings = {std::move(seen)};
  return diff;
}

}  // namespace carmap
