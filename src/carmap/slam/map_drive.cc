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
  MappingStage(const StereoRig& rig, DriveId drive_id, const MapDriveOptions& options)
      : mapper_(rig, drive_id, options.mapper),
        closer_(LoopOptions(options), options.vocabulary),
        queue_(1) {
    if (options.sequential) return;
    thread_ = std::thread([this] {
      while (auto keyframe = queue_.Pop()) Publish(TakeIn(*keyframe));
    });
  }
  ~MappingStage() { WaitForEnd(); }

  void Insert(NewKeyframe keyframe) {
    ++inserted_;
    if (thread_.joinable()) {
      queue_.Push(std::move(keyframe));
    } else {
      Publish(TakeIn(keyframe));
    }
  }
  /// The map with all keyframes inserted so far; null before the first. Waits until it is there.
  std::shared_ptr<const LocalMap> WaitForMap() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return published_ == inserted_; });
    return local_map_;
  }
  /// From here on offers the map around this keyframe, until another is inserted.
  void MoveTo(KeyframeId id) {
    if (WaitForMap()->reference != id) local_map_ = mapper_.MapAround(id);
  }
  std::optional<LocatedFrame> Locate(const std::vector<Feature>& features,
                                     const Rigid3& predicted_map_from_camera) {
    WaitForMap();  // the mapper rests, so it can be asked from here
    auto located = mapper_.Locate(features, predicted_map_from_camera);
    if (located) local_map_ = located->local;
    return located;
  }
  size_t inserted() const { return inserted_; }
  /// Makes the map consistent as a whole. To be called last.
  void Finish() {
    WaitForEnd();
    mapper_.DropShreds();
    closer_.Finish(mapper_);
  }
  const LocalMapper& mapper() const { return mapper_; }
  const LoopCloser& closer() const { return closer_; }

 private:
  static LoopCloserOptions LoopOptions(const MapDriveOptions& options) {
    LoopCloserOptions loops = options.loops;
    loops.sequential = options.sequential;
    return loops;
  }

  std::shared_ptr<const LocalMap> TakeIn(const NewKeyframe& keyframe) {
    const KeyframeId id = keyframe.keyframe.id;
    auto local_map = mapper_.Insert(keyframe);
    return closer_.Process(id, mapper_) ? mapper_.MapAround(id) : local_map;
  }

  void WaitForEnd() {
    queue_.Close();
    if (thread_.joinable()) thread_.join();
  }

  void Publish(std::shared_ptr<const LocalMap> local_map) {
    const std::lock_guard lock(mutex_);
    local_map_ = std::move(local_map);
    ++published_;
    changed_.notify_one();
  }

  LocalMapper mapper_;
  LoopCloser closer_;
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
        front_end_(source.rig(), options),
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
        front_end_.Extract(frame.left, frame.right, &result.times));
    result.front_end_ms = watch.ElapsedMs();
    return result;
  }

  FrameSource& source_;
  StereoFrontEnd front_end_;
  size_t count_ = 0;
  cv::Mat previous_left_;
  ReadAhead reader_;
  RunAhead<ExtractedFrame> frames_;
};

TrackedFrame TrackOrRecover(const ExtractedFrame& frame, Tracker& tracker, MappingStage& mapping) {
  const auto local_map = mapping.WaitForMap();
  TrackedFrame tracked = tracker.Track(frame.timestamp, *frame.features, local_map.get());
  if (!tracked.is_misplaced) return tracked;
  const auto found = mapping.Locate(*frame.features, tracked.map_from_camera);
  return found ? tracker.Resume(frame.timestamp, *found) : tracked;
}

/// Hands the frame to the mapper if it is to be a keyframe; else the map moves along with it.
void FollowUp(const ExtractedFrame& frame, DriveId drive_id, TrackedFrame& tracked,
              MappingStage& mapping) {
  if (tracked.wants_keyframe || tracked.begins_part) {
    const KeyframeId id{drive_id, frame.index};
    mapping.Insert({{id, frame.timestamp, tracked.map_from_camera, frame.gps, frame.features},
                    tracked.landmark_of_feature,
                    tracked.begins_part,
                    tracked.gap});
    tracked.reference = id;
    tracked.camera_from_reference = {};
  } else if (tracked.reference) {
    mapping.MoveTo(*tracked.reference);
  }
}

/// Poses in the finished map: each frame moved along with its reference keyframe.
void FinishFrames(const LocalMapper& mapper, const std::vector<TrackedFrame>& frames,
                  uint32_t first_index, MappedDrive& result) {
  for (size_t i = 0; i < frames.size(); ++i) {
    std::optional<Rigid3> map_from_reference;
    if (frames[i].reference) map_from_reference = mapper.PoseOf(*frames[i].reference);
    if (map_from_reference) {
      result.trajectory[i].world_from_camera =
          *map_from_reference * frames[i].camera_from_reference.Inverse();
      continue;
    }
    result.lost_frames.push_back({first_index + static_cast<uint32_t>(i),
                                  frames[i].reference
                                      ? "the part of the map that it began was too short to be kept"
                                      : frames[i].lost_because});
  }
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
  MappingStage mapping(source.rig(), drive_id, options);
  std::vector<TrackedFrame> frames;

  for (size_t n = 0; n < source.frame_count(); ++n) {
    const ExtractedFrame frame = front_end.Next();
    TrackedFrame& tracked = frames.emplace_back();
    result.trajectory.push_back({.timestamp = frame.timestamp});
    if (frame.features) {
      mapping.WaitForMap();
      const Stopwatch watch;
      tracked = TrackOrRecover(frame, tracker, mapping);
      CountTimes(frame, watch.ElapsedMs(), result);
      FollowUp(frame, drive_id, tracked, mapping);
    } else {
      tracked.lost_because = frame.unusable_because;
    }
    if (progress) progress(n + 1, mapping.inserted());
  }

  mapping.Finish();
  const LocalMapper& mapper = mapping.mapper();
  if (mapper.map().keyframes().empty()) {
    return absl::FailedPreconditionError(
        fmt::format("no frame of {} could be tracked; the first: {}", frames.size(),
                    frames.empty() ? "there is none" : frames.front().lost_because));
  }
  FinishFrames(mapper, frames, source.first_index(), result);
  for (const std::vector<KeyframeId>& part : ConnectedParts(mapper.map())) {
    result.parts.push_back({part.front().index, part.size()});
  }
  result.map = mapper.map();
  result.rig = mapper.rig();
  result.loops = mapping.closer().loops();
  result.rejected_loop_keyframes = mapping.closer().rejected_count();
  result.georeference = mapping.closer().georeference();
  result.stage_ms["read"] = front_end.read_ms();
  for (const auto& [step, ms] : mapper.step_ms()) result.stage_ms["map_" + step] = ms;
  return result;
}

}  // namespace carmap
