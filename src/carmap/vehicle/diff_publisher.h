// What a vehicle sends while it drives (paper §3.4): every ten seconds what is new, as a diff where
// it is localized in the base, as a segment where it is not.
//
// A diff has the landmarks of things that the base has not, and what was seen and missed of those
// that it has. Where part of a stretch is unknown road, all of it is published as a segment, with
// some of the road before it, so that the base fits it without a gap. Landmarks are published once
// they are out of sight, with final names. Owned by one thread.
#pragma once

#include <absl/status/status.h>

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/base/time.h"
#include "carmap/feature/dense_disparity.h"
#include "carmap/index/map_view.h"
#include "carmap/index/reconstruct.h"
#include "carmap/map/map.h"
#include "carmap/map/map_diff.h"
#include "carmap/map/strip.h"
#include "carmap/map/tile.h"
#include "carmap/slam/tracker.h"
#include "carmap/update/fit.h"
#include "carmap/vehicle/base_tracker.h"
#include "carmap/vehicle/new_landmarks.h"
#include "carmap/vehicle/sighting_counter.h"

namespace carmap {

struct PublishOptions {
  double every_s = 10;      ///< of driving
  double min_driven_m = 5;  ///< less is no driving: a vehicle that stands has nothing to tell
  /// Road is known so near to a keyframe that the base placed, along the drive ...
  double known_m = 20;
  /// ... and so near to where one of the base's was made: far landmarks place a vehicle also where
  /// no drive has been.
  double driven_m = 12;
  double overlap_m = 30;            ///< of a segment with the road before it
  double viewer_spacing_m = 2.5;    ///< of keyframes in the lists of a diff's landmarks
  double path_spacing_m = 25;       ///< of keyframes of a diff that tell where the vehicle drove
  size_t unfinished_keyframes = 3;  ///< the newest, whose landmarks are on trial
  double max_anchor_sigma_m = 0.3;
  double behind_m = 15;  ///< landmarks that were last in sight so long ago are done with
  SightingOptions sightings;
  NewLandmarkOptions news;
  FitOptions fit;
};

/// A part of the drive as it is published.
struct PublishedPart {
  MapDiff diff;
  std::string segment_because;                    ///< why it is one; empty for a diff
  double length_m = 0;                            ///< of road that it tells of
  size_t landmarks_of_stretch = 0;                ///< that a segment of the same road would have
  size_t seen = 0, missed = 0, seen_through = 0;  ///< landmarks of the base
};

class DiffPublisher {
 public:
  explicit DiffPublisher(const PublishOptions& options = {})
      : options_(options), sightings_(options.sightings) {}

  /// Whether Take needs the frame's disparities.
  bool NeedsDisparities(const VehiclePose& pose) const { return sightings_.IsDue(pose); }

  /// Frames in the order of time: what the drive's own map and the base say of them. `view` and
  /// `base`, the same rebuilt, are what `pose` refers to.
  void Take(Timestamp timestamp, KeyframeId frame, const TrackedFrame& own, const VehiclePose& pose,
            const StereoRig& rig, const MapView& view, const ReconstructedMap& base,
            const DenseDisparity* disparities);

  /// Whether enough was driven since the last part.
  bool IsDue() const;

  /// The next part; nothing where there is nothing to tell. `own` is the drive's own map, `drive`
  /// what is known of the drive by now. The last part of a drive has its end too.
  std::optional<PublishedPart> Publish(const Map& own, const LeanDrive& drive, const MapView& view,
                                       const ReconstructedMap& base, bool is_last);

 private:
  /// Of a keyframe of the drive's own, where the base put it.
  struct Place {
    uint32_t component = 0;
    Rigid3 root_from_camera;
    double sigma_m = 0, sigma_rad = 0;
  };
  struct Stretch;

  std::vector<AnchoredKeyframe> AnchorsOf(const LeanMap& stretch, const MapView& view) const;
  double FarthestFromAnchorsM(const LeanMap& stretch, size_t begin,
                              const std::vector<AnchoredKeyframe>& anchors) const;
  LeanMap Named(const StrippedMap& stripped, const std::vector<uint32_t>& landmarks);
  void AddSightings(bool is_last, PublishedPart& part);
  absl::Status AddNews(const Map& own, const Stretch& stretch, const MapView& view,
                       const ReconstructedMap& base, PublishedPart& part);
  void AddSegment(const Stretch& stretch, PublishedPart& part);

  const PublishOptions options_;
  SightingCounter sightings_;
  /// Of all views since the last part, the newest versions: what was seen a while ago may lie in
  /// tiles that the present view lacks.
  std::map<TileId, std::shared_ptr<const Tile>> tiles_;
  std::map<KeyframeId, Place> places_;        ///< of keyframes that the base placed
  std::map<LandmarkId, uint32_t> published_;  ///< names, by that in the drive's own map
  uint32_t next_index_ = 0, next_part_ = 0;
  std::optional<KeyframeId> done_;  ///< the last keyframe of the part before
  std::optional<Timestamp> part_began_, newest_;
  double driven_m_ = 0;  ///< since the part began
};

}  // namespace carmap
