// A stage of a pipeline that works ahead of whoever takes its results.
//
// One thread calls Next. Unless sequential, `produce` runs on a thread of this class, a few results
// ahead; sequentially it runs on the caller's thread, when a result is asked for.
#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <thread>
#include <utility>

#include "carmap/base/bounded_queue.h"

namespace carmap {

template <typename T>
class RunAhead {
 public:
  /// `produce` gives results until there is none; it is not called again after that.
  RunAhead(bool sequential, std::function<std::optional<T>()> produce)
      : produce_(std::move(produce)), queue_(kQueueLength) {
    if (sequential) return;
    thread_ = std::thread([this] {
      while (auto result = Produce()) {
        if (!queue_.Push(*std::move(result))) return;
      }
      queue_.Close();
    });
  }
  ~RunAhead() {
    queue_.Close();
    if (thread_.joinable()) thread_.join();
  }
  RunAhead(const RunAhead&) = delete;
  RunAhead& operator=(const RunAhead&) = delete;

  /// The results in order; nothing after the last.
  std::optional<T> Next() { return thread_.joinable() ? queue_.Pop() : Produce(); }

 private:
  static constexpr size_t kQueueLength = 2;

  std::optional<T> Produce() {
    if (is_at_end_) return std::nullopt;
    auto result = produce_();
    is_at_end_ = !result;
    return result;
  }

  const std::function<std::optional<T>()> produce_;
  bool is_at_end_ = false;  ///< the thread's own while there is one
  BoundedQueue<T> queue_;
  std::thread thread_;
};

}  // namespace carmap
