// Lets all drives of a component share the misfit that loops have closed (ARCHITECTURE: "moving the
// base is a maintenance job").
//
// The base stays while segments bend to it, so that the last drive around a block takes all of the
// misfit. Here all poses move: a pose graph of every drive's own steps, of the anchors that held
// each to the base, and of the drives' fixes. Its result is patches of keyframes' poses, on which
// the landmarks ride. One thread at a time.
#pragma once

#include <absl/status/statusor.h>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "carmap/ingest/base_map.h"
#include "carmap/slam/georeference_map.h"
#include "carmap/solve/pose_graph.h"

namespace carmap {

struct AdjustOptions {
  StepNoise step;
  GpsOptions gps;
  double min_move_m = 0.01;  ///< less is not worth a patch
  /// A component that would move by more is refused: its tiles would not be where it is.
  double max_move_m = 25;
};

struct Adjustment {
  uint32_t component = 0;
  size_t keyframes = 0;      ///< of the base
  size_t contributions = 0;  ///< whose measurements were used
  size_t steps = 0, anchors = 0;
  /// Root mean square over all measurements, in standard deviations.
  double misfit_before = 0, misfit_after = 0;
  double median_move_m = 0, largest_move_m = 0;
  std::vector<TileVersion> tiles;    ///< that changed
  uint64_t patch_bytes = 0;          ///< that vehicles will fetch for it
  std::optional<uint64_t> sequence;  ///< of its entry in the journal; none if nothing moved
};

/// Errors: FailedPrecondition (it would move too far; nothing is changed), Aborted (others commit
/// to it), those of the store.
absl::StatusOr<Adjustment> Adjust(const Component& component, BaseMap& base,
                                  const AdjustOptions& options = {});

}  // namespace carmap
