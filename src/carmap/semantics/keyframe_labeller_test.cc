#include "carmap/semantics/keyframe_labeller.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <opencv2/core.hpp>
#include <set>
#include <stdexcept>
#include <utility>

namespace carmap {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

const cv::Size kImage(64, 32);

/// Says of each pixel what the image says, and does `before` first.
class TestSegmenter : public Segmenter {
 public:
  using Before = std::function<absl::Status(uint32_t frame_index)>;
  explicit TestSegmenter(Before before = {}) : before_(std::move(before)) {}

  absl::StatusOr<cv::Mat> Segment(const SegmenterInput& input) override {
    ++calls;
    if (before_) {
      if (absl::Status status = before_(input.frame_index); !status.ok()) return status;
    }
    return input.image.clone();
  }
  std::atomic<int> calls = 0;

 private:
  const Before before_;
};

/// Opens once; who waits passes from then on.
class Gate {
 public:
  void Open() {
    const std::lock_guard lock(mutex_);
    is_open_ = true;
    opened_.notify_all();
  }
  void Wait() {
    std::unique_lock lock(mutex_);
    opened_.wait(lock, [&] { return is_open_; });
  }

 private:
  std::mutex mutex_;
  std::condition_variable opened_;
  bool is_open_ = false;
};

/// Of keyframe k: an image that is static left of column k, non-static from there on.
cv::Mat ImageOf(uint32_t k) {
  cv::Mat image(kImage, CV_8UC1, cv::Scalar(static_cast<double>(Mobility::kNonStatic)));
  image.colRange(0, static_cast<int>(k)).setTo(static_cast<double>(Mobility::kStatic));
  return image;
}

/// A feature in each of the first 20 columns.
std::shared_ptr<const std::vector<Feature>> Features() {
  std::vector<Feature> features;
  for (int column = 0; column < 20; ++column) features.push_back({static_cast<float>(column), 3});
  return std::make_shared<const std::vector<Feature>>(features);
}

/// Frame numbers go in steps of ten.
std::vector<LabelledKeyframe> Offer(KeyframeLabeller& labeller, uint32_t k) {
  return labeller.Offer({DriveId{5}, 10 * k}, 10 * k, ImageOf(k), Features());
}

/// The numbers of labelled keyframes; their labels are looked at.
std::vector<uint32_t> Numbers(const std::vector<LabelledKeyframe>& labelled) {
  std::vector<uint32_t> numbers;
  for (const LabelledKeyframe& keyframe : labelled) {
    const uint32_t k = keyframe.id.index / 10;
    EXPECT_EQ(keyframe.id, (KeyframeId{DriveId{5}, 10 * k}));
    EXPECT_EQ(keyframe.of_feature.size(), 20u);
    for (size_t i = 0; i < keyframe.of_feature.size(); ++i) {
      EXPECT_EQ(keyframe.of_feature[i], i < k ? Mobility::kStatic : Mobility::kNonStatic);
    }
    numbers.push_back(k);
  }
  return numbers;
}

/// Which keyframes' labels each Offer returned, and last Finish.
std::vector<std::vector<uint32_t>> Drive(KeyframeLabeller& labeller, uint32_t keyframes) {
  std::vector<std::vector<uint32_t>> returned;
  for (uint32_t k = 0; k < keyframes; ++k) returned.push_back(Numbers(Offer(labeller, k)));
  returned.push_back(Numbers(labeller.Finish()));
  return returned;
}

TEST(LabellingOptionsTest, SaysWhatCannotBe) {
  EXPECT_TRUE(LabellingOptions().Validate().ok());
  for (const LabellingOptions& options :
       {LabellingOptions{.every = 0}, LabellingOptions{.lag = 1001},
        LabellingOptions{.real_time = true, .sequential = true}, LabellingOptions{.patience_s = 0},
        LabellingOptions{.patience_s = std::nan("")}}) {
    EXPECT_THAT(std::string(options.Validate().message()), HasSubstr("label"));
  }
}

/// As fast as it goes: on the caller's thread or on another one.
class KeyframeLabellerTest : public testing::TestWithParam<bool> {
 protected:
  LabellingOptions Options(size_t every, size_t lag) const {
    return {.every = every, .lag = lag, .sequential = GetParam()};
  }
};
INSTANTIATE_TEST_SUITE_P(Threads, KeyframeLabellerTest, testing::Bool());

TEST_P(KeyframeLabellerTest, LabelsComeLate) {
  KeyframeLabeller labeller(std::make_shared<TestSegmenter>(), Options(1, 2), kImage);
  EXPECT_THAT(Drive(labeller, 5), ElementsAre(IsEmpty(), IsEmpty(), ElementsAre(0), ElementsAre(1),
                                              ElementsAre(2), ElementsAre(3, 4)));
  EXPECT_EQ(labeller.offered(), 5u);
  EXPECT_EQ(labeller.labelled(), 5u);
  EXPECT_EQ(labeller.failure(), "");
}

TEST_P(KeyframeLabellerTest, LabelsComeAtOnceWithoutLag) {
  KeyframeLabeller labeller(std::make_shared<TestSegmenter>(), Options(1, 0), kImage);
  EXPECT_THAT(Drive(labeller, 3),
              ElementsAre(ElementsAre(0), ElementsAre(1), ElementsAre(2), IsEmpty()));
}

TEST_P(KeyframeLabellerTest, SomeKeyframesStayUnlabelled) {
  KeyframeLabeller labeller(std::make_shared<TestSegmenter>(), Options(3, 1), kImage);
  EXPECT_THAT(Drive(labeller, 7),
              ElementsAre(IsEmpty(), ElementsAre(0), IsEmpty(), IsEmpty(), ElementsAre(3),
                          IsEmpty(), IsEmpty(), ElementsAre(6)));
  EXPECT_EQ(labeller.offered(), 7u);
  EXPECT_EQ(labeller.labelled(), 3u);
}

TEST_P(KeyframeLabellerTest, FeaturesMayLieInAnEnlargedImage) {
  KeyframeLabeller labeller(std::make_shared<TestSegmenter>(), Options(1, 0), kImage * 2);
  const auto labelled = labeller.Offer({}, 0, ImageOf(5), Features());
  ASSERT_EQ(labelled.size(), 1u);
  for (size_t i = 0; i < 20; ++i) {
    EXPECT_EQ(labelled[0].of_feature[i], i < 10 ? Mobility::kStatic : Mobility::kNonStatic);
  }
}

TEST_P(KeyframeLabellerTest, AFailureLeavesItsKeyframeUnlabelled) {
  const auto segmenter = std::make_shared<TestSegmenter>([](uint32_t frame) -> absl::Status {
    if (frame == 10) return absl::DataLossError("it is foggy; wait");
    if (frame == 20) throw std::runtime_error("thrown");
    if (frame == 30) throw 7;
    return absl::OkStatus();
  });
  KeyframeLabeller labeller(segmenter, Options(1, 1), kImage);
  EXPECT_THAT(Drive(labeller, 6), ElementsAre(IsEmpty(), ElementsAre(0), IsEmpty(), IsEmpty(),
                                              IsEmpty(), ElementsAre(4), ElementsAre(5)));
  EXPECT_EQ(labeller.labelled(), 3u);
  EXPECT_EQ(labeller.failure(), "frame 10: it is foggy; wait");
  EXPECT_FALSE(labeller.given_up());
}

TEST_P(KeyframeLabellerTest, FiveFailuresInARowAreTooMany) {
  // Those after the fifth would go well, and four in a row have before.
  const std::set<uint32_t> fails = {10, 20, 30, 40, 60, 70, 80, 90, 100};
  const auto segmenter = std::make_shared<TestSegmenter>([&](uint32_t frame) {
    return fails.contains(frame) ? absl::InternalError("no") : absl::OkStatus();
  });
  KeyframeLabeller labeller(segmenter, Options(1, 2), kImage);
  const auto returned = Drive(labeller, 20);
  EXPECT_THAT(returned[2], ElementsAre(0));
  EXPECT_THAT(returned[7], ElementsAre(5));
  for (size_t k = 8; k < returned.size(); ++k) EXPECT_THAT(returned[k], IsEmpty());
  EXPECT_EQ(labeller.offered(), 20u);
  EXPECT_EQ(labeller.labelled(), 2u);
  EXPECT_TRUE(labeller.given_up());
  EXPECT_THAT(labeller.failure(),
              AllOf(HasSubstr("frame 10: no"), HasSubstr("5 keyframes failed in a row")));
  EXPECT_LE(segmenter->calls, 13) << "it is not tried any more";
}

TEST(KeyframeLabellerThreadTest, WaitsForLabelsThatAreDue) {
  // The labels of keyframe 0 come while the third is being offered, which waits for them.
  Gate gate;
  const auto segmenter = std::make_shared<TestSegmenter>([&](uint32_t) {
    gate.Wait();
    return absl::OkStatus();
  });
  KeyframeLabeller labeller(segmenter, {.lag = 2}, kImage);
  EXPECT_THAT(Offer(labeller, 0), IsEmpty());
  EXPECT_THAT(Offer(labeller, 1), IsEmpty());
  std::thread opener([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    gate.Open();
  });
  EXPECT_THAT(Numbers(Offer(labeller, 2)), ElementsAre(0));
  opener.join();
}

TEST(KeyframeLabellerThreadTest, EndsWithoutFinish) {
  const auto segmenter = std::make_shared<TestSegmenter>();
  {
    KeyframeLabeller labeller(segmenter, {.lag = 100}, kImage);
    for (uint32_t k = 0; k < 20; ++k) Offer(labeller, k);
  }
  EXPECT_EQ(segmenter.use_count(), 1) << "the thread is gone";
}

/// The thread of a labeller that gave its segmenter up is left behind; tests end after it.
void WaitUntilReleased(const std::shared_ptr<TestSegmenter>& segmenter) {
  while (segmenter.use_count() > 1) std::this_thread::sleep_for(std::chrono::milliseconds(1));
}

TEST(KeyframeLabellerThreadTest, DoesNotWaitForASegmenterThatHangs) {
  Gate gate;
  const auto segmenter = std::make_shared<TestSegmenter>([&](uint32_t frame) {
    if (frame == 10) gate.Wait();
    return absl::OkStatus();
  });
  {
    KeyframeLabeller labeller(segmenter, {.lag = 1, .patience_s = 0.05}, kImage);
    EXPECT_THAT(Offer(labeller, 0), IsEmpty());
    EXPECT_THAT(Numbers(Offer(labeller, 1)), ElementsAre(0));
    EXPECT_THAT(Offer(labeller, 2), IsEmpty());
    EXPECT_TRUE(labeller.given_up());
    EXPECT_THAT(labeller.failure(),
                AllOf(HasSubstr("frame 10: "), HasSubstr("more than 0.05 s"), HasSubstr("rest")));
    EXPECT_THAT(Drive(labeller, 3), ElementsAre(IsEmpty(), IsEmpty(), IsEmpty(), IsEmpty()));
  }
  EXPECT_EQ(segmenter->calls, 2);
  gate.Open();
  WaitUntilReleased(segmenter);
}

TEST(KeyframeLabellerThreadTest, EndsWhileASegmenterHangs) {
  Gate gate;
  const auto segmenter = std::make_shared<TestSegmenter>([&](uint32_t) {
    gate.Wait();
    return absl::OkStatus();
  });
  {
    KeyframeLabeller labeller(segmenter, {.lag = 9, .patience_s = 0.05}, kImage);
    Offer(labeller, 0);
  }
  gate.Open();
  WaitUntilReleased(segmenter);
}

/// Lets one segmentation pass at a time, and tells when it is done.
class Turnstile {
 public:
  void LetOnePass() {
    const std::lock_guard lock(mutex_);
    ++allowed_;
    changed_.notify_all();
  }
  void Pass() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return allowed_ > 0; });
    --allowed_;
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  int allowed_ = 0;
};

TEST(RealTimeLabellerTest, ABusySegmenterMissesKeyframes) {
  Turnstile turnstile;
  const auto segmenter = std::make_shared<TestSegmenter>([&](uint32_t) {
    turnstile.Pass();
    return absl::OkStatus();
  });
  KeyframeLabeller labeller(segmenter, {.lag = 0, .real_time = true}, kImage);
  // 0 is begun; 1 and 2 come while it lasts, and nothing waits.
  for (uint32_t k = 0; k < 3; ++k) EXPECT_THAT(Offer(labeller, k), IsEmpty());
  turnstile.LetOnePass();
  std::vector<uint32_t> returned;
  uint32_t k = 3;
  for (; returned.empty(); ++k) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    returned = Numbers(Offer(labeller, k));
  }
  EXPECT_THAT(returned, ElementsAre(0));
  // The keyframe with which the labels came was begun in its turn.
  turnstile.LetOnePass();
  EXPECT_THAT(Numbers(labeller.Finish()), ElementsAre(k - 1));
  EXPECT_EQ(segmenter->calls, 2);
  EXPECT_EQ(labeller.offered(), k);
  EXPECT_EQ(labeller.labelled(), 2u);
}

TEST(RealTimeLabellerTest, GivesUpASegmenterThatHangs) {
  Gate gate;
  const auto segmenter = std::make_shared<TestSegmenter>([&](uint32_t) {
    gate.Wait();
    return absl::OkStatus();
  });
  {
    KeyframeLabeller labeller(segmenter, {.real_time = true, .patience_s = 0.05}, kImage);
    EXPECT_THAT(Offer(labeller, 0), IsEmpty());
    EXPECT_THAT(Offer(labeller, 1), IsEmpty());
    EXPECT_FALSE(labeller.given_up());
    std::this_thread::sleep_for(std::chrono::milliseconds(60));
    EXPECT_THAT(Offer(labeller, 2), IsEmpty());
    EXPECT_TRUE(labeller.given_up());
    EXPECT_THAT(labeller.Finish(), IsEmpty());
  }
  gate.Open();
  WaitUntilReleased(segmenter);
}

TEST(RealTimeLabellerTest, LabelsAreThoseOfTheirKeyframes) {
  KeyframeLabeller labeller(std::make_shared<TestSegmenter>(), {.real_time = true}, kImage);
  size_t returned = 0;
  for (uint32_t k = 0; k < 20; ++k) returned += Numbers(Offer(labeller, k)).size();
  returned += Numbers(labeller.Finish()).size();
  EXPECT_EQ(returned, labeller.labelled());
  EXPECT_GE(returned, 1u);
}

}  // namespace
}  // namespace carmap
