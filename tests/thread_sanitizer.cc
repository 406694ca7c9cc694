// Part of every program that is built for the thread sanitizer: what libraries that are not
// instrumented, as Debian builds them, would make it report.
#include <tbb/global_control.h>

namespace {

// The sanitizer does not see how TBB hands work from thread to thread and would report each loop,
// also those of OpenCV, as a race. So loops run on the thread that calls them; what the project's
// own threads share is checked in full.
const tbb::global_control kOneThread(tbb::global_control::max_allowed_parallelism, 1);

}  // namespace

// GDAL, which OpenCV asks whether it can write an image, makes its locks while it holds others.
// RocksDB guards what its threads share by means that the sanitizer does not see.
extern "C" const char* __tsan_default_suppressions() {
  return "deadlock:libgdal.so\nrace:librocksdb.so\n";
}
