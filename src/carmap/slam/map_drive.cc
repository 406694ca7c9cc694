#include "carmap/slam/map_drive.h"

#include <fmt/format.h>

#include <atomic>
#include <cstring>
#include <memory>
#include <mutex>
#include <thread>
#include <utility>

#include "carmap/base/bounded_queue.h"
#include "carmap/base/stopwatch.h"

namespace carmap {
namespace {

using FrameOrError = absl::StatusOr<std::optional<StereoFrame>>;

/// Where the tracker hands keyframes in and finds the newest local map, on one thread or two.
class MappingStage {
 public:
  MappingStage(LocalMapper mapper, bool sequential)
      : mapper_(std::move(mapper)), sequential_(sequential), queue_(kQueueLength) {}
  ~MappingStage() { Finish(); }

  void Insert(NewKeyframe keyframe) {
    // There is nothing to track in before the first keyframe is in the map, so it is waited for.
    ++inserted_;
    if (sequential_ || inserted_ == 1) return Publish(mapper_.Insert(keyframe));
    if (!thread_.joinable()) {
      thread_ = std::thread([this] {
        while (auto next = queue_.Pop()) Publish(mapper_.Insert(*next));
      });
    }
    queue_.Push(std::move(keyframe));
  }
  std::shared_ptr<const LocalMap> local_map() const {
    const std::lock_guard lock(mutex_);
    return local_map_;
  }
  /// False while the local map does not hold all keyframes yet.
  bool IsUpToDate() const {
    const std::lock_guard lock(mutex_);
    return published_ == inserted_;
  }
  size_t inserted() const { return inserted_; }
  const LocalMapper& Finish() {
    queue_.Close();
    if (thread_.joinable()) thread_.join();
    return mapper_;
  }

 private:
  static constexpr size_t kQueueLength = 2;

  void Publish(std::shared_ptr<const LocalMap> local_map) {
    const std::lock_guard lock(mutex_);
    local_map_ = std::move(local_map);
    ++published_;
  }

  LocalMapper mapper_;
  const bool sequential_;
  BoundedQueue<NewKeyframe> queue_;
  mutable std::mutex mutex_;
  std::shared_ptr<const LocalMap> local_map_;
  size_t published_ = 0;
  size_t inserted_ = 0;
  std::thread thread_;
};

/// Frames of a source, read ahead on a thread of its own unless sequential.
class ReadingStage {
 public:
  ReadingStage(FrameSource& source, bool sequential) : source_(source), queue_(kQueueLength) {
    if (sequential) return;
    thread_ = std::thread([this] {
      for (size_t i = 0; i < source_.frame_count(); ++i) {
        if (!queue_.Push(ReadTimed())) return;
      }
      queue_.Close();
    });
  }
  ~ReadingStage() {
    queue_.Close();
    if (thread_.joinable()) thread_.join();
  }

  FrameOrError Next() {
    if (!thread_.joinable()) return ReadTimed();
    auto frame = queue_.Pop();
    return frame ? std::move(*frame) : FrameOrError(std::nullopt);
  }
  double read_ms() const { return read_ms_; }

 private:
  static constexpr size_t kQueueLength = 2;

  FrameOrError ReadTimed() {
    const Stopwatch watch;
    FrameOrError frame = source_.Next();
    read_ms_ += watch.ElapsedMs();
    return frame;
  }

  FrameSource& source_;
  BoundedQueue<FrameOrError> queue_;
  std::atomic<double> read_ms_ = 0;
  std::thread thread_;
};

bool SamePixels(const cv::Mat& a, const cv::Mat& b) {
  if (a.size() != b.size()) return false;
  for (int row = 0; row < a.rows; ++row) {
    if (std::memcmp(a.ptr(row), b.ptr(row), static_cast<size_t>(a.cols)) != 0) return false;
  }
  return true;
}

/// Poses in the finished map: each frame moved along with its reference keyframe.
Trajectory FinalTrajectory(const Map& map, const std::vector<TrackedFrame>& frames,
                           const std::vector<Timestamp>& timestamps) {
  Trajectory trajectory;
  for (size_t i = 0; i < frames.size(); ++i) {
    TimedPose& pose = trajectory.emplace_back();
    pose.timestamp = timestamps[i];
    if (!frames[i].reference) continue;
    pose.world_from_camera = map.Find(*frames[i].reference)->map_from_camera *
                             frames[i].camera_from_reference.Inverse();
  }
  return trajectory;
}

}  // namespace

absl::StatusOr<MappedDrive> MapDrive(FrameSource& source, DriveId drive_id, const MapDriveOptions& options,
                                     const MapProgress& progress) {
  MappedDrive result;
  ReadingStage reading(source, options.sequential);
  Tracker tracker(options.tracker);
  MappingStage mapping(LocalMapper(source.rig(), drive_id, options.mapper), options.sequential);
  std::vector<TrackedFrame> frames;
  std::vector<Timestamp> timestamps;
  cv::Mat previous_left;

  for (size_t n = 0; n < source.frame_count(); ++n) {
    FrameOrError read = reading.Next();
    if (!read.ok()) {
      frames.emplace_back().lost_because = std::string(read.status().message());
      timestamps.push_back(source.timestamp(n));
    } else {
      const StereoFrame& frame = **read;
      const Stopwatch watch;
      TrackedFrame tracked;
      if (SamePixels(frame.left, previous_left)) {
        tracked.lost_because = "the image is the same as the one before: the camera was frozen";
      } else {
        FrontEndTimes times;
        auto features = std::make_shared<const std::vector<Feature>>(
            ExtractStereoFeatures(frame.left, frame.right, source.rig(), options.front_end, &times));
        const Stopwatch tracking_watch;
        const auto local_map = mapping.local_map();
        tracked = tracker.Track(frame.timestamp, *features, local_map.get());
        result.stage_ms["track"] += tracking_watch.ElapsedMs();
        result.frame_ms.push_back(watch.ElapsedMs());
        result.stage_ms["pyramid"] += times.pyramid_ms;
        result.stage_ms["extract"] += times.extract_ms;
        result.stage_ms["stereo"] += times.stereo_ms;
        if (tracked.wants_keyframe && mapping.IsUpToDate()) {
          const KeyframeId id{drive_id, frame.index};
          mapping.Insert({{id, frame.timestamp, tracked.map_from_camera, frame.gps, features},
                          tracked.landmark_of_feature});
          tracked.reference = id;
          tracked.camera_from_reference = {};
        }
      }
      previous_left = frame.left;
      frames.push_back(std::move(tracked));
      timestamps.push_back(frame.timestamp);
    }
    if (!frames.back().reference) {
      result.lost_frames.push_back({source.first_index() + static_cast<uint32_t>(n), frames.back().lost_because});
    }
    if (progress) progress(n + 1, mapping.inserted());
  }

  const LocalMapper& mapper = mapping.Finish();
  if (mapper.map().keyframes().empty()) {
    return absl::FailedPreconditionError(fmt::format(
        "no frame of {} could be tracked; the first: {}", frames.size(),
        frames.empty() ? "there is none" : frames.front().lost_because));
  }
  result.map = mapper.map();
  result.rig = mapper.rig();
  result.trajectory = FinalTrajectory(result.map, frames, timestamps);
  result.stage_ms["read"] = reading.read_ms();
  for (const auto& [step, ms] : mapper.step_ms()) result.stage_ms["map_" + step] = ms;
  return result;
}

}  // namespace carmap
