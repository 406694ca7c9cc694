#include "carmap/dataset/read_ahead.h"

#include "carmap/base/stopwatch.h"

namespace carmap {

ReadAhead::ReadAhead(FrameSource& source, bool sequential)
    : frames_(sequential, [this, &source] {
        const Stopwatch watch;
        auto frame = source.Next();
        read_ms_ += watch.ElapsedMs();
        return frame;
      }) {}

}  // namespace carmap
