// Stereo frames of a drive, one after the other.
#pragma once

#include <absl/status/statusor.h>

#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <optional>

#include "carmap/base/time.h"
#include "carmap/geometry/camera.h"
#include "carmap/geometry/geodesy.h"

namespace carmap {

struct StereoFrame {
  uint32_t index = 0;  ///< frame number in the drive's folder
  Timestamp timestamp;
  cv::Mat left, right;  ///< 8-bit grey, the rig's size
  std::optional<GpsFix> gps;
};

/// Where frames come from. One thread calls Next; the other members may be read from any thread.
class FrameSource {
 public:
  virtual ~FrameSource() = default;
  virtual const StereoRig& rig() const = 0;
  /// How many frames Next will give altogether.
  virtual size_t frame_count() const = 0;
  /// Number in the drive's folder of the first frame that Next gives.
  virtual uint32_t first_index() const = 0;
  /// Time of the n-th frame that Next gives.
  virtual Timestamp timestamp(size_t n) const = 0;
  /// The next frame; nothing at the end. An unreadable frame is an error naming the file; the call
  /// after it goes on with the frame that follows.
  virtual absl::StatusOr<std::optional<StereoFrame>> Next() = 0;
};

}  // namespace carmap
