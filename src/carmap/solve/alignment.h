// Alignment of two point sequences (Horn / Umeyama).
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "carmap/geometry/rigid3.h"

namespace carmap {

/// The rigid b_from_a that minimises the squared distances between b[i] and b_from_a * a[i].
/// Nothing for fewer than three points or a different number of them. Points on one line leave the
/// turn about it free: of the solutions the one with the smallest rotation is returned.
std::optional<Rigid3> AlignRigidly(const std::vector<Eigen::Vector3d>& a,
                                   const std::vector<Eigen::Vector3d>& b);

/// The same for whole poses (world_from_camera of both), which need not be on a curve: each pose
/// counts with its position and with the tips of its three axes, drawn with a length of 1 % of the
/// path's spread (the root mean square distance from its mean). So a path as wide as a hundredth of
/// its length is aligned by its positions; on a straight road the orientations decide the turn
/// about it.
std::optional<Rigid3> AlignTrajectories(const std::vector<Rigid3>& a_from_camera,
                                        const std::vector<Rigid3>& b_from_camera);

}  // namespace carmap
