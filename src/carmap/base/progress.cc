#include "carmap/base/progress.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <utility>

namespace carmap {

Progress::Progress(std::string title, size_t total)
    : title_(std::move(title)), total_(total), on_terminal_(isatty(STDERR_FILENO) == 1) {}

Progress::~Progress() {
  if (line_open_) std::fputc('\n', stderr);
}

void Progress::Update(size_t done, const std::string& note) {
  const double now_ms = watch_.ElapsedMs();
  const double interval_ms = on_terminal_ ? 100 : 5000;
  if (now_ms - last_ms_ < interval_ms && done != total_) return;
  last_ms_ = now_ms;
  const double rate = done / std::max(now_ms * 1e-3, 1e-3);
  fmt::print(stderr, "{}{} {}/{} ({:.0f}/s){}{}{}", on_terminal_ ? "\r\033[K" : "", title_, done,
             total_, rate, note.empty() ? "" : ", ", note, on_terminal_ ? "" : "\n");
  std::fflush(stderr);
  line_open_ = on_terminal_;
}

}  // namespace carmap
