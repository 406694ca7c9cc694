// Writes a simulated drive as a folder in KITTI's layout.
//
//   image_0/ image_1/   left and right images, 8-bit PNG
//   calib.txt times.txt poses.txt (enu_from_camera) gps.txt
//   world.json          options, frame of the world, models of light and sensors, changes
//   labels/             optional, 8-bit PNG of the left image: SemanticClass (labels_right/: right)
//   instances/          optional, 16-bit PNG: 0 static, 10000 + n parked, 20000 + n moving
//   depth/              optional, 16-bit PNG: metres along z times 256, 0 for sky and beyond 255 m
//
// Each file is written whole or not at all; a folder that holds a part of the same drive is
// completed, any other is left as it is.
#pragma once

#include <absl/status/status.h>

#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>

#include "carmap/sim/simulation.h"

namespace carmap {

/// Which truths to write for each pixel.
struct TruthImages {
  bool labels = false, instances = false, depth = false;
};

/// How `instances/` numbers things: these plus Placement::instance.
inline constexpr uint16_t kFirstParkedInstance = 10'000, kFirstMovingInstance = 20'000;

struct WrittenDrive {
  size_t frames = 0;
  size_t found_frames = 0;  ///< of them, that an earlier run had left
};

/// Called after each frame with the number of frames that are there.
using SimulationProgress = std::function<void(size_t frames)>;

/// Checks, before the world is built, that `folder` is new, empty, or holds a part of the drive
/// that `options` describe. Errors: FailedPrecondition for anything else, naming what differs.
absl::Status CheckDriveFolder(const std::filesystem::path& folder,
                              const nlohmann::ordered_json& options);

/// `options` goes into world.json, by which the folder is known again. Errors: as CheckDriveFolder
/// and WriteFileAtomically; frames that were written stay.
absl::StatusOr<WrittenDrive> WriteDrive(const std::filesystem::path& folder,
                                        const nlohmann::ordered_json& options,
                                        const std::vector<Change>& changes,
                                        const TruthImages& truths, Simulation& simulation,
                                        const SimulationProgress& progress = {});

}  // namespace carmap
