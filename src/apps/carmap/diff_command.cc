#include <fmt/format.h>

#include <CLI/App.hpp>
#include <algorithm>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "apps/carmap/commands.h"
#include "apps/carmap/outputs.h"
#include "apps/carmap/reports.h"
#include "carmap/base/status_macros.h"
#include "carmap/base/summary.h"
#include "carmap/eval/map_picture.h"
#include "carmap/format/lean_codec.h"
#include "carmap/map/by_id.h"

namespace carmap {
namespace {

struct Arguments {
  std::string before, after, report, picture;
};

/// What is in one map and not in the other, or not as it was.
struct Changes {
  std::vector<DriveId> drives_added, drives_removed;
  std::vector<Eigen::Vector3d> landmarks_added, landmarks_removed;  ///< where they are or were
  size_t keyframes_added = 0, keyframes_removed = 0;
  size_t landmarks_seen_anew = 0;  ///< by other keyframes than before
  std::vector<double> moves_m;     ///< of keyframes that moved
  size_t landmarks_in_both = 0;
};

/// The first map in the frame of the second: by the keyframe of both that comes first.
LeanMap InFrameOf(const LeanMap& after, const LeanMap& before) {
  for (const LeanKeyframe& keyframe : before.keyframes) {
    if (const LeanKeyframe* same = FindById(after.keyframes, keyframe.id)) {
      return Moved(before, same->map_from_camera * keyframe.map_from_camera.Inverse());
    }
  }
  return before;
}

std::set<KeyframeId> SeenBy(const LeanMap& map, const LeanLandmark& landmark) {
  std::set<KeyframeId> ids;
  for (const uint32_t idx : landmark.keyframe_idxs) ids.insert(map.keyframes[idx].id);
  return ids;
}

Changes Compare(const LeanMap& before, const LeanMap& after) {
  constexpr double kMovedM = 0.001;  // maps are stored to less than that
  Changes changes;
  for (const LeanDrive& drive : after.drives) {
    if (!FindById(before.drives, drive.id)) changes.drives_added.push_back(drive.id);
  }
  for (const LeanDrive& drive : before.drives) {
    if (!FindById(after.drives, drive.id)) changes.drives_removed.push_back(drive.id);
  }
  for (const LeanKeyframe& keyframe : before.keyframes) {
    const LeanKeyframe* now = FindById(after.keyframes, keyframe.id);
    if (now == nullptr) {
      ++changes.keyframes_removed;
      continue;
    }
    const double move_m =
        (now->map_from_camera.translation - keyframe.map_from_camera.translation).norm();
    if (move_m > kMovedM) changes.moves_m.push_back(move_m);
  }
  for (const LeanKeyframe& keyframe : after.keyframes) {
    changes.keyframes_added += FindById(before.keyframes, keyframe.id) == nullptr;
  }
  for (const LeanLandmark& landmark : before.landmarks) {
    if (!FindById(after.landmarks, landmark.id)) {
      changes.landmarks_removed.push_back(landmark.position_in_map);
    }
  }
  for (const LeanLandmark& landmark : after.landmarks) {
    const LeanLandmark* then = FindById(before.landmarks, landmark.id);
    if (then == nullptr) {
      changes.landmarks_added.push_back(landmark.position_in_map);
      continue;
    }
    ++changes.landmarks_in_both;
    changes.landmarks_seen_anew += SeenBy(before, *then) != SeenBy(after, landmark);
  }
  return changes;
}

nlohmann::ordered_json ToJson(const Changes& changes) {
  const auto names = [](const std::vector<DriveId>& drives) {
    auto json = nlohmann::ordered_json::array();
    for (const DriveId& drive : drives) json.push_back(ToHex(drive));
    return json;
  };
  return {{"drives_added", names(changes.drives_added)},
          {"drives_removed", names(changes.drives_removed)},
          {"keyframes_added", changes.keyframes_added},
          {"keyframes_removed", changes.keyframes_removed},
          {"keyframes_moved", changes.moves_m.size()},
          {"move_m", ToJson(Summarize(changes.moves_m))},
          {"landmarks_added", changes.landmarks_added.size()},
          {"landmarks_removed", changes.landmarks_removed.size()},
          {"landmarks_in_both", changes.landmarks_in_both},
          {"landmarks_seen_by_others", changes.landmarks_seen_anew}};
}

absl::Status WritePicture(const LeanMap& after, const Changes& changes,
                          const Arguments& arguments) {
  constexpr Rgb kAdded{0, 130, 60}, kRemoved{220, 50, 32};
  std::vector<PicturePath> paths = {
      {fmt::format("{} landmarks removed", changes.landmarks_removed.size()), kRemoved,
       changes.landmarks_removed, /*as_dots=*/true},
      {fmt::format("{} landmarks added", changes.landmarks_added.size()), kAdded,
       changes.landmarks_added, /*as_dots=*/true}};
  return WriteMapPicture(
      arguments.picture,
      PictureOf(after, NameOf(arguments.before) + " to " + NameOf(arguments.after),
                std::move(paths)));
}

void Print(const Changes& changes) {
  const auto drives = [](const char* what, const std::vector<DriveId>& ids) {
    for (const DriveId& id : ids) fmt::print("drive {:<8}{}\n", what, ToHex(id));
  };
  drives("added", changes.drives_added);
  drives("removed", changes.drives_removed);
  fmt::print("keyframes     {} added, {} removed, {} moved", changes.keyframes_added,
             changes.keyframes_removed, changes.moves_m.size());
  if (!changes.moves_m.empty()) fmt::print(": {} m", ToText(Summarize(changes.moves_m), 3));
  fmt::print(
      "\nlandmarks     {} added, {} removed, {} in both, of which {} are seen by other "
      "keyframes than before\n",
      changes.landmarks_added.size(), changes.landmarks_removed.size(), changes.landmarks_in_both,
      changes.landmarks_seen_anew);
}

absl::StatusOr<ExitCode> RunDiff(const Arguments& arguments) {
  CARMAP_RETURN_IF_ERROR(
      CheckOutputs({arguments.report, arguments.picture}, {arguments.before, arguments.after}));
  CARMAP_ASSIGN_OR_RETURN(const LeanMap first, ReadLeanMap(arguments.before));
  CARMAP_ASSIGN_OR_RETURN(const LeanMap after, ReadLeanMap(arguments.after));
  const bool share_a_drive = std::any_of(
      first.drives.begin(), first.drives.end(),
      [&](const LeanDrive& drive) { return FindById(after.drives, drive.id) != nullptr; });
  if (!share_a_drive) {
    return absl::FailedPreconditionError(
        fmt::format("{}: has no drive in common with {}, so it is no other state of the same map; "
                    "`carmap stitch` joins maps of different drives",
                    arguments.after, arguments.before));
  }
  const LeanMap before = InFrameOf(after, first);
  const Changes changes = Compare(before, after);
  OutputFiles files;
  files.Write(arguments.report, [&] { return WriteReport(arguments.report, ToJson(changes)); });
  files.Write(arguments.picture, [&] { return WritePicture(after, changes, arguments); });
  Print(changes);
  return files.Finish() ? kSuccess : kIncomplete;
}

}  // namespace

void AddDiffCommand(CLI::App& app, Command& chosen) {
  CLI::App* command = app.add_subcommand("diff", "Say what changed between two states of a map");
  const auto arguments = std::make_shared<Arguments>();
  command->add_option("BEFORE", arguments->before, "The map as it was (.cmap)")->required();
  command->add_option("AFTER", arguments->after, "The map as it is (.cmap)")->required();
  command->add_option("--report", arguments->report, "Write the figures as JSON (m)")
      ->type_name("R.json");
  command
      ->add_option("--picture", arguments->picture, "Draw what was added and removed, from above")
      ->type_name("P.png");
  command->footer(
      R"(Both are states of one map: before and after a drive was stitched to it, or exports of a base
(`carmap base export`). Records are compared by their names, and places in the frame of AFTER.

Example:
  carmap diff base.cmap road.cmap --picture changes.png

Exit codes: 0 done, whatever changed, 1 error, 2 wrong usage, 3 a file could not be written)");
  command->callback([arguments, &chosen] { chosen = [arguments] { return RunDiff(*arguments); }; });
}

}  // namespace carmap
