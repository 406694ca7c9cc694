#include "carmap/slam/map_drive.h"

#include <fmt/format.h>

#include <condition_variable>
#include <memory>
#include <mutex>
#include <thread>
#include <utility>

#include "carmap/base/bounded_queue.h"
#include "carmap/base/run_ahead.h"
#include "carmap/base/stopwatch.h"
#include "carmap/dataset/image_file.h"
#include "carmap/dataset/read_ahead.h"

namespace carmap {
namespace {

/// Where the tracker hands keyframes in and finds the newest local map, on one thread or two.
class MappingStage {
 public:
  MappingStage(LocalMapper mapper, bool sequential) : mapper_(std::move(mapper)), queue_(1) {
    if (sequential) return;
    thread_ = std::thread([this] {
      while (auto keyframe = queue_.Pop()) Publish(mapper_.Insert(*keyframe));
    });
  }
  ~MappingStage() { Finish(); }

  void Insert(NewKeyframe keyframe) {
    ++inserted_;
    if (thread_.joinable()) {
      queue_.Push(std::move(keyframe));
    } else {
      Publish(mapper_.Insert(keyframe));
    }
  }
  /// The map with all keyframes inserted so far; null before the first. Waits until it is there.
  std::shared_ptr<const LocalMap> WaitForMap() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return published_ == inserted_; });
    return local_map_;
  }
  size_t inserted() const { return inserted_; }
  const LocalMapper& Finish() {
    queue_.Close();
    if (thread_.joinable()) thread_.join();
    return mapper_;
  }

 private:
  void Publish(std::shared_ptr<const LocalMap> local_map) {
    const std::lock_guard lock(mutex_);
    local_map_ = std::move(local_map);
    ++published_;
    changed_.notify_one();
  }

  LocalMapper mapper_;
  BoundedQueue<NewKeyframe> queue_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::shared_ptr<const LocalMap> local_map_;
  size_t published_ = 0;
  size_t inserted_ = 0;  ///< the tracker's own
  std::thread thread_;
};

/// A frame as it leaves the front end.
struct ExtractedFrame {
  uint32_t index = 0;
  Timestamp timestamp;
  std::optional<GpsFix> gps;
  std::shared_ptr<const std::vector<Feature>> features;  ///< null if the frame cannot be used
  std::string unusable_because;
  FrontEndTimes times;
  double front_end_ms = 0;
};

/// Reads and extracts, ahead of the tracker.
class FrontEndStage {
 public:
  FrontEndStage(FrameSource& source, const FrontEndOptions& options, bool sequential)
      : source_(source),
        options_(options),
        reader_(source, /*sequential=*/true),  // a thread of its own would slow the front end's
        frames_(source.frame_count(), sequential, [this] { return Extract(); }) {}

  ExtractedFrame Next() { return frames_.Next().value(); }
  double read_ms() const { return reader_.read_ms(); }

 private:
  ExtractedFrame Extract() {
    const size_t n = count_++;
    ExtractedFrame result{.index = source_.first_index() + static_cast<uint32_t>(n),
                          .timestamp = source_.timestamp(n)};
    const auto read = reader_.Next();
    if (!read.ok()) {
      result.unusable_because = std::string(read.status().message());
      return result;
    }
    const StereoFrame& frame = **read;
    if (HaveSamePixels(frame.left, previous_left_)) {
      result.unusable_because = "the image is the same as the one before: the camera was frozen";
      return result;
    }
    previous_left_ = frame.left;
    const Stopwatch watch;
    result.gps = frame.gps;
    result.features = std::make_shared<const std::vector<Feature>>(
        ExtractStereoFeatures(frame.left, frame.right, source_.rig(), options_, &result.times));
    result.front_end_ms = watch.ElapsedMs();
    return result;
  }

  FrameSource& source_;
  const FrontEndOptions options_;
  size_t count_ = 0;
  cv::Mat previous_left_;
  ReadAhead reader_;
  RunAhead<ExtractedFrame> frames_;
};

/// Poses in the finished map: each frame moved along with its reference keyframe.
Trajectory FinalTrajectory(const Map& map, const std::vector<TrackedFrame>& frames,
                           const std::vector<Timestamp>& timestamps) {
  Trajectory trajectory;
  for (size_t i = 0; i < frames.size(); ++i) {
    TimedPose& pose = trajectory.emplace_back();
    pose.timestamp = timestamps[i];
    if (!frames[i].reference) continue;
    pose.world_from_camera =
        map.Find(*frames[i].reference)->map_from_camera * frames[i].camera_from_reference.Inverse();
  }
  return trajectory;
}

void CountTimes(const ExtractedFrame& frame, double track_ms, MappedDrive& result) {
  result.frame_ms.push_back(frame.front_end_ms + track_ms);
  result.stage_ms["pyramid"] += frame.times.pyramid_ms;
  result.stage_ms["extract"] += frame.times.extract_ms;
  result.stage_ms["stereo"] += frame.times.stereo_ms;
  result.stage_ms["track"] += track_ms;
}

}  // namespace

absl::StatusOr<MappedDrive> MapDrive(FrameSource& source, DriveId drive_id,
                                     const MapDriveOptions& options, const MapProgress& progress) {
  MappedDrive result;
  FrontEndStage front_end(source, options.front_end, options.sequential);
  Tracker tracker(options.tracker);
  MappingStage mapping(LocalMapper(source.rig(), drive_id, options.mapper), options.sequential);
  std::vector<TrackedFrame> frames;
  std::vector<Timestamp> timestamps;

  for (size_t n = 0; n < source.frame_count(); ++n) {
    const ExtractedFrame frame = front_end.Next();
    TrackedFrame& tracked = frames.emplace_back();
    timestamps.push_back(frame.timestamp);
    if (frame.features) {
      const auto local_map = mapping.WaitForMap();
      const Stopwatch watch;
      tracked = tracker.Track(frame.timestamp, *frame.features, local_map.get());
      CountTimes(frame, watch.ElapsedMs(), result);
      if (tracked.wants_keyframe) {
        const KeyframeId id{drive_id, frame.index};
        mapping.Insert({{id, frame.timestamp, tracked.map_from_camera, frame.gps, frame.features},
                        tracked.landmark_of_feature});
        tracked.reference = id;
        tracked.camera_from_reference = {};
      }
    } else {
      tracked.lost_because = frame.unusable_because;
    }
    if (!tracked.reference) result.lost_frames.push_back({frame.index, tracked.lost_because});
    if (progress) progress(n + 1, mapping.inserted());
  }

  const LocalMapper& mapper = mapping.Finish();
  if (mapper.map().keyframes().empty()) {
    return absl::FailedPreconditionError(
        fmt::format("no frame of {} could be tracked; the first: {}", frames.size(),
                    frames.empty() ? "there is none" : frames.front().lost_because));
  }
  result.map = mapper.map();
  result.rig = mapper.rig();
  result.trajectory = FinalTrajectory(result.map, frames, timestamps);
  result.stage_ms["read"] = front_end.read_ms();
  for (const auto& [step, ms] : mapper.step_ms()) result.stage_ms["map_" + step] = ms;
  return result;
}

}  // namespace carmap
