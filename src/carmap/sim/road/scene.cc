#include "carmap/sim/road/scene.h"

namespace carmap {

RoadProfile ProfileOf(Scene scene) {
  switch (scene) {
    case Scene::kSuburb:
      return {.lane_width_m = 3.1, .speed_mps = 10};
    case Scene::kDowntown:
      return {.lane_width_m = 3.25, .speed_mps = 9};
    case Scene::kFreeway:
      // The median is as wide as a lane: number 3.
      return {.lane_width_m = 3.75,
              .first_lane = -1,
              .last_lane = 2,
              .first_oncoming = 4,
              .last_oncoming = 7,
              .speed_mps = 27};
  }
  return {};
}

}  // namespace carmap
