// The sliding-window adjustment against Ceres on the same problem.
#pragma once

namespace carmap {

/// Prints both times and the costs that they reach, for a window like the local mapper's.
void BenchBundleAdjustment();

}  // namespace carmap
