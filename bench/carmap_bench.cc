// Times what is hot, as ratios to a yardstick measured in the same run.
//
// The yardstick is OpenCV's own ORB, cv::ORB::create(2000) with defaults on one thread, on both
// images of a frame. It is measured frame by frame in turn with what it is compared to, so that
// both see the same machine.

#include <fmt/format.h>
#include <tbb/global_control.h>

#include <CLI/CLI.hpp>
#include <cstdlib>
#include <opencv2/core/utility.hpp>
#include <opencv2/features2d.hpp>
#include <string>
#include <vector>

#include "bundle_bench.h"
#include "carmap/base/stopwatch.h"
#include "carmap/base/summary.h"
#include "carmap/dataset/camera_replay.h"
#include "carmap/dataset/kitti_drive.h"
#include "carmap/format/lean_codec.h"
#include "carmap/index/reconstruct.h"
#include "carmap/map/strip.h"
#include "carmap/slam/map_drive.h"

namespace carmap {
namespace {

/// Hands frames on and times the yardstick on each before the mapper sees it.
class YardstickSource : public FrameSource {
 public:
  explicit YardstickSource(FrameSource& source) : source_(source), orb_(cv::ORB::create(2000)) {}

  const StereoRig& rig() const override { return source_.rig(); }
  std::optional<size_t> frame_count() const override { return source_.frame_count(); }
  std::optional<StereoFrame> Next() override {
    auto frame = source_.Next();
    if (frame && frame->status.ok()) {
      const Stopwatch watch;
      for (const cv::Mat& image : {frame->left, frame->right}) {
        std::vector<cv::KeyPoint> keypoints;
        cv::Mat descriptors;
        orb_->detectAndCompute(image, cv::noArray(), keypoints, descriptors);
      }
      yardstick_ms.push_back(watch.ElapsedMs());
    }
    return frame;
  }

  std::vector<double> yardstick_ms;

 private:
  FrameSource& source_;
  cv::Ptr<cv::ORB> orb_;
};

void PrintRow(const std::string& what, double ms, double yardstick_ms) {
  fmt::print("{:<44} {:>8.2f} ms {:>8.3f} x\n", what, ms, ms / yardstick_ms);
}

/// As a vehicle does: the mapper takes keyframes in while the next frames are tracked.
absl::StatusOr<Summary> TrackWhileMapping(const std::string& folder, double rate_hz) {
  const auto drive = KittiDrive::Open(folder);
  if (!drive.ok()) return drive.status();
  CameraReplay camera(**drive, {.rate_hz = rate_hz, .waiting_frames = (*drive)->size()});
  const auto mapped = MapDrive(camera, (*drive)->id(), {});
  if (!mapped.ok()) return mapped.status();
  return Summarize(mapped->frame_ms);
}

int Run(const std::string& folder, int threads) {
  cv::setNumThreads(1);
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                  static_cast<size_t>(threads));
  const auto drive = KittiDrive::Open(folder);
  if (!drive.ok()) {
    fmt::print(stderr, "carmap_bench: {}\n", std::string(drive.status().message()));
    return 1;
  }
  YardstickSource source(**drive);
  MapDriveOptions options;
  options.sequential = true;
  const auto mapped = MapDrive(source, (*drive)->id(), options);
  if (!mapped.ok()) {
    fmt::print(stderr, "carmap_bench: {}: {}\n", folder, std::string(mapped.status().message()));
    return 1;
  }
  const double yardstick = Summarize(source.yardstick_ms).median;
  const Summary frame = Summarize(mapped->frame_ms);
  const auto frames = static_cast<double>(mapped->frame_ms.size());
  const auto keyframes = static_cast<double>(mapped->map.keyframes().size());

  fmt::print("{}, {} frames, {} keyframes, {} thread(s) for the front end\n\n", folder, frames,
             keyframes, threads);
  fmt::print("{:<44} {:>11} {:>10}\n", "", "time", "yardstick");
  PrintRow("yardstick: OpenCV ORB(2000), both images", yardstick, yardstick);
  PrintRow("track a stereo frame, median", frame.median, yardstick);
  PrintRow("track a stereo frame, 99th percentile", frame.p99, yardstick);
  for (const double rate_hz : {20.0, 1000.0}) {  // the latter faster than it goes
    const auto while_mapping = TrackWhileMapping(folder, rate_hz);
    if (!while_mapping.ok()) {
      fmt::print(stderr, "carmap_bench: {}: {}\n", folder,
                 std::string(while_mapping.status().message()));
      return 1;
    }
    const std::string how = fmt::format("while mapping at {} Hz", rate_hz);
    PrintRow(how + ", median", while_mapping->median, yardstick);
    PrintRow(how + ", 99th percentile", while_mapping->p99, yardstick);
  }
  for (const auto& [stage, ms] : mapped->stage_ms) {
    if (stage == "read") continue;  // the yardstick is timed in there
    const bool is_mapping = stage.starts_with("map_");
    PrintRow(fmt::format("  {} (mean a {})", stage, is_mapping ? "keyframe" : "frame"),
             ms / (is_mapping ? keyframes : frames), yardstick);
  }

  const StrippedMap stripped = Strip(mapped->map, {(*drive)->id(), mapped->rig}, {});
  Stopwatch watch;
  const auto bytes = EncodeLeanMap(stripped.lean);
  const double encode_ms = watch.ElapsedMs();
  if (!bytes.ok()) {
    fmt::print(stderr, "carmap_bench: {}\n", std::string(bytes.status().message()));
    return 1;
  }
  constexpr int kRepeats = 20;
  std::vector<double> decode_ms, rebuild_ms;
  for (int i = 0; i < kRepeats; ++i) {
    watch = Stopwatch();
    const LeanMap decoded = DecodeLeanMap(*bytes, "the map just encoded").value();
    decode_ms.push_back(watch.ElapsedMs());
    watch = Stopwatch();
    Reconstruct(decoded);
    rebuild_ms.push_back(watch.ElapsedMs());
  }
  PrintRow("encode the lean map", encode_ms, yardstick);
  PrintRow("decode it", Summarize(decode_ms).median, yardstick);
  PrintRow("rebuild its indexes", Summarize(rebuild_ms).median, yardstick);
  fmt::print("\ndecode and rebuild a keyframe: {:.3f} ms\n",
             (Summarize(decode_ms).median + Summarize(rebuild_ms).median) / keyframes);
  fmt::print(
      "lean map: {} bytes, {} landmarks, {:.1f} bytes a landmark\n", bytes->size(),
      stripped.lean.landmarks.size(),
      static_cast<double>(bytes->size()) / static_cast<double>(stripped.lean.landmarks.size()));
  fmt::print("peak memory: {:.0f} MB\n", PeakMemoryMb());
  return 0;
}

std::string DefaultDrive() {
  const char* data = std::getenv("CARMAP_DATA");
  return std::string(data ? data : CARMAP_DATA_DIR) + "/kitti06_000-050";
}

}  // namespace
}  // namespace carmap

int main(int argc, char** argv) {
  CLI::App app("Times CarMap on a drive, as ratios to OpenCV's ORB measured in the same run.");
  std::string drive = carmap::DefaultDrive();
  int threads = 2;
  app.add_option("drive", drive, "Drive folder in KITTI layout")->capture_default_str();
  app.add_option("--threads", threads, "Threads for the front end")
      ->capture_default_str()
      ->check(CLI::Range(1, 256));
  CLI11_PARSE(app, argc, argv);
  const int result = carmap::Run(drive, threads);
  carmap::BenchBundleAdjustment();
  return result;
}
