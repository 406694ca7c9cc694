// What a scene's roads are lined with. Each goes by the seeds of the road's lines alone.
#pragma once

#include "carmap/sim/town/site.h"

namespace carmap {

/// Houses in gardens, hedges and fences, driveways, street trees.
void FurnishSuburb(Site& site);

/// Closed rows of façades with shops, broad sidewalks with all that stands on them.
void FurnishDowntown(Site& site);

/// Guard rails, sound walls, gantries, a barrier in the middle, woods beside.
void FurnishFreeway(Site& site);

}  // namespace carmap
