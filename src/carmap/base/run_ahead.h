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
  /// Calls `produce` `count` times at most.
  RunAhead(size_t count, bool sequential, std::function<T()> produce)
      : produce_(std::move(produce)), left_(count), queue_(kQueueLength) {
    if (sequential) return;
    thread_ = std::thread([this] {
      while (left_-- > 0) {
        if (!queue_.Push(produce_())) return;
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
  std::optional<T> Next() {
    if (thread_.joinable()) return queue_.Pop();
    if (left_ == 0) return std::nullopt;
    --left_;
    return produce_();
  }

 private:
  static constexpr size_t kQueueLength = 2;

  const std::function<T()> produce_;
  size_t left_;  ///< the thread's own while there is one
  BoundedQueue<T> queue_;
  std::thread thread_;
};

}  // namespace carmap
