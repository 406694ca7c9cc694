#include "carmap/eval/feature_tracks.h"

#include <algorithm>
#include <utility>

namespace carmap {

void FeatureTracks::Begin(size_t feature_count) {
  *this = FeatureTracks();
  running_.assign(feature_count, Track());
}

void FeatureTracks::Continue(const std::vector<PredictedFeature>& predictions,
                             const std::vector<TrueMatch>& matches, size_t feature_count,
                             double moved_m) {
  ++frame_;
  driven_m_ += moved_m;
  std::vector<Track> next(feature_count, Track{frame_, driven_m_, driven_m_});
  std::vector<bool> goes_on(running_.size(), false);
  for (const TrueMatch& match : matches) {
    const uint32_t feature_idx = predictions[match.prediction_idx].feature_idx;
    goes_on[feature_idx] = true;
    Track& track = next[match.feature_idx] = running_[feature_idx];
    if (track.frames == kMaxFrames) continue;
    ++track.frames;
    track.last_m = driven_m_;
  }
  for (size_t i = 0; i < running_.size(); ++i) {
    if (!goes_on[i]) Finish(running_[i]);
  }
  running_ = std::move(next);
}

std::vector<TrackLength> FeatureTracks::End() {
  for (const Track& track : running_) Finish(track);
  std::vector<TrackLength> lengths;
  for (const Track& track : finished_) {
    if (track.first_frame + kMaxFrames > frame_ + 1) continue;
    lengths.push_back({track.first_frame, track.frames, track.last_m - track.first_m});
  }
  std::stable_sort(lengths.begin(), lengths.end(),
                   [](const auto& a, const auto& b) { return a.first_frame < b.first_frame; });
  *this = FeatureTracks();
  return lengths;
}

void FeatureTracks::Finish(const Track& track) {
  const bool is_older_than_the_chain = track.first_frame == 0;
  if (track.frames > 1 && !is_older_than_the_chain) finished_.push_back(track);
}

}  // namespace carmap
