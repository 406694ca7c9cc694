// Part of every program that is built for the thread sanitizer: TBB's loops run on the thread that
// calls them.
//
// Debian's libtbb is not instrumented, so the sanitizer does not see how it hands work from thread
// to thread and would report each loop, also those of OpenCV, as a race. What the project's own
// threads share is checked in full.
#include <tbb/global_control.h>

namespace {

const tbb::global_control kOneThread(tbb::global_control::max_allowed_parallelism, 1);

}  // namespace
