// What a drive proposes to the base map (paper §3.4): what is new in it, placed in the base, and
// what it saw of what the base has.
//
// A segment becomes one when it is fitted (update/fit.h). It says what was seen, not what becomes
// of the base: that is a Patch. Proposals may come late, twice, in any order: each has a name.
// Plain values.
#pragma once

#include <absl/status/status.h>

#include <cstddef>
#include <cstdint>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/map/lean_map.h"

namespace carmap {

/// One corner of the world under two names.
struct SameLandmark {
  LandmarkId in_base, in_drive;
  auto operator<=>(const SameLandmark&) const = default;
};

/// Of a landmark of the base, by one pass of a drive. It is missed where it should have been seen:
/// in sight, from where it was recognised before, with nothing before it. It is seen through where
/// the drive, besides, measured what stands behind it.
enum class Sighting : uint8_t { kNone, kMissed, kSeen, kSeenThrough };

/// What no drive sees of in one part; each costs the base the reading of a tile.
inline constexpr size_t kMaxTilesSeen = 1024;

/// What a drive saw of a tile.
struct TileSightings {
  TileId tile;
  uint64_t version = 0;                ///< in which the vehicle had it
  std::vector<Sighting> of_landmarks;  ///< in the order of that version's landmarks
};

/// Named by its drives and its part of them.
struct MapDiff {
  uint32_t part = 0;  ///< from 0, of what the drive proposes
  /// Tile in whose frame all is; none of a base of one map, nor where the drive does not know its
  /// place in the base: then it is a segment, in a frame of its own.
  TileId frame;
  LeanMap drive;
  std::vector<SameLandmark> seen_again;  ///< ascending; each landmark at most once
  std::vector<TileSightings> sightings;  ///< ascending by tile

  bool is_placed() const { return frame.component != 0; }
};

/// Checks what is written above, limits too, but for the drive's map, which has a check of its own.
/// Errors: InvalidArgument.
absl::Status CheckOrder(const MapDiff& diff);

}  // namespace carmap
