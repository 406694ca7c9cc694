// Identities of drives, keyframes and landmarks.
//
// A drive is one run of the mapper; its id is a hash of its input, so it is the same on every
// machine. Keyframes and landmarks are known worldwide by (drive, index). All are plain values:
// ordered, hashable and safe to copy between threads.
#pragma once

#include <compare>
#include <cstdint>
#include <utility>

namespace carmap {

struct DriveId {
  uint64_t value = 0;
  auto operator<=>(const DriveId&) const = default;
};

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

template <typename H>
H AbslHashValue(H state, const DriveId& id) {
  return H::combine(std::move(state), id.value);
}
template <typename H>
H AbslHashValue(H state, const KeyframeId& id) {
  return H::combine(std::move(state), id.drive, id.index);
}
template <typename H>
H AbslHashValue(H state, const LandmarkId& id) {
  return H::combine(std::move(state), id.drive, id.index);
}

}  // namespace carmap
