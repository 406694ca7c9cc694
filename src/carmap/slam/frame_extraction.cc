#include "carmap/slam/frame_extraction.h"

#include <fmt/format.h>

#include "carmap/base/exceptions.h"
#include "carmap/base/stopwatch.h"
#include "carmap/dataset/image_file.h"

namespace carmap {
namespace {

/// Recorders repeat an image where the camera was late: once, or for so long; more is a fault.
constexpr double kMaxRepeatedS = 0.25;

}  // namespace

FrameExtraction::FrameExtraction(FrameSource& source, const FrontEndOptions& options,
                                 bool sequential)
    : front_end_(source.rig(), options),
      reader_(source, /*sequential=*/true),  // a thread of its own would slow the front end's
      frames_(sequential, [this] { return Extract(); }) {}

std::optional<ExtractedFrame> FrameExtraction::Extract() {
  const auto frame = reader_.Next();
  if (!frame) return std::nullopt;
  ExtractedFrame result{.index = frame->index, .timestamp = frame->timestamp, .gps = frame->gps};
  if (!frame->status.ok()) {
    result.unusable_because = std::string(frame->status.message());
    return result;
  }
  if (HaveSamePixels(frame->left, previous_left_)) {
    const double repeated_s = frame->timestamp.seconds() - previous_since_.seconds();
    result.repeats_image = ++repeats_ == 1 || repeated_s <= kMaxRepeatedS;
    if (!result.repeats_image) {
      result.unusable_because = fmt::format(
          "the image has been the same for {:.2f} s: the camera was frozen", repeated_s);
    }
    return result;
  }
  previous_left_ = frame->left;
  previous_since_ = frame->timestamp;
  repeats_ = 0;
  const Stopwatch watch;
  const absl::Status extracted = CatchExceptions([&] {
    result.features = std::make_shared<const std::vector<Feature>>(
        front_end_.Extract(frame->left, frame->right, &result.times));
  });
  if (!extracted.ok()) {
    result.unusable_because = std::string(extracted.message());
    return result;
  }
  result.left = frame->left;
  result.right = frame->right;
  result.front_end_ms = watch.ElapsedMs();
  CheckPair(result);
  return result;
}

void FrameExtraction::CheckPair(ExtractedFrame& frame) {
  constexpr size_t kEvery = 10;
  const bool is_due = extracted_++ % kEvery == 0 || looks_again_;
  if (!is_due) return;
  frame.pair = {frame.index, front_end_.MeasurePair(*frame.features),
                front_end_.brightness_ratio()};
  const auto fault = FaultOf(frame.pair->geometry);
  looks_again_ = !looks_again_ && fault && CanBeginLater(*fault);
}

}  // namespace carmap
