// Where on the Earth a drive was: its frame brought into `enu` by its GPS fixes.
//
// Pure and deterministic.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "carmap/geometry/rigid3.h"

namespace carmap {

/// A camera of the drive and the fix taken there.
struct CameraFix {
  Rigid3 map_from_camera;
  Eigen::Vector3d p_in_enu = Eigen::Vector3d::Zero();
  Eigen::Vector3d sigma_m = Eigen::Vector3d::Ones();  ///< of the fix, along east, north and up
};

/// The enu_from_map that brings most cameras near their fixes. Cars are upright on the whole, which
/// tells up from the cameras themselves; heading and place are those on which most pairs of fixes
/// agree, refined together with the tilt. Up to half of the fixes may be anywhere. The path may
/// have drifted by some per cent of its length.
///
/// Nothing if the fixes that agree span less than `min_extent_m`: they tell no heading; nor if most
/// fixes are further off, horizontally, than two standard deviations: then they are not of this
/// path.
std::optional<Rigid3> AlignToFixes(const std::vector<CameraFix>& fixes, double min_extent_m = 30,
                                   uint64_t seed = 1);

}  // namespace carmap
