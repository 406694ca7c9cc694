#include "carmap/semantics/keyframe_labeller.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <exception>
#include <utility>

#include "carmap/semantics/feature_mobility.h"

namespace carmap {
namespace {

constexpr size_t kMaxFailuresInARow = 5;
constexpr size_t kMaxLag = 1000;
constexpr double kPatienceS = 30, kRealTimePatienceS = 10;

absl::StatusOr<std::vector<Mobility>> LabelFeatures(Segmenter& segmenter,
                                                    const SegmenterInput& input,
                                                    const std::vector<Feature>& features,
                                                    cv::Size feature_image) {
  try {
    const auto mobility = segmenter.Segment(input);
    if (!mobility.ok()) return mobility.status();
    return MobilityOfFeatures(features, feature_image, *mobility);
  } catch (const std::exception& error) {
    return absl::InternalError(fmt::format("the segmenter threw: {}", error.what()));
  } catch (...) {
    return absl::InternalError("the segmenter threw");
  }
}

}  // namespace

absl::Status LabellingOptions::Validate() const {
  const auto error = [](const std::string& what) { return absl::InvalidArgumentError(what); };
  if (every == 0) return error("labelling every 0th keyframe: give 1 or more; 1 labels all");
  if (lag > kMaxLag)
    return error(fmt::format("labelling lags {} keyframes; give at most {}", lag, kMaxLag));
  if (real_time && sequential)
    return error("labelling cannot be sequential in real time; choose one");
  if (patience_s && !(*patience_s > 0 && *patience_s < 1e6)) {
    return error("the patience of labelling must be a number of seconds above 0; correct it");
  }
  return absl::OkStatus();
}

KeyframeLabeller::KeyframeLabeller(std::shared_ptr<Segmenter> segmenter,
                                   const LabellingOptions& options, cv::Size feature_image)
    : segmenter_(std::move(segmenter)),
      options_(options),
      patience_(options.patience_s.value_or(options.real_time ? kRealTimePatienceS : kPatienceS)),
      feature_image_(feature_image),
      tasks_(std::make_shared<BoundedQueue<Task>>(options.lag + 1)) {
  if (options.sequential) return;
  // It owns what it uses together with this: it may have to be left behind.
  std::packaged_task<void()> run([tasks = tasks_] {
    while (auto task = tasks->Pop()) (*task)();
  });
  thread_ended_ = run.get_future();
  thread_ = std::thread(std::move(run));
}

KeyframeLabeller::~KeyframeLabeller() {
  if (!thread_.joinable()) return;
  tasks_->Close();
  while (tasks_->Pop()) {  // what was not begun is not wanted any more
  }
  // A thread cannot be stopped from outside: one that hangs in the segmenter is left to itself.
  const bool has_ended = !hangs_ && thread_ended_.wait_for(patience_) == std::future_status::ready;
  has_ended ? thread_.join() : thread_.detach();
}

std::vector<LabelledKeyframe> KeyframeLabeller::Offer(
    KeyframeId id, uint32_t frame_index, const cv::Mat& left,
    std::shared_ptr<const std::vector<Feature>> features) {
  std::vector<LabelledKeyframe> collected;
  // First in real time, since a segmenter that is done is not busy.
  if (options_.real_time) collected = Collect(Until::kDue);
  if (IsWanted()) {
    Task task([segmenter = segmenter_, frame_index, left, features = std::move(features),
               feature_image = feature_image_] {
      return LabelFeatures(*segmenter, {frame_index, left}, *features, feature_image);
    });
    Pending pending{offered_, id, frame_index, task.get_future()};
    Start(std::move(pending), std::move(task));
  }
  if (!options_.real_time) collected = Collect(Until::kDue);
  ++offered_;
  return collected;
}

std::vector<LabelledKeyframe> KeyframeLabeller::Finish() { return Collect(Until::kEnd); }

bool KeyframeLabeller::IsWanted() const {
  const bool is_busy = options_.real_time && !pending_.empty();
  return !given_up_ && !is_busy && offered_ % options_.every == 0;
}

void KeyframeLabeller::Start(Pending pending, Task task) {
  if (options_.sequential) {
    pending.task = std::move(task);
  } else {
    tasks_->Push(std::move(task));
  }
  pending_.push_back(std::move(pending));
}

std::vector<LabelledKeyframe> KeyframeLabeller::Collect(Until until) {
  std::vector<LabelledKeyframe> collected;
  while (!pending_.empty() && IsReady(pending_.front(), until)) {
    Pending next = std::move(pending_.front());
    pending_.pop_front();
    Labels labels = next.labels.get();
    if (labels.ok()) {
      failures_in_a_row_ = 0;
      labelled_ += std::any_of(labels->begin(), labels->end(),
                               [](Mobility m) { return m != Mobility::kUnknown; });
      collected.push_back({next.id, *std::move(labels)});
    } else {
      TakeFailure(next.frame_index, labels.status());
    }
  }
  return collected;
}

/// Waits for labels that are due, or makes them; gives the segmenter up if that takes too long.
bool KeyframeLabeller::IsReady(Pending& pending, Until until) {
  const bool waits = until == Until::kEnd || !options_.real_time;
  const bool is_due = until == Until::kEnd || pending.number + options_.lag <= offered_;
  if (waits && !is_due) return false;
  if (options_.sequential) pending.task();
  const auto wait = waits ? patience_ : patience_.zero();
  if (pending.labels.wait_for(wait) == std::future_status::ready) return true;
  hangs_ = waits || pending.age.ElapsedMs() > 1e3 * patience_.count();
  if (hangs_) {
    GiveUp(fmt::format("frame {}: the segmenter took more than {:g} s", pending.frame_index,
                       patience_.count()));
  }
  return false;
}

void KeyframeLabeller::TakeFailure(uint32_t frame_index, const absl::Status& status) {
  if (failure_.empty()) {
    failure_ = fmt::format("frame {}: {}", frame_index, std::string(status.message()));
  }
  if (++failures_in_a_row_ == kMaxFailuresInARow) {
    GiveUp(fmt::format("{} keyframes failed in a row", kMaxFailuresInARow));
  }
}

void KeyframeLabeller::GiveUp(const std::string& why) {
  failure_ += fmt::format("{}{}; the rest of the drive stays unlabelled",
                          failure_.empty() ? "" : "; ", why);
  given_up_ = true;
  pending_.clear();
}

}  // namespace carmap
