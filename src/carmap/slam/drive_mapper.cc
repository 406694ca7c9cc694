#include "carmap/slam/drive_mapper.h"

#include <fmt/format.h>

#include <condition_variable>
#include <exception>
#include <mutex>
#include <thread>
#include <utility>

#include "carmap/base/bounded_queue.h"
#include "carmap/base/exceptions.h"
#include "carmap/base/stopwatch.h"
#include "carmap/slam/map_parts.h"
#include "carmap/slam/repeated_frames.h"

namespace carmap {

/// Where the tracker hands keyframes in and finds the newest local map, on one thread or two. What
/// mapping throws is thrown to whoever asks for the map, from then on.
class DriveMapper::MappingStage {
 public:
  MappingStage(const StereoRig& rig, DriveId drive_id, const MapDriveOptions& options)
      : mapper_(rig, drive_id, options.mapper),
        closer_(LoopOptions(options), options.vocabulary),
        queue_(1) {
    if (options.sequential) return;
    thread_ = std::thread([this] {
      while (auto keyframe = queue_.Pop()) Process(*keyframe);
    });
  }
  ~MappingStage() { WaitForEnd(); }

  void Insert(NewKeyframe keyframe) {
    ++inserted_;
    if (thread_.joinable()) {
      queue_.Push(std::move(keyframe));
    } else {
      Process(keyframe);
    }
  }
  /// The map with all keyframes inserted so far; null before the first. Waits until it is there.
  std::shared_ptr<const LocalMap> WaitForMap() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return published_ == inserted_; });
    if (failure_) std::rethrow_exception(failure_);
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
  /// The mapper at rest, with all keyframes inserted so far in its map, even if it failed.
  const LocalMapper& WaitForMapper() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return published_ == inserted_; });
    return mapper_;
  }
  size_t inserted() const { return inserted_; }
  /// Makes the map consistent as a whole, once the last labels are there. To be called last.
  void Finish(const std::vector<LabelledKeyframe>& labelled) {
    WaitForMap();
    WaitForEnd();
    mapper_.TakeLabels(labelled);
    mapper_.EraseShortParts();
    closer_.Finish(mapper_);
  }
  /// To be asked once the stage is finished.
  const LocalMapper& mapper() const { return mapper_; }
  Map ReleaseMap() { return mapper_.ReleaseMap(); }
  const LoopCloser& closer() const { return closer_; }

 private:
  static LoopCloserOptions LoopOptions(const MapDriveOptions& options) {
    LoopCloserOptions loops = options.loops;
    loops.sequential = options.sequential;
    return loops;
  }

  void Process(const NewKeyframe& keyframe) {
    std::shared_ptr<const LocalMap> local_map;
    std::exception_ptr failure;
    try {
      local_map = AddToMap(keyframe);
    } catch (...) {
      failure = std::current_exception();
    }
    Publish(std::move(local_map), std::move(failure));
  }

  std::shared_ptr<const LocalMap> AddToMap(const NewKeyframe& keyframe) {
    const KeyframeId id = keyframe.keyframe.id;
    auto local_map = mapper_.Insert(keyframe);
    return closer_.Process(id, mapper_) ? mapper_.MapAround(id) : local_map;
  }

  void WaitForEnd() {
    queue_.Close();
    if (thread_.joinable()) thread_.join();
  }

  void Publish(std::shared_ptr<const LocalMap> local_map, std::exception_ptr failure) {
    const std::lock_guard lock(mutex_);
    local_map_ = std::move(local_map);
    failure_ = std::move(failure);
    ++published_;
    changed_.notify_one();
  }

  LocalMapper mapper_;
  LoopCloser closer_;
  BoundedQueue<NewKeyframe> queue_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::shared_ptr<const LocalMap> local_map_;
  std::exception_ptr failure_;
  size_t published_ = 0;
  size_t inserted_ = 0;  ///< the tracker's own
  std::thread thread_;
};

DriveMapper::DriveMapper(const StereoRig& camera_rig, const StereoRig& rig, DriveId drive_id,
                         const MapDriveOptions& options)
    : drive_id_(drive_id),
      max_bias_px_(options.mapper.bias.max_rad * rig.camera.fx),
      health_(camera_rig, rig),
      calibrated_bias_(rig.disparity_bias),
      tracker_(options.tracker),
      mapping_(std::make_unique<MappingStage>(rig, drive_id, options)) {
  if (!options.segmenter) return;
  LabellingOptions labelling = options.labelling;
  labelling.sequential = options.sequential;
  labeller_.emplace(options.segmenter, labelling, cv::Size(rig.camera.width, rig.camera.height));
}
DriveMapper::~DriveMapper() = default;

size_t DriveMapper::keyframe_count() const { return mapping_->inserted(); }

const TrackedFrame& DriveMapper::Take(const ExtractedFrame& frame) {
  tracked_ = {};
  last_frame_ms_ = 0;
  if (frame.features) {
    mapping_->WaitForMap();
    const Stopwatch watch;
    tracked_ = TrackOrRecover(frame);
    CountTimes(frame, watch.ElapsedMs());
    TakeHealth(frame, tracked_);
    FollowUp(frame, tracked_);
  } else {
    tracked_.lost_because = frame.repeats_image
                                ? "its image is that of the frame before, which was lost"
                                : frame.unusable_because;
  }
  result_.trajectory.push_back({.timestamp = frame.timestamp});
  frames_.push_back({frame.index, tracked_.reference, tracked_.camera_from_reference,
                     tracked_.lost_because, frame.repeats_image});
  return tracked_;
}

TrackedFrame DriveMapper::TrackOrRecover(const ExtractedFrame& frame) {
  const auto local_map = mapping_->WaitForMap();
  TrackedFrame tracked = tracker_.Track(frame.timestamp, *frame.features, local_map.get());
  if (tracked.is_misplaced) {
    const auto found = mapping_->Locate(*frame.features, tracked.map_from_camera);
    if (found) tracked = tracker_.Resume(frame.timestamp, *found);
  }
  tracked.disparity_bias = local_map ? local_map->rig.disparity_bias : calibrated_bias_;
  return tracked;
}

/// The frame's fix, unless the receiver only repeats itself.
std::optional<GpsFix> DriveMapper::FreshFix(const ExtractedFrame& frame,
                                            const TrackedFrame& tracked) {
  const bool is_placed = tracked.reference || tracked.wants_keyframe || tracked.begins_part;
  if (!frame.gps || !is_placed) return frame.gps;
  const Eigen::Vector3d& p_in_map = tracked.map_from_camera.translation;
  return freeze_detector_.IsFrozen(*frame.gps, p_in_map) ? std::nullopt : frame.gps;
}

/// Hands the frame to the mapper if it is to be a keyframe; else the map moves along with it.
void DriveMapper::FollowUp(const ExtractedFrame& frame, TrackedFrame& tracked) {
  const std::optional<GpsFix> fix = FreshFix(frame, tracked);
  if (tracked.wants_keyframe || tracked.begins_part) {
    const KeyframeId id{drive_id_, frame.index};
    NewKeyframe keyframe{
        .keyframe = {id, frame.timestamp, tracked.map_from_camera, fix, frame.features},
        .landmark_of_feature = tracked.landmark_of_feature,
        .begins_part = tracked.begins_part,
        .gap = tracked.gap};
    if (labeller_)
      keyframe.labelled = labeller_->Offer(id, frame.index, frame.left, frame.features);
    mapping_->Insert(std::move(keyframe));
    if (!tracked.reference) tracker_.BeginAt(frame.timestamp, id);
    tracked.reference = id;
    tracked.camera_from_reference = {};
  } else if (tracked.reference) {
    mapping_->MoveTo(*tracked.reference);
  }
}

void DriveMapper::CountTimes(const ExtractedFrame& frame, double track_ms) {
  last_frame_ms_ = frame.front_end_ms + track_ms;
  result_.frame_ms.push_back(last_frame_ms_);
  result_.stage_ms["pyramid"] += frame.times.pyramid_ms;
  result_.stage_ms["extract"] += frame.times.extract_ms;
  result_.stage_ms["stereo"] += frame.times.stereo_ms;
  result_.stage_ms["track"] += track_ms;
}

void DriveMapper::TakeHealth(const ExtractedFrame& frame, const TrackedFrame& tracked) {
  if (frame.pair) health_.TakePair(*frame.pair);
  health_.TakeFeatures(*frame.features);
  std::vector<uint32_t> feature_idxs;
  for (const auto& [landmark_id, feature_idx] : tracked.landmark_of_feature) {
    feature_idxs.push_back(feature_idx);
  }
  health_.TakeTracked(*frame.features, feature_idxs);
}

const Map& DriveMapper::map() const { return mapping_->WaitForMapper().map(); }
const StereoRig& DriveMapper::rig() const { return mapping_->WaitForMapper().rig(); }

DriveHealth DriveMapper::Health(const Trajectory& trajectory) const {
  std::vector<uint32_t> frame_indices;
  for (const TakenFrame& frame : frames_) frame_indices.push_back(frame.index);
  const LocalMapper& mapper = mapping_->WaitForMapper();
  return health_.Judge(trajectory, frame_indices, mapper.map().keyframes().size(),
                       mapper.rig().disparity_bias, max_bias_px_);
}

/// Poses in the finished map: each frame moved along with its reference keyframe.
void DriveMapper::FinishFrames() {
  std::vector<size_t> repeated;
  for (size_t i = 0; i < frames_.size(); ++i) {
    const TakenFrame& frame = frames_[i];
    if (frame.repeats_image) repeated.push_back(i);
    if (!frame.reference) continue;
    if (const auto map_from_reference = mapping_->mapper().PoseOf(*frame.reference)) {
      result_.trajectory[i].world_from_camera =
          *map_from_reference * frame.camera_from_reference.Inverse();
    }
  }
  PlaceRepeatedFrames(repeated, result_.trajectory);
  for (size_t i = 0; i < frames_.size(); ++i) {
    const TakenFrame& frame = frames_[i];
    if (result_.trajectory[i].world_from_camera) continue;
    result_.lost_frames.push_back(
        {frame.index, frame.reference ? "the part of the map that it began was too short to be kept"
                                      : frame.lost_because});
  }
}

std::optional<LabellingSummary> DriveMapper::labelling() const {
  if (!labeller_) return std::nullopt;
  return LabellingSummary{labeller_->offered(), labeller_->labelled(), labeller_->failure()};
}

/// What the pairs show is the cause, if they show anything.
absl::Status DriveMapper::NoFrameTracked() const {
  const std::vector<Suspicion> suspicions = Health(result_.trajectory).suspicions;
  if (!suspicions.empty()) {
    return absl::FailedPreconditionError(fmt::format("no frame of {} could be tracked: {}; {}",
                                                     frames_.size(), suspicions.front().finding,
                                                     suspicions.front().remedy));
  }
  return absl::FailedPreconditionError(
      fmt::format("no frame of {} could be tracked; the first: {}", frames_.size(),
                  frames_.empty() ? "there is none" : frames_.front().lost_because));
}

absl::StatusOr<MappedDrive> DriveMapper::Finish() {
  const absl::Status finished = CatchExceptions(
      [&] { mapping_->Finish(labeller_ ? labeller_->Finish() : std::vector<LabelledKeyframe>()); });
  result_.labelling = labelling();
  result_.failure = std::string(finished.message());
  const LocalMapper& mapper = mapping_->mapper();
  if (!finished.ok() &&
      (mapper.map().keyframes().empty() || !CheckConsistency(mapper.map()).ok())) {
    return finished;
  }
  if (mapper.map().keyframes().empty()) {
    return NoFrameTracked();
  }
  FinishFrames();
  result_.health = Health(result_.trajectory);
  for (const std::vector<KeyframeId>& part : ConnectedParts(mapper.map())) {
    result_.parts.push_back({part.front().index, part.size()});
  }
  result_.rig = mapper.rig();
  result_.loops = mapping_->closer().loops();
  result_.rejected_loop_keyframes = mapping_->closer().rejected_count();
  result_.georeference = mapping_->closer().georeference();
  for (const auto& [step, ms] : mapper.step_ms()) result_.stage_ms["map_" + step] = ms;
  for (const auto& [step, count] : mapper.left_out()) result_.left_out["map_" + step] = count;
  result_.map = mapping_->ReleaseMap();
  return std::move(result_);
}

}  // namespace carmap
