#include "apps/carmap/evaluated_map.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "apps/carmap/outputs.h"
#include "carmap/base/status_macros.h"
#include "carmap/eval/localization_error.h"

namespace carmap {

absl::Status CheckTruth(const KittiDrive& drive, const std::string& folder) {
  if (!drive.truth().empty()) return absl::OkStatus();
  return absl::NotFoundError(fmt::format(
      "{}/poses.txt: no such file; with --map-truth both drives need ground truth", folder));
}

absl::StatusOr<std::unique_ptr<KittiDrive>> OpenWithTruth(const std::string& folder) {
  CARMAP_ASSIGN_OR_RETURN(auto drive, KittiDrive::Open(folder));
  CARMAP_RETURN_IF_ERROR(CheckTruth(*drive, folder));
  return drive;
}

StereoRig AsMapped(const StereoRig& rig, const LeanMap& map) {
  for (const LeanDrive& drive : map.drives) {
    if (drive.rig.camera == rig.camera && drive.rig.baseline_m == rig.baseline_m) return drive.rig;
  }
  return rig;
}

absl::StatusOr<EvaluatedMap> AlignToTruth(const LeanMap& map, const std::string& path,
                                          const std::string& truth_folder) {
  CARMAP_ASSIGN_OR_RETURN(const auto drive, OpenWithTruth(truth_folder));
  const auto alignment = AlignMapToTruth(map, drive->truth());
  if (!alignment.ok()) return WithName(path, alignment.status());
  CARMAP_ASSIGN_OR_RETURN(MapTruth truth, MapTruth::Create(map, drive->truth()));
  return EvaluatedMap{std::move(truth), *alignment};
}

void AddErrors(const EvaluatedMap& evaluated, const Rigid3& map_from_camera,
               const Rigid3& true_world_from_camera, nlohmann::ordered_json& frame) {
  const PoseError error =
      ErrorOf(evaluated.alignment.world_from_map * map_from_camera, true_world_from_camera);
  const PoseError map_error =
      ErrorOf(map_from_camera, evaluated.truth.InMap(true_world_from_camera));
  frame["position_error_m"] = error.position_m;
  frame["rotation_error_deg"] = error.rotation_deg;
  frame["map_position_error_m"] = map_error.position_m;
  frame["map_rotation_error_deg"] = map_error.rotation_deg;
}

}  // namespace carmap
