#include "carmap/slam/frame_extraction.h"

#include "carmap/base/exceptions.h"
#include "carmap/base/stopwatch.h"
#include "carmap/dataset/image_file.h"

namespace carmap {

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
    result.unusable_because = "the image is the same as the one before: the camera was frozen";
    return result;
  }
  previous_left_ = frame->left;
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
  result.front_end_ms = watch.ElapsedMs();
  return result;
}

}  // namespace carmap
