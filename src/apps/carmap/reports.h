// Parts that the reports of several commands have in common.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "carmap/base/summary.h"
#include "carmap/dataset/trajectory.h"
#include "carmap/eval/map_picture.h"
#include "carmap/map/lean_map.h"
#include "carmap/slam/map_drive.h"
#include "carmap/update/fit.h"

namespace carmap {

/// {median mean p95 p99 max}
nlohmann::ordered_json ToJson(const Summary& summary);

/// Null if there is nothing to divide by.
nlohmann::ordered_json Ratio(double numerator, double denominator);

/// "median 12.3, mean 12.5, p95 13.9, max 20.1"; `digits` behind the point.
std::string ToText(const Summary& summary, int digits);

/// "3 frames", "1 frame".
std::string Count(size_t count, const std::string& noun);

/// "12.3 kB", "4.56 MB": in powers of 1000.
std::string BytesText(double bytes);

nlohmann::ordered_json ToJson(const FitReport& report);

/// [{index reason}]
nlohmann::ordered_json ToJson(const std::vector<LostFrame>& lost_frames);

/// A line for each of the first ten stretches lost for one reason on standard error, then how many
/// there are in all.
void PrintLostFrames(const std::string& drive, const std::vector<LostFrame>& lost_frames);

/// Whether the whole drive was taken: `failure` is empty, or else said on standard error.
bool CheckWhole(const std::string& failure, const std::string& drive);

/// Whether keyframes were labelled as was asked for; if not, says on standard error what follows
/// from it and why.
bool CheckLabelling(const std::optional<LabellingSummary>& labelling, const std::string& segmenter,
                    const std::string& consequence);

size_t ObservationCount(const LeanMap& map);

/// Last part of a path, for titles.
std::string NameOf(const std::string& path);

/// The map with its keyframes drawn over the paths.
MapPicture PictureOf(const LeanMap& map, const std::string& title, std::vector<PicturePath> paths);
/// The poses that are there, moved by `map_from_world`.
PicturePath PathOf(const std::string& name, Rgb colour, const Trajectory& trajectory,
                   const Rigid3& map_from_world = {});

}  // namespace carmap
