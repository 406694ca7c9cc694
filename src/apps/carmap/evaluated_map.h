// A map that is to be evaluated, with the truth of the drive that it was made from.
#pragma once

#include <absl/status/statusor.h>

#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "carmap/dataset/kitti_drive.h"
#include "carmap/eval/localization_error.h"
#include "carmap/eval/map_truth.h"
#include "carmap/geometry/rigid3.h"
#include "carmap/map/lean_map.h"

namespace carmap {

/// NotFound without poses.txt in the drive's folder.
absl::Status CheckTruth(const KittiDrive& drive, const std::string& folder);

/// Errors: as KittiDrive::Open and CheckTruth.
absl::StatusOr<std::unique_ptr<KittiDrive>> OpenWithTruth(const std::string& folder);

struct EvaluatedMap {
  MapTruth truth;
  MapAlignment alignment;
};

/// `map` was read from `path`, and made of the drive in `truth_folder`, of ranges of it, and of
/// other drives, whose keyframes do not count. A map of one drive, unless it is a part of a base,
/// is taken to be of this one: its times will tell. Errors: as OpenWithTruth and AlignMapToTruth;
/// FailedPrecondition where it cannot be told which of several drives is the one.
absl::StatusOr<EvaluatedMap> AlignToTruth(const LeanMap& map, const std::string& path,
                                          const std::string& truth_folder,
                                          bool is_part_of_base = false);

/// FailedPrecondition unless the drive, or a range of it, is one of those that the map was made
/// from.
absl::Status CheckIsOfDrive(const LeanMap& map, const std::string& path, const KittiDrive& drive,
                            const std::string& folder);

/// Adds a frame's errors against the truth and against the map's own trajectory, in metres and
/// degrees.
void AddErrors(const EvaluatedMap& evaluated, const Rigid3& map_from_camera,
               const Rigid3& true_world_from_camera, nlohmann::ordered_json& frame);

}  // namespace carmap
