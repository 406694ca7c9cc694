// A small stereo drive with known truth, made on the spot: a street of textured planes, rendered by
// casting a ray through each pixel. For tests that run without real data.
#pragma once

#include <filesystem>
#include <vector>

#include "carmap/geometry/camera.h"
#include "carmap/geometry/rigid3.h"

namespace carmap {

inline const StereoRig kTestRig{{220, 220, 159.5, 79.5, 320, 160}, 0.5};

/// Poses of the left camera, 0.8 m apart, a slight bend.
std::vector<Rigid3> TestDrivePoses(size_t frames);

/// Writes the folder in KITTI's layout, with poses.txt. Frames are 0.1 s apart, from 0. The same
/// `world` gives the same street.
void WriteTestDrive(const std::filesystem::path& folder, const std::vector<Rigid3>& poses,
                    uint32_t world = 1);

}  // namespace carmap
