#include "carmap/update/stitch.h"

#include <fmt/format.h>

#include "carmap/base/status_macros.h"

namespace carmap {

absl::StatusOr<StitchedMap> Stitch(const LeanMap& base, const LeanMap& segment,
                                   const StitchOptions& options) {
  for (const LeanDrive& drive : segment.drives) {
    if (FindDrive(base.drives, drive.id) == nullptr) continue;
    return absl::AlreadyExistsError(
        fmt::format("drive {} of the segment is in the base map already; stitch each segment once",
                    ToHex(drive.id)));
  }
  if (base.keyframes.empty()) {
    CARMAP_RETURN_IF_ERROR(CheckConsistency(segment));
    return StitchedMap{segment, {}, segment.keyframes.size()};
  }
  CARMAP_ASSIGN_OR_RETURN(const FittedSegment fitted, Fit(base, segment, options.fit));
  CARMAP_ASSIGN_OR_RETURN(LeanMap merged, Apply(fitted.diff, base, options.apply));
  const size_t added = merged.keyframes.size() - base.keyframes.size();
  return StitchedMap{std::move(merged), fitted.report, added};
}

}  // namespace carmap
