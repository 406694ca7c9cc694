// Drives in the layout of the KITTI odometry benchmark.
//
//   DRIVE/image_0/000000.png …   left images, rectified, grey (colour files are converted)
//   DRIVE/image_1/000000.png …   right images
//   DRIVE/calib.txt              lines `P0:` and `P1:`, 3×4 row-major projection matrices
//   DRIVE/times.txt              seconds, one line a frame, strictly ascending
//   DRIVE/poses.txt              optional ground truth, KITTI form, one line a frame
//   DRIVE/gps.txt                optional: `time latitude longitude altitude …`, # comments; times
//   of
//                                the camera's clock or, if they do not meet the drive's, counted
//                                from the first row. A frame takes the fix interpolated from rows
//                                within 0.15 s.
//
// Frames are numbered from 0 in the order of the image names, shorter names first (2.png
// before 10.png); .jpg, .jpeg and .pgm are read like .png.
#pragma once

#include <absl/status/statusor.h>

#include <filesystem>
#include <memory>
#include <optional>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/dataset/frame_source.h"
#include "carmap/dataset/trajectory.h"

namespace carmap {

/// First and last frame to read, both included.
struct FrameRange {
  uint32_t first = 0;
  std::optional<uint32_t> last = std::nullopt;  ///< absent: the drive's last
};

/// A drive folder, checked when opened; images are read as they are asked for.
class KittiDrive : public FrameSource {
 public:
  /// Errors, each naming file, cause and remedy: a missing folder or file, no images, unequal
  /// counts of left and right images or of times, a first image that cannot be read, calibration
  /// with missing keys, numbers that are not finite, unequal cameras, no baseline; times that do
  /// not ascend; a range outside the drive; poses or gps lines that cannot be read.
  static absl::StatusOr<std::unique_ptr<KittiDrive>> Open(const std::filesystem::path& folder,
                                                          const FrameRange& range = {});

  const StereoRig& rig() const override { return rig_; }
  std::optional<size_t> frame_count() const override { return size(); }
  std::optional<StereoFrame> Next() override;

  /// Number of frames in the range.
  size_t size() const { return last_ - first_ + 1; }

  /// Hash of calibration, times and first image pair of the range, and the range itself:
  /// the same input has the same id everywhere.
  DriveId id() const { return id_; }
  /// Ground truth of the frames of the range, in the folder's own world frame; empty if there is
  /// none.
  const Trajectory& truth() const { return truth_; }

 private:
  KittiDrive() = default;

  /// Of the rig's size.
  absl::StatusOr<cv::Mat> ReadImage(const std::filesystem::path& path) const;

  /// Completes the rig with the images' size and computes the id.
  absl::Status ReadFirstPair(const std::filesystem::path& calibration_path);

  std::vector<std::filesystem::path> left_paths_, right_paths_;
  std::vector<Timestamp> times_;
  std::vector<std::optional<GpsFix>> gps_;  ///< by frame number; empty if there is no gps.txt
  Trajectory truth_;
  StereoRig rig_;
  DriveId id_;
  uint32_t first_ = 0, last_ = 0, next_ = 0;
};

}  // namespace carmap
