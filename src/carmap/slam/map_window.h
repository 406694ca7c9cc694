// Which keyframes of the working map belong together: those that see the same landmarks.
//
// Pure functions, thread-safe on a map that nobody changes.
#pragma once

#include <cstddef>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/map/map.h"

namespace carmap {

struct Covisibility {
  KeyframeId id;
  int shared_landmarks = 0;
};

/// The keyframes that share landmarks with this one, at least `min_shared` each; most shared first,
/// and of equals the latest.
std::vector<Covisibility> CovisibleKeyframes(const Map& map, KeyframeId id, int min_shared);

struct WindowOptions {
  size_t keyframes = 12;  ///< at most, the one in the middle included
  int min_shared_landmarks = 15;
};

/// The keyframe and those that share most landmarks with it, ascending.
std::vector<KeyframeId> WindowAround(const Map& map, KeyframeId id, const WindowOptions& options);

}  // namespace carmap
