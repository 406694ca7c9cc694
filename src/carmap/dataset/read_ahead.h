// Frames of a source, read ahead while the caller works on the frames before.
//
// One thread calls Next. The source is read by a thread of this class and must be left alone, but
// for what FrameSource allows from any thread, as long as the ReadAhead lives.
#pragma once

#include <atomic>
#include <optional>

#include "carmap/base/run_ahead.h"
#include "carmap/dataset/frame_source.h"

namespace carmap {

class ReadAhead {
 public:
  /// Sequentially, frames are read on the caller's thread, when they are asked for.
  ReadAhead(FrameSource& source, bool sequential);

  /// As FrameSource::Next.
  std::optional<StereoFrame> Next() { return frames_.Next(); }

  /// Milliseconds spent reading and decoding so far.
  double read_ms() const { return read_ms_; }

 private:
  std::atomic<double> read_ms_ = 0;
  RunAhead<StereoFrame> frames_;
};

}  // namespace carmap
