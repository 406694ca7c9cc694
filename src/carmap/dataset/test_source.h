// Frames without images, for the tests of what passes frames on.
#pragma once

#include "carmap/dataset/frame_source.h"

namespace carmap {

/// Frames 5 and on, a nanosecond apart. If `unreadable_every` is n > 0, each n-th cannot be read.
class EmptyFrames : public FrameSource {
 public:
  explicit EmptyFrames(size_t count, uint32_t unreadable_every = 0)
      : count_(count), unreadable_every_(unreadable_every) {}

  const StereoRig& rig() const override { return rig_; }
  std::optional<size_t> frame_count() const override { return count_; }
  std::optional<StereoFrame> Next() override {
    if (next_ == count_) return std::nullopt;
    const uint32_t n = next_++;
    StereoFrame frame{.index = 5 + n, .timestamp = {static_cast<int64_t>(n)}};
    if (unreadable_every_ > 0 && (n + 1) % unreadable_every_ == 0)
      frame.status = absl::DataLossError("unreadable");
    return frame;
  }

 private:
  const size_t count_;
  const uint32_t unreadable_every_;
  StereoRig rig_;
  uint32_t next_ = 0;
};

}  // namespace carmap
