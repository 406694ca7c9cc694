#include "carmap/dataset/read_ahead.h"

#include <utility>

#include "carmap/base/stopwatch.h"

namespace carmap {

ReadAhead::ReadAhead(FrameSource& source, bool sequential)
    : frames_(source.frame_count(), sequential, [this, &source] {
        const Stopwatch watch;
        FrameOrError frame = source.Next();
        read_ms_ += watch.ElapsedMs();
        return frame;
      }) {}

absl::StatusOr<std::optional<StereoFrame>> ReadAhead::Next() {
  auto frame = frames_.Next();
  return frame ? std::move(*frame) : FrameOrError(std::nullopt);
}

}  // namespace carmap
