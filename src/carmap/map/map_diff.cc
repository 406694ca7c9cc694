#include "carmap/map/map_diff.h"

#include <algorithm>

namespace carmap {

absl::Status CheckOrder(const MapDiff& diff) {
  if (diff.sightings.size() > kMaxTilesSeen) {
    return absl::InvalidArgumentError("more tiles than a drive can see");
  }
  if (std::adjacent_find(diff.seen_again.begin(), diff.seen_again.end(), std::greater_equal<>()) !=
      diff.seen_again.end()) {
    return absl::InvalidArgumentError("pairs of landmarks do not ascend");
  }
  if (std::adjacent_find(diff.sightings.begin(), diff.sightings.end(),
                         [](const TileSightings& a, const TileSightings& b) {
                           return a.tile >= b.tile;
                         }) != diff.sightings.end()) {
    return absl::InvalidArgumentError("tiles that were seen do not ascend");
  }
  return absl::OkStatus();
}

}  // namespace carmap
