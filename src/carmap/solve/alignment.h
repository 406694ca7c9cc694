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

/// The same for whole poses: each counts by its position and by the tips of its axes, 5 m away.
/// Mapping knows positions to centimetres and orientations to some milliradians, so a tip is about
/// as good a point as the position; positions alone would leave the turn about a straight road to
/// their noise.
std::optional<Rigid3> AlignTrajectories(const std::vector<Rigid3>& a_from_camera,
                                        const std::vector<Rigid3>& b_from_camera);

}  // namespace carmap
