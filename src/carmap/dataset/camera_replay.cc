#include "carmap/dataset/camera_replay.h"

#include <fmt/format.h>

#include <thread>

namespace carmap {

std::optional<StereoFrame> CameraReplay::Next() {
  if (!start_) start_ = Clock::now();
  const std::chrono::duration<double> period(1 / options_.rate_hz);
  const auto due = [&](size_t n) {
    return *start_ + std::chrono::duration_cast<Clock::duration>(static_cast<double>(n) * period);
  };
  const size_t n = taken_++;
  const auto count = frame_count();
  const bool is_displaced = (!count || n + options_.waiting_frames < *count) &&
                            Clock::now() >= due(n + options_.waiting_frames);
  auto frame = source_.Next();
  if (!frame) return std::nullopt;
  if (is_displaced) {
    ++dropped_count_;
    frame->left = frame->right = cv::Mat();
    frame->status = absl::UnavailableError(
        fmt::format("dropped, as {} newer ones waited already; the machine does not keep up with "
                    "{} Hz",
                    options_.waiting_frames, options_.rate_hz));
    return frame;
  }
  std::this_thread::sleep_until(due(n));
  return frame;
}

}  // namespace carmap
