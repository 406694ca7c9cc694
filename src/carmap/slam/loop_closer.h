// Keeps a map consistent as a whole while it grows (paper §5.4): finds loops, spreads the drift
// that they reveal, makes one landmark of those mapped twice, and adjusts the whole map in the
// background.
//
// Runs on the mapping thread, between two keyframes. The background result goes into the map after
// so many keyframes, not after so much time: threads do not change the map (docs/decisions/0006).
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/slam/georeference_map.h"
#include "carmap/slam/global_adjustment.h"
#include "carmap/slam/local_mapper.h"
#include "carmap/slam/loop_correction.h"
#include "carmap/slam/loop_detector.h"

namespace carmap {

struct LoopCloserOptions {
  bool close_loops = true;  ///< false leaves them open, to measure drift
  LoopDetectorOptions detector;
  LoopCorrectionOptions correction;
  GlobalAdjustmentOptions adjustment;
  GpsOptions gps;
  /// Keyframes that are mapped while the whole map is adjusted: so many, and one for so many of the
  /// map.
  size_t adjusting_keyframes = 10, map_keyframes_per_adjusting_keyframe = 20;
  bool sequential = false;
};

class LoopCloser {
 public:
  /// Without a vocabulary places are looked for by position alone.
  LoopCloser(const LoopCloserOptions& options, std::shared_ptr<const Vocabulary> vocabulary);

  /// To be called after each keyframe that the mapper inserted. Returns whether it changed the map:
  /// then what the mapper offered to the tracker is out of date.
  bool Process(KeyframeId newest, LocalMapper& mapper);

  /// At the end of the drive: waits for what runs in the background, brings poses and fixes
  /// together, and adjusts the whole map a last time if a loop was closed.
  void Finish(LocalMapper& mapper);

  /// Those that were closed, the oldest first.
  const std::vector<Loop>& loops() const { return loops_; }
  /// See LoopDetector.
  size_t rejected_count() const { return detector_.rejected_count(); }
  /// After Finish, where the fixes put the map.
  const std::optional<Georeference>& georeference() const { return georeference_; }

 private:
  void Close(const Loop& loop, LocalMapper& mapper);
  void StartAdjustment(const LocalMapper& mapper);
  void TakeAdjustment(LocalMapper& mapper);

  const LoopCloserOptions options_;
  LoopDetector detector_;
  std::unique_ptr<GlobalAdjustment> adjustment_;  ///< while it runs
  size_t keyframes_until_taken_ = 0;
  std::vector<Loop> loops_;
  std::optional<Georeference> georeference_;
};

}  // namespace carmap
