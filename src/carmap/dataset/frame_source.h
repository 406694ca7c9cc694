// Stereo frames of a drive, one after the other, recorded or live.
#pragma once

#include <absl/status/status.h>

#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <optional>

#include "carmap/base/time.h"
#include "carmap/dataset/gps_log.h"
#include "carmap/geometry/camera.h"
#include "carmap/geometry/geodesy.h"

namespace carmap {

struct StereoFrame {
  uint32_t index = 0;  ///< frame number in the drive
  Timestamp timestamp;
  cv::Mat left, right;  ///< 8-bit grey, the rig's size
  std::optional<GpsFix> gps;
  absl::Status status;  ///< not ok, naming file and cause: there are no images
};

/// Where frames come from. One thread calls Next; the other members may be read from any thread.
class FrameSource {
 public:
  virtual ~FrameSource() = default;
  virtual const StereoRig& rig() const = 0;
  /// How many frames Next will give altogether, if the source knows its end.
  virtual std::optional<size_t> frame_count() const { return std::nullopt; }
  /// The whole record of the drive's receiver, from which frames take their fixes; null if there is
  /// none.
  virtual const GpsLog* gps() const { return nullptr; }
  /// The next frame, numbers and times ascending, also one that cannot be read: its status tells.
  /// Nothing at the end. A live source waits.
  virtual std::optional<StereoFrame> Next() = 0;
};

}  // namespace carmap
