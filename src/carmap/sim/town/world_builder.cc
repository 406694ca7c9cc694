#include "carmap/sim/town/world_builder.h"

#include <utility>

#include "carmap/sim/town/ground_mesh.h"
#include "carmap/sim/town/scenes.h"
#include "carmap/sim/town/site.h"

namespace carmap {

World BuildWorld(Scene scene, const Route& route, const std::vector<Eigen::Vector3d>& heights,
                 uint64_t seed) {
  Site site(scene, route, heights, seed);
  AddTerrain(site);
  switch (scene) {
    case Scene::kSuburb:
      FurnishSuburb(site);
      break;
    case Scene::kDowntown:
      FurnishDowntown(site);
      break;
    case Scene::kFreeway:
      FurnishFreeway(site);
      break;
  }
  return std::move(site).Finish();
}

}  // namespace carmap
