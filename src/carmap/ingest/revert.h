// Takes a contribution back (paper §3.4 leaves open what to do with a bad one).
//
// By patches, like all that changes the base: what nobody touched since becomes what it was before.
// Of what others changed later, landmarks that the drive alone saw go, and it leaves the lists of
// the others; keyframes of it on which others' landmarks hang stay.
#pragma once

#include <absl/status/statusor.h>

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "carmap/ingest/base_map.h"

namespace carmap {

struct Reversion {
  std::string name;                ///< as which it was added
  std::vector<TileVersion> tiles;  ///< that changed
  size_t keyframes_removed = 0, landmarks_removed = 0, landmarks_restored = 0;
  size_t keyframes_kept = 0;  ///< since landmarks that others saw hang on them
  uint64_t sequence = 0;
};

/// `drive` is the beginning of the drive's id in hexadecimal digits, enough to tell it from others.
/// All its parts, and all drives that were added with it, are taken back. Errors: NotFound (no such
/// contribution), InvalidArgument (several, or less than six digits), FailedPrecondition (what it
/// changed has been joined to another component since), those of the store.
absl::StatusOr<Reversion> Revert(const std::string& drive, BaseMap& base);

}  // namespace carmap
