#include "apps/carmap/evaluated_map.h"

#include <fmt/format.h>

#include <map>
#include <nlohmann/json.hpp>
#include <vector>

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

namespace {

/// The ids that the drive and ranges of it have in the map, of those with keyframes there.
std::vector<DriveId> IdsOf(const KittiDrive& drive, const LeanMap& map, bool is_part_of_base) {
  std::map<DriveId, uint32_t> first_mapped;
  for (const LeanKeyframe& keyframe : map.keyframes) {
    first_mapped.try_emplace(keyframe.id.drive, keyframe.id.index);
  }
  std::vector<DriveId> ids;
  for (const auto& [id, first] : first_mapped) {
    if ((map.drives.size() == 1 && !is_part_of_base) || drive.HasInput(id, first))
      ids.push_back(id);
  }
  return ids;
}

absl::Status NotOfDrive(const LeanMap& map, const std::string& path, const std::string& folder) {
  return absl::FailedPreconditionError(
      fmt::format("{}: none of its {} drives is {}, by times and first images, or none that it has "
                  "keyframes of; name a drive that the map was made from, the first of a stitched "
                  "one",
                  path, map.drives.size(), folder));
}

}  // namespace

absl::StatusOr<EvaluatedMap> AlignToTruth(const LeanMap& map, const std::string& path,
                                          const std::string& truth_folder, bool is_part_of_base) {
  CARMAP_ASSIGN_OR_RETURN(const auto drive, OpenWithTruth(truth_folder));
  const std::vector<DriveId> ids = IdsOf(*drive, map, is_part_of_base);
  if (ids.empty()) return NotOfDrive(map, path, truth_folder);
  const LeanMap of_drive = KeyframesOf(map, ids);
  const auto alignment = AlignMapToTruth(of_drive, drive->truth());
  if (!alignment.ok()) return WithName(path, alignment.status());
  CARMAP_ASSIGN_OR_RETURN(MapTruth truth, MapTruth::Create(of_drive, drive->truth()));
  return EvaluatedMap{std::move(truth), *alignment};
}

absl::Status CheckIsOfDrive(const LeanMap& map, const std::string& path, const KittiDrive& drive,
                            const std::string& folder) {
  if (!IdsOf(drive, map, /*is_part_of_base=*/true).empty()) return absl::OkStatus();
  return NotOfDrive(map, path, folder);
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
