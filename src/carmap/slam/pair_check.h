// Whether the image pairs of a drive belong together and are what the calibration says.
//
// Pure functions on values.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "carmap/feature/pair_geometry.h"
#include "carmap/feature/stereo_features.h"
#include "carmap/geometry/camera.h"
#include "carmap/map/drive_fault.h"

namespace carmap {

/// One pair of a drive, looked at.
struct CheckedPair {
  uint32_t index = 0;  ///< frame number in the drive
  PairGeometry geometry;
  double brightness_ratio = 1;  ///< of the right image to the left one
};

/// Something that contradicts a sound rig or a vehicle, with what to do about it.
struct Suspicion {
  DriveFault fault;
  uint32_t first_index = 0, last_index = 0;  ///< frames between which it was seen
  std::string finding, remedy;
};

/// Medians over the pairs that show enough.
struct PairHealth {
  size_t pairs = 0, telling_pairs = 0;  ///< looked at; that show enough
  double row_offset_px = 0;     ///< right image lower by, in its middle, the camera's pixels
  double row_slope_px = 0;      ///< by how much more at the right border than at the left
  double before_baselines = 0;  ///< right camera's place before the left one
  double distortion = 0;        ///< as PairGeometry
  double brightness_ratio = 1;
};

/// `camera`: of the drive's own images.
PairHealth Summarize(const PinholeCamera& camera, const std::vector<CheckedPair>& pairs);

/// What the pairs, in the order of the drive, show to be wrong: what most of them show, and images
/// that several one after the other show to be out of step or the same.
std::vector<Suspicion> JudgePairs(const StereoRig& rig, const std::vector<CheckedPair>& pairs);

/// The fault that one pair shows by itself; nothing if it shows none or too little.
std::optional<DriveFault> FaultOf(const PairGeometry& geometry);

/// Cameras are mounted once, but images can be lost or repeated at any time.
bool CanBeginLater(DriveFault fault);

/// By how much the right images are shifted and turned, if that is what the pairs show and so
/// little that it can be undone.
std::optional<RowMisalignment> CorrectableMisalignment(const std::vector<CheckedPair>& pairs);

}  // namespace carmap
