// A recorded drive at the pace of a camera: whether a machine keeps up with it.
#pragma once

#include <chrono>
#include <cstddef>
#include <optional>

#include "carmap/dataset/frame_source.h"

namespace carmap {

struct CameraReplayOptions {
  double rate_hz = 10;        ///< > 0; time stamps stay the recording's
  size_t waiting_frames = 3;  ///< that the camera holds for who takes them
};

/// Gives each frame of `source` when its time has come, the first at once. A camera does not wait:
/// while `waiting_frames` are not taken, a newer one displaces the oldest, whose status is
/// Unavailable, and which is counted.
class CameraReplay : public FrameSource {
 public:
  CameraReplay(FrameSource& source, const CameraReplayOptions& options)
      : source_(source), options_(options) {}

  const StereoRig& rig() const override { return source_.rig(); }
  std::optional<size_t> frame_count() const override { return source_.frame_count(); }
  const GpsLog* gps() const override { return source_.gps(); }
  std::optional<StereoFrame> Next() override;

  /// To be read once the drive is over.
  size_t dropped_count() const { return dropped_count_; }

 private:
  using Clock = std::chrono::steady_clock;

  FrameSource& source_;
  const CameraReplayOptions options_;
  std::optional<Clock::time_point> start_;  ///< when the first frame was given
  size_t taken_ = 0, dropped_count_ = 0;
};

}  // namespace carmap
