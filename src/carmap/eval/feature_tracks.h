// How long features stay in view of a moving camera: chains of true matches.
//
// Not thread-safe.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "carmap/eval/true_matches.h"

namespace carmap {

/// A feature that was found again at least once.
struct TrackLength {
  size_t first_frame = 0;  ///< of the chain, from 0
  size_t frames = 0;       ///< that show it, the first included; kMaxFrames stands for longer, too
  double driven_m = 0;     ///< from the first of them to the last
};

/// Follows features along a chain of frames. All tracks are watched for equally long, kMaxFrames,
/// so that the chain's end cuts none: one counts if it begins after the chain's first frame (those
/// there are older) and at least kMaxFrames before its end. Thus the lengths of two drives compare,
/// whatever the lengths of their chains.
class FeatureTracks {
 public:
  static constexpr size_t kMaxFrames = 10;
  /// Shorter chains show no track for long enough.
  static constexpr size_t kMinChainFrames = kMaxFrames + 1;

  /// The chain's first frame, or the first after the motion was lost.
  void Begin(size_t feature_count);

  /// The next frame, `moved_m` farther.
  void Continue(const std::vector<PredictedFeature>& predictions,
                const std::vector<TrueMatch>& matches, size_t feature_count, double moved_m);

  /// Ends the chain: the tracks in it that count, by their first frame.
  std::vector<TrackLength> End();

 private:
  struct Track {
    size_t first_frame = 0;
    double first_m = 0, last_m = 0;
    size_t frames = 1;
  };

  void Finish(const Track& track);

  size_t frame_ = 0;  ///< of the chain, from 0
  double driven_m_ = 0;
  std::vector<Track> running_;  ///< one a feature of the latest frame
  std::vector<Track> finished_;
};

}  // namespace carmap
