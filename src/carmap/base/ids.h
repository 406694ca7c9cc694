// Identities of drives, keyframes, landmarks and tiles.
//
// A drive is one run of the mapper. Keyframes and landmarks are known worldwide by (drive, index);
// an index that was published never means another thing. All are plain values: ordered, hashable
// and safe to copy between threads.
#pragma once

#include <compare>
#include <cstdint>
#include <string>
#include <utility>

namespace carmap {

/// 128 bits, known when the drive begins. Of a recorded drive both are hashes, so that the same run
/// has the same id on every machine; of a live one both are random.
struct DriveId {
  uint64_t input = 0;    ///< rig, first pair of images and its time
  uint64_t options = 0;  ///< all else that changes the result
  auto operator<=>(const DriveId&) const = default;
};

/// 32 hexadecimal digits, those of `input` first.
std::string ToHex(DriveId id);

struct KeyframeId {
  DriveId drive;
  uint32_t index = 0;  ///< frame number in its drive
  auto operator<=>(const KeyframeId&) const = default;
};

struct LandmarkId {
  DriveId drive;
  uint32_t index = 0;  ///< unique within its drive
  auto operator<=>(const LandmarkId&) const = default;
};

/// A component's share of a cell (carmap/geometry/cell.h) of the base map.
struct TileId {
  uint32_t component = 0;
  uint64_t cell = 0;
  auto operator<=>(const TileId&) const = default;
};

template <typename H>
H AbslHashValue(H state, const DriveId& id) {
  return H::combine(std::move(state), id.input, id.options);
}
template <typename H>
H AbslHashValue(H state, const KeyframeId& id) {
  return H::combine(std::move(state), id.drive, id.index);
}
template <typename H>
H AbslHashValue(H state, const LandmarkId& id) {
  return H::combine(std::move(state), id.drive, id.index);
}
template <typename H>
H AbslHashValue(H state, const TileId& id) {
  return H::combine(std::move(state), id.component, id.cell);
}

}  // namespace carmap
