// The drive's frames as the tracker takes them: read, checked and turned into features, ahead of
// it.
//
// One thread calls Next. The source must be left alone as long as this lives.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <vector>

#include "carmap/base/run_ahead.h"
#include "carmap/base/time.h"
#include "carmap/dataset/frame_source.h"
#include "carmap/dataset/read_ahead.h"
#include "carmap/feature/stereo_features.h"
#include "carmap/geometry/geodesy.h"
#include "carmap/slam/pair_check.h"

namespace carmap {

/// A frame as it leaves the front end.
struct ExtractedFrame {
  uint32_t index = 0;  ///< frame number in the drive
  Timestamp timestamp;
  std::optional<GpsFix> gps;
  cv::Mat left, right;  ///< as the cameras gave them; empty if there are no features
  /// Null if the frame cannot be used, or repeats an image.
  std::shared_ptr<const std::vector<Feature>> features;
  std::string unusable_because;
  bool repeats_image = false;       ///< of the frame before, and so has no features of its own
  std::optional<CheckedPair> pair;  ///< of some frames
  FrontEndTimes times;
  double front_end_ms = 0;
};

class FrameExtraction {
 public:
  /// Sequentially, all is done on the caller's thread, when a frame is asked for.
  FrameExtraction(FrameSource& source, const FrontEndOptions& options, bool sequential);

  /// The frames in order, also those that cannot be used; nothing after the last. Throws what the
  /// source threw, after the frames before.
  std::optional<ExtractedFrame> Next() { return frames_.Next(); }

  const StereoFrontEnd& front_end() const { return front_end_; }
  /// Milliseconds spent reading and decoding so far.
  double read_ms() const { return reader_.read_ms(); }

 private:
  std::optional<ExtractedFrame> Extract();

  /// Looks at the pair of every tenth frame that has features, and at the next if images may have
  /// been lost.
  void CheckPair(ExtractedFrame& frame);

  StereoFrontEnd front_end_;
  size_t extracted_ = 0;
  bool looks_again_ = false;
  cv::Mat previous_left_;
  Timestamp previous_since_;  ///< of the first frame that showed it
  size_t repeats_ = 0;        ///< frames since that showed it too
  ReadAhead reader_;
  RunAhead<ExtractedFrame> frames_;
};

}  // namespace carmap
