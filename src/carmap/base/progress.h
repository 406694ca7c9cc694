// Progress of long work, told to a person at a terminal.
//
// On a terminal one line is rewritten in place; elsewhere a line appears every few seconds.
// Not thread-safe: one thread reports.
#pragma once

#include <cstddef>
#include <string>

#include "carmap/base/stopwatch.h"

namespace carmap {

class Progress {
 public:
  /// `total` steps of work called `title`, e.g. "mapping". Writes to standard error.
  Progress(std::string title, size_t total);
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// `done` steps are finished; `note` says more, e.g. "23 keyframes".
  void Update(size_t done, const std::string& note = {});

 private:
  const std::string title_;
  const size_t total_;
  const bool on_terminal_;
  Stopwatch watch_;
  double last_ms_ = -1e9;
  bool line_open_ = false;
};

}  // namespace carmap
