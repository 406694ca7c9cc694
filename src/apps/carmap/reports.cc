#include "apps/carmap/reports.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "apps/carmap/outputs.h"

namespace carmap {
nlohmann::ordered_json ToJson(const Summary& summary) {
  return {{"median", summary.median},
          {"mean", summary.mean},
          {"p95", summary.p95},
          {"p99", summary.p99},
          {"max", summary.max}};
}

nlohmann::ordered_json Ratio(double numerator, double denominator) {
  if (denominator <= 0) return nullptr;
  return numerator / denominator;
}

std::string ToText(const Summary& summary, int digits) {
  return fmt::format("median {:.{}f}, mean {:.{}f}, p95 {:.{}f}, max {:.{}f}", summary.median,
                     digits, summary.mean, digits, summary.p95, digits, summary.max, digits);
}

std::string Count(size_t count, const std::string& noun) {
  return fmt::format("{} {}{}", count, noun, count == 1 ? "" : "s");
}

std::string BytesText(double bytes) {
  if (bytes < 1e3) return fmt::format("{:.0f} bytes", bytes);
  if (bytes < 1e6) return fmt::format("{:.1f} kB", bytes / 1e3);
  return fmt::format("{:.2f} MB", bytes / 1e6);
}

nlohmann::ordered_json ToJson(const FitReport& report) {
  return {{"segment_keyframes_tried", report.segment_keyframes_tried},
          {"segment_keyframes_found", report.segment_keyframes_found},
          {"segment_keyframes_overlapping", report.segment_keyframes_overlapping},
          {"segment_keyframes_contradicting", report.segment_keyframes_contradicting},
          {"base_keyframes_overlapping", report.base_keyframes_overlapping},
          {"matches", report.matches},
          {"inliers", report.inliers},
          {"median_distance_m", report.median_distance_m},
          {"median_misfit_m", report.median_misfit_m},
          {"largest_strain", report.largest_strain},
          {"scale", report.scale}};
}

nlohmann::ordered_json ToJson(const std::vector<LostFrame>& lost_frames) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const LostFrame& frame : lost_frames) {
    list.push_back({{"index", frame.index}, {"reason", frame.reason}});
  }
  return list;
}

namespace {

/// Frames one after the other that were lost for the same reason.
struct LostRange {
  uint32_t first_index = 0, last_index = 0;
  std::string reason;
};

std::vector<LostRange> RangesOf(const std::vector<LostFrame>& lost_frames) {
  std::vector<LostRange> ranges;
  for (const LostFrame& frame : lost_frames) {
    if (!ranges.empty() && ranges.back().last_index + 1 == frame.index &&
        ranges.back().reason == frame.reason) {
      ranges.back().last_index = frame.index;
    } else {
      ranges.push_back({frame.index, frame.index, frame.reason});
    }
  }
  return ranges;
}

}  // namespace

void PrintLostFrames(const std::string& drive, const std::vector<LostFrame>& lost_frames) {
  constexpr size_t kMaxLines = 10;
  const std::vector<LostRange> ranges = RangesOf(lost_frames);
  for (size_t i = 0; i < std::min(kMaxLines, ranges.size()); ++i) {
    const auto& [first, last, reason] = ranges[i];
    const std::string frames = first == last ? fmt::format("frame {} is", first)
                                             : fmt::format("frames {} to {} are", first, last);
    const bool has_remedy = reason.find("; ") != std::string::npos;
    PrintProblem(
        fmt::format("{}: {} lost: {}{}", drive, frames, reason,
                    has_remedy ? "" : "; `carmap check` tells whether its images are sound"));
  }
  if (ranges.size() > kMaxLines) {
    PrintProblem(fmt::format("{}: {} lost in all; --report names each", drive,
                             Count(lost_frames.size(), "frame")));
  }
}

bool CheckWhole(const std::string& failure, const std::string& drive) {
  if (failure.empty()) return true;
  PrintProblem(fmt::format("{}: cut short: {}", drive, failure));
  return false;
}

bool CheckLabelling(const std::optional<LabellingSummary>& labelling, const std::string& segmenter,
                    const std::string& consequence) {
  if (!labelling) return true;
  std::string why = labelling->failure;
  if (why.empty() && labelling->keyframes > 0 && labelling->labelled == 0)
    why = "it told nothing of any keyframe";
  if (why.empty()) return true;
  PrintProblem(fmt::format("{}: {}: {}", segmenter, consequence, why));
  return false;
}

size_t ObservationCount(const LeanMap& map) {
  size_t count = 0;
  for (const LeanLandmark& landmark : map.landmarks) count += landmark.keyframe_idxs.size();
  return count;
}

std::string NameOf(const std::string& path) {
  const std::filesystem::path absolute = std::filesystem::absolute(path).lexically_normal();
  return (absolute.has_filename() ? absolute : absolute.parent_path()).filename().string();
}

MapPicture PictureOf(const LeanMap& map, const std::string& title, std::vector<PicturePath> paths) {
  MapPicture picture{title, {}, std::move(paths)};
  for (const LeanLandmark& landmark : map.landmarks) {
    picture.landmarks_in_map.push_back(landmark.position_in_map);
  }
  PicturePath keyframes{"keyframes", kKeyframeColour, {}, /*as_dots=*/true};
  for (const LeanKeyframe& keyframe : map.keyframes) {
    keyframes.positions_in_map.push_back(keyframe.map_from_camera.translation);
  }
  picture.paths.push_back(std::move(keyframes));
  return picture;
}

PicturePath PathOf(const std::string& name, Rgb colour, const Trajectory& trajectory,
                   const Rigid3& map_from_world) {
  PicturePath path{name, colour, {}, /*as_dots=*/false};
  for (const TimedPose& pose : trajectory) {
    if (!pose.world_from_camera) continue;
    path.positions_in_map.push_back(map_from_world * pose.world_from_camera->translation);
  }
  return path;
}

}  // namespace carmap
