// A stage of a pipeline that works ahead of whoever takes its results.
//
// One thread calls Next. Unless sequential, `produce` runs on a thread of this class, a few results
// ahead; sequentially it runs on the caller's thread, when a result is asked for. What it throws,
// Next throws, after the results before.
#pragma once

#include <cstddef>
#include <exception>
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
      try {
        while (auto result = Produce()) {
          if (!queue_.Push(*std::move(result))) return;
        }
      } catch (...) {
        failure_ = std::current_exception();
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
    if (!thread_.joinable()) return Produce();
    auto result = queue_.Pop();
    if (!result && failure_) std::rethrow_exception(std::exchange(failure_, nullptr));
    return result;
  }

 private:
  static constexpr size_t kQueueLength = 2;

  std::optional<T> Produce() {
    if (is_at_end_) return std::nullopt;
    is_at_end_ = true;  // if it throws, too
    auto result = produce_();
    is_at_end_ = !result;
    return result;
  }

  const std::function<std::optional<T>()> produce_;
  bool is_at_end_ = false;  ///< the thread's own while there is one
  BoundedQueue<T> queue_;
  std::exception_ptr failure_;  ///< the thread's own until the queue is closed
  std::thread thread_;
};

}  // namespace carmap
