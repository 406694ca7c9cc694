// A map's place on the Earth, by the GPS fixes of its keyframes.
//
// Without fixes enough there is none, and everything else works in the drive's own frame. Pure
// functions, thread-safe on a map that nobody changes.
#pragma once

#include <optional>
#include <vector>

#include "carmap/geometry/geodesy.h"
#include "carmap/geometry/rigid3.h"
#include "carmap/map/lean_map.h"
#include "carmap/map/map.h"
#include "carmap/solve/position_prior.h"

namespace carmap {

struct GpsOptions {
  double sigma_m = 3;          ///< of a fix in town, each horizontal axis
  double vertical_factor = 2;  ///< heights are worse by this
  /// Errors of fixes hardly change in this time: fixes of it together tell as much as one.
  double correlation_s = 30;
  double min_extent_m = 50;  ///< that the fixes must span
};

/// The east-north-up frame that a map lies in.
struct Georeference {
  GpsFix origin;  ///< of `enu`
  Rigid3 enu_from_map;
};

/// A camera of the drive and the fix taken there.
struct PlacedFix {
  Rigid3 map_from_camera;
  GpsFix fix;
};

/// Nothing if the fixes are too few, or most of them do not agree with the way through the map
/// (AlignToFixes). Its origin lies amidst the fixes; single ones may be anywhere on the Earth.
std::optional<Georeference> GeoreferenceOf(const std::vector<PlacedFix>& fixes,
                                           const GpsOptions& options);
std::optional<Georeference> GeoreferenceOf(const Map& map, const GpsOptions& options);
std::optional<Georeference> GeoreferenceOf(const LeanMap& map, const GpsOptions& options);

/// Of a map whose fixes are those that its georeference stands for (ReplaceFixes), or as good:
/// nothing if they scatter like a receiver's own, of which a map found that they tell no place.
std::optional<Georeference> SettledGeoreferenceOf(const LeanMap& map, const GpsOptions& options);

/// The fixes in the map's frame, as priors of the poses of all keyframes in the map's order. Empty
/// where there is no georeference.
std::vector<PositionPrior> FixesAsPriors(const Map& map, const GpsOptions& options);

/// Horizontal distances between the fixes and where the georeference puts their keyframes, metres.
std::vector<double> FixErrorsM(const Map& map, const Georeference& georeference);

/// Gives each keyframe the fix that the georeference stands for: without the errors of single ones,
/// and also where there was none.
void ReplaceFixes(const Georeference& georeference, LeanMap& map);

}  // namespace carmap
