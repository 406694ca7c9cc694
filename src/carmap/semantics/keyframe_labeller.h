// Labels for the features of keyframes, made beside the drive (§3.3): late, and for as many
// keyframes as the segmenter keeps up with. A keyframe that it missed stays unlabelled.
//
// One thread calls; the segmenter is used by a thread of this class (sequentially: by the caller's)
// and must be left alone. Unless in real time, which keyframes are labelled, and when their labels
// are returned, depends on the keyframes offered alone. The drive outlives its segmenter: one that
// fails again and again, or hangs, is given up.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <future>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "carmap/base/bounded_queue.h"
#include "carmap/base/ids.h"
#include "carmap/base/stopwatch.h"
#include "carmap/feature/feature.h"
#include "carmap/semantics/mobility.h"
#include "carmap/semantics/segmenter.h"

namespace carmap {

struct LabelledKeyframe {
  KeyframeId id;
  std::vector<Mobility> of_feature;  ///< by feature of the keyframe
};

struct LabellingOptions {
  /// Every n-th keyframe is to be labelled; the paper's segmentation cycle (§A.7).
  size_t every = 1;
  /// So many keyframes after its own a keyframe's labels are returned, unless in real time.
  size_t lag = 2;
  /// Never wait: labels are returned when they are there, and a keyframe that comes while the
  /// segmenter is busy stays unlabelled.
  bool real_time = false;
  bool sequential = false;  ///< work on the caller's thread, with the same result; not in real time
  /// A segmenter that takes longer for one keyframe hangs. Default: 30, in real time 10.
  std::optional<double> patience_s;

  /// InvalidArgument, naming the option and the remedy.
  absl::Status Validate() const;
};

class KeyframeLabeller {
 public:
  /// Needs valid options. Features are in pixels of `feature_image`, StereoFrontEnd::rig's.
  KeyframeLabeller(std::shared_ptr<Segmenter> segmenter, const LabellingOptions& options,
                   cv::Size feature_image);
  /// Returns within the patience, also while the segmenter hangs: its thread then goes on by itself
  /// with what it shares in the ownership of.
  ~KeyframeLabeller();
  KeyframeLabeller(const KeyframeLabeller&) = delete;
  KeyframeLabeller& operator=(const KeyframeLabeller&) = delete;

  /// Hands in the drive's next keyframe: its left image, which must stay as it is, and its
  /// features. Returns the labels that are due now, in the order of their keyframes; none for those
  /// on which the segmenter failed.
  std::vector<LabelledKeyframe> Offer(KeyframeId id, uint32_t frame_index, const cv::Mat& left,
                                      std::shared_ptr<const std::vector<Feature>> features);

  /// At the end of the drive: waits for what is still being labelled.
  std::vector<LabelledKeyframe> Finish();

  /// Keyframes so far, and those of which something was told.
  size_t offered() const { return offered_; }
  size_t labelled() const { return labelled_; }
  /// The first failure, in one line, and whether the segmenter was given up; empty without any.
  const std::string& failure() const { return failure_; }
  bool given_up() const { return given_up_; }

 private:
  using Labels = absl::StatusOr<std::vector<Mobility>>;
  using Task = std::packaged_task<Labels()>;
  struct Pending {
    size_t number;  ///< of the keyframe, in order of offering
    KeyframeId id;
    uint32_t frame_index;
    std::future<Labels> labels;
    Task task;  ///< sequentially: what makes the labels, not run yet
    Stopwatch age;
  };
  enum class Until { kDue, kEnd };

  bool IsWanted() const;
  void Start(Pending pending, Task task);
  std::vector<LabelledKeyframe> Collect(Until until);
  bool IsReady(Pending& pending, Until until);
  void TakeFailure(uint32_t frame_index, const absl::Status& status);
  void GiveUp(const std::string& why);

  const std::shared_ptr<Segmenter> segmenter_;
  const LabellingOptions options_;
  const std::chrono::duration<double> patience_;
  const cv::Size feature_image_;

  std::deque<Pending> pending_;  ///< not returned yet
  size_t offered_ = 0, labelled_ = 0, failures_in_a_row_ = 0;
  std::string failure_;
  bool given_up_ = false, hangs_ = false;

  const std::shared_ptr<BoundedQueue<Task>> tasks_;
  std::future<void> thread_ended_;
  std::thread thread_;  ///< none sequentially
};

}  // namespace carmap
