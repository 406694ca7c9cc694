// What changed in the street, for people: things that appeared and things that vanished, where on
// the Earth, how sure, since when.
//
// Pure but for reading, thread-safe.
#pragma once

#include <absl/status/statusor.h>

#include <cstddef>
#include <cstdint>
#include <vector>

#include "carmap/geometry/geodesy.h"
#include "carmap/ingest/base_map.h"

namespace carmap {

struct StreetChange {
  bool has_vanished = false;  ///< else it has appeared
  uint32_t component = 0;
  GpsFix place;         ///< its middle
  double radius_m = 0;  ///< around it
  size_t landmarks = 0;
  /// That it is so, the mean over its landmarks. What appeared is as sure as its landmarks are
  /// confirmed: one drive alone may err.
  double probability = 0;
  int64_t since_s = 0;  ///< Unix time of the pass by which it was known
};

struct StreetChangeOptions {
  double thing_m = 1.5;      ///< landmarks so near to another belong to one thing
  size_t min_landmarks = 3;  ///< of a thing
};

/// Of components on the Earth, since this Unix time, the oldest first: what went by the evidence of
/// passes, and landmarks of drives that passed after their tile's first. Reads all evidence of the
/// base, and the tiles that have some. Errors: those of the store.
absl::StatusOr<std::vector<StreetChange>> FindStreetChanges(
    const BaseMap& base, int64_t since_s, const StreetChangeOptions& options = {});

}  // namespace carmap
