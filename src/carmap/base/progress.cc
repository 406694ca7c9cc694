#include "carmap/base/progress.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <utility>

#include "carmap/base/standard_error.h"

namespace carmap {
namespace {

/// ", 4 min left", or nothing where that is soon.
std::string TimeLeft(double seconds) {
  if (seconds < 10) return "";
  if (seconds < 100) return fmt::format(", {:.0f} s left", seconds);
  if (seconds < 6000) return fmt::format(", {:.0f} min left", seconds / 60);
  return fmt::format(", {:.1f} h left", seconds / 3600);
}

}  // namespace

Progress::Progress(std::string title, size_t total)
    : title_(std::move(title)), total_(total), on_terminal_(isatty(STDERR_FILENO) == 1) {}

Progress::~Progress() {
  if (line_open_) WriteToStandardError("\n");
}

void Progress::Update(size_t done, const std::string& note) {
  const double now_ms = watch_.ElapsedMs();
  const double interval_ms = on_terminal_ ? 100 : 5000;
  if (now_ms - last_ms_ < interval_ms && done != total_) return;
  last_ms_ = now_ms;
  const double rate = std::max<double>(done, 1) / std::max(now_ms * 1e-3, 1e-3);
  WriteToStandardError(fmt::format("{}{} {}/{} ({:.{}f}/s{}){}{}{}", on_terminal_ ? "\r\033[K" : "",
                                   title_, done, total_, rate, rate < 10 ? 1 : 0,
                                   TimeLeft(static_cast<double>(total_ - done) / rate),
                                   note.empty() ? "" : ", ", note, on_terminal_ ? "" : "\n"));
  line_open_ = on_terminal_;
}

}  // namespace carmap
