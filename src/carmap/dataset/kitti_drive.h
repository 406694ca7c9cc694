// Drives in the layout of the KITTI odometry benchmark.
//
//   DRIVE/image_0/000000.png …   left images, rectified, grey (colour files are converted)
//   DRIVE/image_1/000000.png …   right images
//   DRIVE/calib.txt              lines `P0:` and `P1:`, 3×4 row-major projection matrices
//   DRIVE/times.txt              seconds, one line a frame, ascending
//   DRIVE/poses.txt              optional ground truth, KITTI form, one line a frame
//   DRIVE/gps.txt                optional GPS fixes (gps_log.h)
//
// A drive without image_0 and image_1 may have image_2 and image_3 with `P2:` and `P3:`.
//
// Frames are numbered from 0 in the order of the image names, shorter names first (2.png
// before 10.png); .jpg, .jpeg, .pgm, .bmp, .tif and .tiff are read like .png. A frame that lacks
// one of its images, or has the time of the frame before, is given as one that cannot be read.
#pragma once

#include <absl/status/statusor.h>

#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/dataset/frame_source.h"
#include "carmap/dataset/gps_log.h"
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
  /// counts of images and of times, fewer pairs than single images, no pair that can be read,
  /// calibration with missing keys, numbers that are not finite, unequal cameras, no baseline;
  /// times that do not ascend; a range outside the drive; poses or gps lines that cannot be read.
  static absl::StatusOr<std::unique_ptr<KittiDrive>> Open(const std::filesystem::path& folder,
                                                          const FrameRange& range = {});

  const StereoRig& rig() const override { return rig_; }
  std::optional<size_t> frame_count() const override { return size(); }
  const GpsLog* gps() const override { return gps_ ? &*gps_ : nullptr; }
  std::optional<StereoFrame> Next() override;

  /// The frame of this number, of the range, whatever was read before. Thread-safe.
  StereoFrame Read(uint32_t index) const;

  /// Number of the range's first frame.
  uint32_t first() const { return first_; }
  /// Number of frames in the range.
  size_t size() const { return last_ - first_ + 1; }

  /// Hashes of calibration, first image pair and its time, and of the last frame's number: the same
  /// range has the same id everywhere.
  DriveId id() const { return id_; }
  /// Whether the id is of a run over this drive: of the range, or of one that begins with the first
  /// frame that was mapped.
  bool HasInput(DriveId id, uint32_t first_mapped) const;
  /// Unix time at the drive's time 0: 0 where times.txt is in Unix time, which is told by its
  /// numbers; else it is not known.
  std::optional<Timestamp> unix_start() const;
  /// Ground truth of the frames of the range, in the folder's own world frame; empty if there is
  /// none.
  const Trajectory& truth() const { return truth_; }

 private:
  KittiDrive() = default;

  /// Images of one size, the rig's where it is known.
  absl::Status ReadPair(uint32_t index, StereoFrame& frame) const;

  /// The first frame from `first` on that can be read; else why `first` cannot.
  absl::StatusOr<StereoFrame> FirstReadable(uint32_t first) const;

  /// Completes the rig with the size of the first pair that can be read, and computes the id.
  absl::Status FindFirstPair(const std::filesystem::path& calibration_path);

  std::vector<std::filesystem::path> left_paths_, right_paths_;
  int used_bits_ = 8;  ///< of grey levels of 16 bits
  std::vector<Timestamp> times_;
  std::map<uint32_t, absl::Status> faults_;  ///< of frames that cannot be used
  std::optional<GpsLog> gps_;                ///< absent if there is no gps.txt
  Trajectory truth_;
  StereoRig rig_;
  DriveId id_;
  uint32_t first_ = 0, last_ = 0, next_ = 0;
};

}  // namespace carmap
