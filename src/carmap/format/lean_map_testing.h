// Maps for the tests and fuzzers of this module.
//
// Made with whole numbers from a seeded generator, so that each machine makes the same.
#pragma once

#include <cstdint>

#include "carmap/map/lean_map.h"

namespace carmap {

struct RandomMapOptions {
  uint32_t drives = 2;
  uint32_t keyframes_per_drive = 10;
  uint32_t landmarks_per_keyframe = 5;
};

/// A street as a stereo camera sees it: keyframes about one metre apart on a winding road,
/// landmarks between 4 and 150 m away, first seen by one keyframe and mostly by those that follow.
/// Consistent, on no grid.
LeanMap RandomStreet(uint64_t seed, const RandomMapOptions& options = {});

/// Equal in every field, bit by bit.
bool AreIdentical(const LeanMap& a, const LeanMap& b);

}  // namespace carmap
