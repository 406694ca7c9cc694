// What can be wrong with a drive so that what was mapped by it must not be believed.
//
// Known of the drive that found it and written into its map, so that no base takes it unawares.
#pragma once

#include <array>
#include <bitset>
#include <cstddef>
#include <cstdint>
#include <string>

namespace carmap {

/// Numbers are those of the file format.
enum class DriveFault : uint8_t {
  kOneCamera = 0,   ///< both images of a pair are the same
  kSidesSwapped,    ///< left and right images are exchanged
  kUpsideDown,      ///< the images stand on their heads
  kUnsynchronised,  ///< the images of a pair were taken one after the other
  kMisaligned,      ///< rows do not meet: the right camera is turned or shifted
  kDistorted,       ///< the images are not rectified
  kImplausibleRig,  ///< a baseline that no vehicle has
  kImpossibleMotion,
};

/// By the number of the fault.
inline constexpr std::array<const char*, 8> kDriveFaultNames = {
    "one camera", "sides swapped", "upside down",     "unsynchronised",
    "misaligned", "not rectified", "implausible rig", "impossible motion"};
inline constexpr size_t kDriveFaultCount = kDriveFaultNames.size();

inline const char* NameOf(DriveFault fault) { return kDriveFaultNames[static_cast<size_t>(fault)]; }

/// Those that were found in a drive; none of a sound one.
using DriveFaults = std::bitset<kDriveFaultCount>;

/// "unsynchronised, misaligned".
inline std::string NamesOf(const DriveFaults& faults) {
  std::string names;
  for (size_t i = 0; i < faults.size(); ++i) {
    if (!faults[i]) continue;
    if (!names.empty()) names += ", ";
    names += kDriveFaultNames[i];
  }
  return names;
}

}  // namespace carmap
