// The place amidst fixes of which some may be anywhere.
#pragma once

#include <vector>

#include "carmap/geometry/geodesy.h"

namespace carmap {

/// The place at the medians of the Earth-centred coordinates: up to half of the fixes, of which
/// there must be one at least, may be anywhere. Pure function, thread-safe.
GpsFix MedianPlace(const std::vector<GpsFix>& fixes);

}  // namespace carmap
