#include "carmap/slam/loop_closer.h"

#include <cstdint>
#include <utility>

#include "carmap/base/stopwatch.h"
#include "carmap/feature/vocabulary.h"
#include "carmap/map/propagate_edit.h"

namespace carmap {

LoopCloser::LoopCloser(const LoopCloserOptions& options,
                       std::shared_ptr<const Vocabulary> vocabulary)
    : options_(options), detector_(options.detector, std::move(vocabulary)) {}

bool LoopCloser::Process(KeyframeId newest, LocalMapper& mapper) {
  if (!options_.close_loops) return false;
  const uint64_t version = mapper.map().version();
  if (adjustment_ && --keyframes_until_taken_ == 0) TakeAdjustment(mapper);
  const Stopwatch watch;
  const auto loop = detector_.Detect(mapper.map(), mapper.rig(), newest);
  mapper.CountTime("find_loops", watch.ElapsedMs());
  if (loop) Close(*loop, mapper);
  return mapper.map().version() != version;
}

void LoopCloser::Close(const Loop& loop, LocalMapper& mapper) {
  adjustment_.reset();  // of a map without this loop
  loops_.push_back(loop);
  const Stopwatch watch;
  const Map& map = mapper.map();
  const MapEdit fused = FuseLoop(map, mapper.rig(), loop, options_.correction);
  mapper.Apply("close_loops",
               CorrectPoses(map, loop, FixesAsPriors(map, options_.gps), options_.correction));
  mapper.Apply("close_loops", fused);
  StartAdjustment(mapper);
  mapper.CountTime("close_loops", watch.ElapsedMs());
}

void LoopCloser::StartAdjustment(const LocalMapper& mapper) {
  const Map& map = mapper.map();
  adjustment_ = std::make_unique<GlobalAdjustment>(
      MakeGlobalBundle(map, mapper.rig(), FixesAsPriors(map, options_.gps), options_.adjustment),
      options_.adjustment.bundle, options_.sequential);
  keyframes_until_taken_ = options_.adjusting_keyframes +
                           map.keyframes().size() / options_.map_keyframes_per_adjusting_keyframe;
}

void LoopCloser::TakeAdjustment(LocalMapper& mapper) {
  const Stopwatch watch;
  MapEdit edit = adjustment_->Finish();
  adjustment_.reset();
  KeepFirstKeyframe(mapper.map(), edit);
  mapper.Apply("adjust_all", PropagateEdit(mapper.map(), std::move(edit)));
  mapper.CountTime("adjust_all", watch.ElapsedMs());
}

void LoopCloser::Finish(LocalMapper& mapper) {
  const Map& map = mapper.map();
  if (map.keyframes().empty()) return;
  if (adjustment_) TakeAdjustment(mapper);
  const auto fixes = FixesAsPriors(map, options_.gps);
  if (loops_.empty() && fixes.empty()) return;
  if (!fixes.empty())
    mapper.Apply("close_loops", CorrectPoses(map, {}, fixes, options_.correction));
  if (!loops_.empty()) {
    StartAdjustment(mapper);
    TakeAdjustment(mapper);
  }
  georeference_ = GeoreferenceOf(map, options_.gps);
}

}  // namespace carmap
