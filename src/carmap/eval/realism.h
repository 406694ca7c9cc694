// Whether a simulated drive is like a real one to the project's own front end.
//
// A meter takes the frames of a drive and collects samples of each measure: what images are like,
// which corners they have, how stereo matches fit, and what becomes of features from frame to frame
// (true_matches.h). Two drives are then compared measure by measure. Deterministic: the number of
// threads does not change a sample. A meter is used by one thread.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <vector>

#include "carmap/eval/feature_tracks.h"
#include "carmap/feature/feature.h"
#include "carmap/feature/image_pyramid.h"
#include "carmap/geometry/camera.h"

namespace carmap {

enum class Measure : size_t {
  kGreyMean,
  kGreySpread,
  kSaturated,
  kGradientMedian,
  kGradientP90,
  kFlatNoise,
  kSpectrumCoarse,
  kSpectrumFine,
  kFeatures,
  kWeakCorners,
  kStrongCorners,  ///< of level 0; kLevelCount measures, one a level
  kStereoShare = kStrongCorners + kLevelCount,
  kStereoDifference,
  kStereoBrightness,
  kRowOffset,
  kDisparity,
  kRepeatability,
  kPlaceDistance,
  kHamming,
  kAmbiguous,
  kTrackFrames,
  kTrackMetres,  ///< mean of the tracks that begin in one frame
  kMetresPerFrame,
  kCount
};
inline constexpr size_t kMeasureCount = static_cast<size_t>(Measure::kCount);

/// How the samples of a measure scale with image size.
enum class Scaling { kNone, kArea, kFocalLength };

struct MeasureInfo {
  std::string key, name;  ///< for JSON and for people, ASCII
  std::string unit;
  int digits = 1;         ///< behind the point
  double max_ratio = 0;   ///< of the medians, either way, of drives that are alike; 0: no bound
  double negligible = 0;  ///< a difference of the medians up to this is none
  Scaling scaling = Scaling::kNone;
};
const MeasureInfo& InfoOf(Measure measure);

/// Samples of all measures of one drive: one an image, a pair of images, a feature or a match.
struct DriveMeasures {
  StereoRig rig;
  size_t frames = 0, pairs = 0;
  size_t lost_pairs = 0;  ///< without a motion
  std::array<std::vector<double>, kMeasureCount> samples;

  std::vector<double>& operator[](Measure m) { return samples[static_cast<size_t>(m)]; }
  const std::vector<double>& operator[](Measure m) const { return samples[static_cast<size_t>(m)]; }
};

/// Successive frames of a drive, both included, by their numbers.
struct FrameChain {
  uint32_t first = 0, last = 0;
};

/// At most `max_frames` (at least one) of a drive's frames, as chains spread evenly over it, long
/// enough to follow features and short enough to see many places.
std::vector<FrameChain> ChooseChains(size_t frame_count, size_t max_frames);

class RealismMeter {
 public:
  explicit RealismMeter(const StereoRig& rig) { measures_.rig = rig; }

  /// The next frame is not the successor of the one before.
  void BeginChain();
  /// Images of the rig's size, 8-bit grey.
  void Take(const cv::Mat& left, const cv::Mat& right);
  /// Call once, at the end.
  DriveMeasures Finish();

 private:
  void Add(Measure measure, double sample) { measures_[measure].push_back(sample); }
  void TakeImage(const ImagePyramid& left);
  void TakeStereo(const ImagePyramid& left, const ImagePyramid& right,
                  const std::vector<Feature>& features);
  void TakePair(const std::vector<Feature>& from, const std::vector<Feature>& to);
  void TakeMatches(const std::vector<Feature>& from, const FeatureGrid& to,
                   const std::vector<PredictedFeature>& predictions,
                   const std::vector<TrueMatch>& matches);
  void EndTracks();

  DriveMeasures measures_;
  std::optional<std::vector<Feature>> previous_;  ///< features of the chain's last frame
  FeatureTracks tracks_;
};

struct Distribution {
  size_t count = 0;
  double mean = 0, p10 = 0, median = 0, p90 = 0;
};
/// All zero for no samples. The percentiles are nearest-rank.
Distribution DistributionOf(std::vector<double> samples);

struct MeasureComparison {
  Measure measure;
  Distribution simulated, real;
  std::optional<double> ratio;  ///< of the medians; absent if there is nothing to divide by
  /// Largest difference of the cumulative distributions (Kolmogorov-Smirnov), 0 (the same) to 1.
  double distance = 0;
  std::optional<bool> is_within;  ///< the bound; absent if there is none
};

struct RealismComparison {
  DriveMeasures simulated;  ///< scaled, if `is_scaled`
  DriveMeasures real;
  /// The images differ in width or height by more than a fifth: counts of the simulated drive are
  /// scaled to the area, and disparities to the focal length and baseline, of the real one.
  bool is_scaled = false;
  std::vector<MeasureComparison> measures;
  size_t within = 0, bounded = 0;  ///< measures within their bounds, and those that have one
};

RealismComparison CompareRealism(DriveMeasures simulated, DriveMeasures real);

/// Keys of a report: simulated and real {frames pairs lost_pairs}, scaled, within, bounded,
/// measures[{key name unit simulated{count mean p10 median p90} real{…} ratio max_ratio distance
/// within}].
nlohmann::ordered_json ToJson(const RealismComparison& comparison);

/// A table for a person to read, ending with a new line.
std::string ToText(const RealismComparison& comparison);

}  // namespace carmap
