// What a contribution measured of poses: a drive's own steps, and where the base's landmarks put
// it.
//
// Kept by the base beside the list of contributions, and never sent: a tile has poses as they were
// fitted, which tell no more what was measured. By it drives that closed a loop in the base share
// the misfit (adjust.h). Plain values; functions are pure and thread-safe.
#pragma once

#include <absl/status/statusor.h>

#include <string>
#include <string_view>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/geometry/rigid3.h"
#include "carmap/map/lean_map.h"
#include "carmap/update/segment_fit.h"

namespace carmap {

/// A keyframe of a contribution as the base's landmarks see it from a keyframe of the base.
struct AnchorConstraint {
  KeyframeId keyframe, reference;
  Rigid3 reference_from_keyframe;
  double sigma_m = 0, sigma_rad = 0;
};

struct PoseConstraints {
  LeanMap drive;                 ///< its keyframes in its own frame, without landmarks
  std::vector<DriveStep> steps;  ///< between these
  std::vector<AnchorConstraint> anchors;
};

/// The segment's keyframes and steps, without anchors.
PoseConstraints ConstraintsOf(const LeanMap& segment, std::vector<DriveStep> steps);

/// Appends the anchors of a segment that was fitted to this map, each relative to the nearest of
/// the base's keyframes.
void AddAnchors(const LeanMap& base, const LeanMap& segment,
                const std::vector<AnchoredKeyframe>& anchors, PoseConstraints& constraints);

/// Errors: as EncodeLeanMap.
absl::StatusOr<std::string> EncodeConstraints(const PoseConstraints& constraints);

/// Errors: DataLoss for bytes that are damaged, with `name`.
absl::StatusOr<PoseConstraints> DecodeConstraints(std::string_view bytes, const std::string& name);

}  // namespace carmap
