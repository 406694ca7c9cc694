// The image pairs of a recorded drive, looked at without mapping it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "carmap/dataset/kitti_drive.h"
#include "carmap/feature/stereo_features.h"
#include "carmap/slam/pair_check.h"

namespace carmap {

/// A pair, and what the front end makes of it.
struct SampledPair {
  CheckedPair pair;
  size_t features = 0, with_depth = 0;
};

/// Numbers of so many frames of the drive at most, evenly spread, the first and the last among
/// them.
std::vector<uint32_t> SpreadOver(const KittiDrive& drive, size_t count);

/// These frames, on all cores; those that cannot be read are left out. `misalignment`: as
/// FrontEndOptions.
std::vector<SampledPair> SamplePairs(const KittiDrive& drive, const std::vector<uint32_t>& indices,
                                     const RowMisalignment& misalignment = {});

std::vector<CheckedPair> PairsOf(const std::vector<SampledPair>& sample);

/// FrontEndOptions::misalignment for this drive: what is wrong with its right images, if that can
/// be undone; else zero. Three pairs are read of a sound drive.
RowMisalignment FindMisalignment(const KittiDrive& drive);

/// The first frame from which on pairs show the fault, of those between one that does not and one
/// that does; by halves.
uint32_t FindOnset(const KittiDrive& drive, DriveFault fault, uint32_t sound_index,
                   uint32_t faulty_index);

}  // namespace carmap
