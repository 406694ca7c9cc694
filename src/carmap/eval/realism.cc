#include "carmap/eval/realism.h"

#include <fmt/format.h>
#include <tbb/parallel_invoke.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <nlohmann/json.hpp>
#include <numeric>
#include <utility>

#include "carmap/eval/image_measures.h"
#include "carmap/eval/true_matches.h"
#include "carmap/feature/orb_extractor.h"
#include "carmap/feature/stereo_matcher.h"

namespace carmap {
namespace {

constexpr double kFactor = 1.5, kHammingFactor = 1.2;
/// Half side of the window in which a match is looked for, as a share of the image's width.
constexpr double kWindowShare = 0.05;

std::vector<MeasureInfo> MakeInfos() {
  std::vector<MeasureInfo> infos = {
      {"grey_mean", "grey level, mean", "", 1, kFactor},
      {"grey_spread", "grey level, spread", "", 1, kFactor},
      {"saturated_percent", "saturated pixels", "%", 2, kFactor, 0.5},
      {"gradient_median", "gradient, median", "/px", 2, kFactor},
      {"gradient_p90", "gradient, p90", "/px", 2, kFactor},
      {"flat_noise", "noise in flat places", "", 2, kFactor},
      {"spectrum_coarse", "spectrum 1/f^n, coarse", "n", 2, kFactor},
      {"spectrum_fine", "spectrum 1/f^n, fine", "n", 2, kFactor},
      {"features", "features extracted", "/image", 0, kFactor},
      {"weak_corners", "corners, contrast 7", "/image", 0, kFactor, 0, Scaling::kArea},
  };
  for (int level = 0; level < kLevelCount; ++level) {
    infos.push_back({fmt::format("corners_level_{}", level),
                     fmt::format("corners, contrast 20, level {}", level), "/image", 0, kFactor, 0,
                     Scaling::kArea});
  }
  const std::vector<MeasureInfo> others = {
      {"stereo_percent", "features with depth", "%", 1, kFactor},
      {"stereo_difference", "stereo match, difference", "", 2, kFactor},
      {"stereo_brightness", "stereo match, brightness off", "", 2, kFactor, 1},
      {"row_offset_px", "stereo match, row offset", "px", 3, kFactor, 0.05},
      {"disparity_px", "disparity", "px", 1, kFactor, 0, Scaling::kFocalLength},
      {"repeatability_percent", "found again (true match)", "%", 1, kFactor},
      {"place_distance_px", "true match, place off", "px", 2, kFactor},
      {"hamming_bits", "true match, Hamming", "bits", 0, kHammingFactor},
      {"ambiguous_percent", "true match, ambiguous", "%", 1, kFactor},
      {"track_frames", "track length", "frames", 0, kFactor},
      {"track_mean_m", "track length, mean", "m", 2, kFactor},
      {"m_per_frame", "driven a frame", "m", 2, 0},
  };
  infos.insert(infos.end(), others.begin(), others.end());
  return infos;
}

bool DifferMuch(int a, int b) { return std::max(a, b) > 1.2 * std::min(a, b); }

void Scale(std::vector<double>& samples, double factor) {
  for (double& sample : samples) sample *= factor;
}

void ScaleTo(const StereoRig& rig, DriveMeasures& measures) {
  const auto area = [](const PinholeCamera& camera) { return 1.0 * camera.width * camera.height; };
  const double area_factor = area(rig.camera) / area(measures.rig.camera);
  const double disparity_factor = rig.DisparityAt(1) / measures.rig.DisparityAt(1);
  for (size_t i = 0; i < kMeasureCount; ++i) {
    const Scaling scaling = InfoOf(static_cast<Measure>(i)).scaling;
    if (scaling == Scaling::kArea) Scale(measures.samples[i], area_factor);
    if (scaling == Scaling::kFocalLength) Scale(measures.samples[i], disparity_factor);
  }
}

/// Both sorted.
double KolmogorovSmirnov(const std::vector<double>& a, const std::vector<double>& b) {
  if (a.empty() || b.empty()) return a.empty() == b.empty() ? 0 : 1;
  double distance = 0;
  size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    const double value = std::min(a[i], b[j]);
    while (i < a.size() && a[i] <= value) ++i;
    while (j < b.size() && b[j] <= value) ++j;
    distance = std::max(distance, std::abs(static_cast<double>(i) / static_cast<double>(a.size()) -
                                           static_cast<double>(j) / static_cast<double>(b.size())));
  }
  return distance;
}

bool IsWithin(const MeasureInfo& info, double simulated, double real) {
  if (std::abs(simulated - real) <= info.negligible) return true;
  const double ratio = real > 0 ? simulated / real : 0;
  return ratio >= 1 / info.max_ratio && ratio <= info.max_ratio;
}

MeasureComparison Compare(Measure measure, std::vector<double> simulated,
                          std::vector<double> real) {
  std::sort(simulated.begin(), simulated.end());
  std::sort(real.begin(), real.end());
  MeasureComparison comparison{measure, DistributionOf(simulated), DistributionOf(real)};
  const double simulated_median = comparison.simulated.median, real_median = comparison.real.median;
  if (real_median != 0) comparison.ratio = simulated_median / real_median;
  comparison.distance = KolmogorovSmirnov(simulated, real);
  const MeasureInfo& info = InfoOf(measure);
  if (info.max_ratio > 0) {
    comparison.is_within =
        !simulated.empty() && !real.empty() && IsWithin(info, simulated_median, real_median);
  }
  return comparison;
}

nlohmann::ordered_json ToJson(const Distribution& d) {
  return {
      {"count", d.count}, {"mean", d.mean}, {"p10", d.p10}, {"median", d.median}, {"p90", d.p90}};
}

nlohmann::ordered_json CountsOf(const DriveMeasures& drive) {
  return {{"frames", drive.frames}, {"pairs", drive.pairs}, {"lost_pairs", drive.lost_pairs}};
}

template <typename T>
nlohmann::ordered_json ToJson(const std::optional<T>& value) {
  if (!value) return nullptr;
  return *value;
}

constexpr char kRow[] = "{:<29} {:<6}{} {}  {:>5} {:>8}  {}\n", kThree[] = " {:>5} {:>6} {:>5}";

std::string RowOf(const MeasureComparison& m) {
  const MeasureInfo& info = InfoOf(m.measure);
  const auto number = [&](double value) { return fmt::format("{:.{}f}", value, info.digits); };
  const auto three = [&](const Distribution& d) {
    if (d.count == 0) return fmt::format(kThree, "-", "-", "-");
    return fmt::format(kThree, number(d.p10), number(d.median), number(d.p90));
  };
  return fmt::format(kRow, info.name, info.unit, three(m.simulated), three(m.real),
                     m.ratio ? fmt::format("{:.2f}", *m.ratio) : "-",
                     fmt::format("{:.2f}", m.distance),
                     !m.is_within   ? "-"
                     : *m.is_within ? "yes"
                                    : "NO");
}

}  // namespace

const MeasureInfo& InfoOf(Measure measure) {
  static const std::vector<MeasureInfo> infos = MakeInfos();
  return infos[static_cast<size_t>(measure)];
}

std::vector<FrameChain> ChooseChains(size_t frame_count, size_t max_frames) {
  constexpr size_t kChainFrames = 16;
  const size_t frames = std::min(frame_count, max_frames);
  const size_t count = std::max<size_t>(1, frames / kChainFrames), length = frames / count;
  std::vector<FrameChain> chains;
  for (size_t i = 0; i < count; ++i) {
    const size_t first = count == 1 ? 0 : i * (frame_count - length) / (count - 1);
    chains.push_back({static_cast<uint32_t>(first), static_cast<uint32_t>(first + length - 1)});
  }
  return chains;
}

void RealismMeter::BeginChain() {
  EndTracks();
  previous_.reset();
}

void RealismMeter::Take(const cv::Mat& left, const cv::Mat& right) {
  ImagePyramid left_pyramid, right_pyramid;
  tbb::parallel_invoke([&] { left_pyramid = BuildPyramid(left); },
                       [&] { right_pyramid = BuildPyramid(right); });
  std::vector<Feature> features = OrbExtractor().Extract(left_pyramid);
  MatchStereo(left_pyramid, right_pyramid, measures_.rig, StereoOptions(), features);
  ++measures_.frames;
  TakeImage(left_pyramid);
  TakeStereo(left_pyramid, right_pyramid, features);
  if (previous_) {
    TakePair(*previous_, features);
  } else {
    tracks_.Begin(features.size());
  }
  previous_ = std::move(features);
}

DriveMeasures RealismMeter::Finish() {
  EndTracks();
  return std::move(measures_);
}

void RealismMeter::TakeImage(const ImagePyramid& left) {
  const GreyMeasures grey = MeasureGrey(left.front());
  Add(Measure::kGreyMean, grey.mean);
  Add(Measure::kGreySpread, grey.spread);
  Add(Measure::kSaturated, grey.saturated_percent);
  Add(Measure::kGradientMedian, grey.gradient_median);
  Add(Measure::kGradientP90, grey.gradient_p90);
  Add(Measure::kFlatNoise, grey.flat_noise);
  Add(Measure::kSpectrumCoarse, grey.spectrum_coarse);
  Add(Measure::kSpectrumFine, grey.spectrum_fine);
  const CornerCounts corners = CountCorners(left);
  Add(Measure::kWeakCorners, corners.weak);
  for (size_t level = 0; level < kLevelCount; ++level) {
    Add(static_cast<Measure>(static_cast<size_t>(Measure::kStrongCorners) + level),
        corners.strong[level]);
  }
}

void RealismMeter::TakeStereo(const ImagePyramid& left, const ImagePyramid& right,
                              const std::vector<Feature>& features) {
  size_t with_depth = 0;
  for (const Feature& feature : features) {
    if (!feature.has_disparity()) continue;
    ++with_depth;
    Add(Measure::kDisparity, feature.disparity_px);
    if (const auto fit = MeasureStereoFit(left, right, feature)) {
      Add(Measure::kStereoDifference, fit->difference);
      Add(Measure::kStereoBrightness, std::abs(fit->brightness));
      Add(Measure::kRowOffset, std::abs(fit->row_offset_px));
    }
  }
  const auto count = static_cast<double>(features.size());
  Add(Measure::kFeatures, count);
  if (count > 0) Add(Measure::kStereoShare, 100 * static_cast<double>(with_depth) / count);
}

void RealismMeter::TakePair(const std::vector<Feature>& from, const std::vector<Feature>& to) {
  const StereoRig& rig = measures_.rig;
  ++measures_.pairs;
  const auto motion = EstimateMotion(from, to, rig);
  if (!motion) {
    ++measures_.lost_pairs;
    EndTracks();
    tracks_.Begin(to.size());
    return;
  }
  const double moved_m = motion->translation.norm();
  Add(Measure::kMetresPerFrame, moved_m);
  const FeatureGrid grid(to, rig.camera.width, rig.camera.height);
  const auto predictions = PredictFeatures(from, *motion, rig);
  const auto matches = FindTrueMatches(predictions, grid, rig);
  TakeMatches(from, grid, predictions, matches);
  tracks_.Continue(predictions, matches, to.size(), moved_m);
}

void RealismMeter::TakeMatches(const std::vector<Feature>& from, const FeatureGrid& to,
                               const std::vector<PredictedFeature>& predictions,
                               const std::vector<TrueMatch>& matches) {
  const double window_px = kWindowShare * measures_.rig.camera.width;
  size_t ambiguous = 0;
  for (const TrueMatch& match : matches) {
    const PredictedFeature& prediction = predictions[match.prediction_idx];
    const Descriptor& descriptor = from[prediction.feature_idx].descriptor;
    Add(Measure::kPlaceDistance, match.distance_px);
    Add(Measure::kHamming,
        HammingDistance(descriptor, to.features()[match.feature_idx].descriptor));
    ambiguous += IsAmbiguous(descriptor, prediction, match, to, window_px) ? 1 : 0;
  }
  const auto percent = [](size_t part, size_t whole) {
    return 100 * static_cast<double>(part) / static_cast<double>(whole);
  };
  if (!predictions.empty()) {
    Add(Measure::kRepeatability, percent(matches.size(), predictions.size()));
  }
  if (!matches.empty()) Add(Measure::kAmbiguous, percent(ambiguous, matches.size()));
}

void RealismMeter::EndTracks() {
  const std::vector<TrackLength> tracks = tracks_.End();
  for (auto begin = tracks.begin(); begin != tracks.end();) {
    const auto end = std::find_if(begin, tracks.end(), [&](const TrackLength& track) {
      return track.first_frame != begin->first_frame;
    });
    double sum_m = 0;
    for (auto track = begin; track != end; ++track) {
      Add(Measure::kTrackFrames, static_cast<double>(track->frames));
      sum_m += track->driven_m;
    }
    Add(Measure::kTrackMetres, sum_m / static_cast<double>(end - begin));
    begin = end;
  }
}

Distribution DistributionOf(std::vector<double> samples) {
  if (samples.empty()) return {};
  std::sort(samples.begin(), samples.end());
  const auto count = static_cast<double>(samples.size());
  const auto nearest_rank = [&](double share) {
    return samples[static_cast<size_t>(std::ceil(share * count)) - 1];
  };
  return {.count = samples.size(),
          .mean = std::accumulate(samples.begin(), samples.end(), 0.0) / count,
          .p10 = nearest_rank(0.1),
          .median = nearest_rank(0.5),
          .p90 = nearest_rank(0.9)};
}

RealismComparison CompareRealism(DriveMeasures simulated, DriveMeasures real) {
  RealismComparison comparison;
  comparison.is_scaled = DifferMuch(simulated.rig.camera.width, real.rig.camera.width) ||
                         DifferMuch(simulated.rig.camera.height, real.rig.camera.height);
  if (comparison.is_scaled) ScaleTo(real.rig, simulated);
  for (size_t i = 0; i < kMeasureCount; ++i) {
    comparison.measures.push_back(
        Compare(static_cast<Measure>(i), simulated.samples[i], real.samples[i]));
    const auto& is_within = comparison.measures.back().is_within;
    comparison.bounded += is_within ? 1 : 0;
    comparison.within += is_within.value_or(false) ? 1 : 0;
  }
  comparison.simulated = std::move(simulated);
  comparison.real = std::move(real);
  return comparison;
}

nlohmann::ordered_json ToJson(const RealismComparison& comparison) {
  nlohmann::ordered_json json;
  json["simulated"] = CountsOf(comparison.simulated);
  json["real"] = CountsOf(comparison.real);
  json["scaled"] = comparison.is_scaled;
  json["within"] = comparison.within;
  json["bounded"] = comparison.bounded;
  json["measures"] = nlohmann::ordered_json::array();
  for (const MeasureComparison& m : comparison.measures) {
    const MeasureInfo& info = InfoOf(m.measure);
    json["measures"].push_back(
        {{"key", info.key},
         {"name", info.name},
         {"unit", info.unit},
         {"simulated", ToJson(m.simulated)},
         {"real", ToJson(m.real)},
         {"ratio", ToJson(m.ratio)},
         {"max_ratio",
          info.max_ratio > 0 ? nlohmann::ordered_json(info.max_ratio) : nlohmann::ordered_json()},
         {"distance", m.distance},
         {"within", ToJson(m.is_within)}});
  }
  return json;
}

std::string ToText(const RealismComparison& comparison) {
  const std::string header = fmt::format(kThree, "p10", "median", "p90");
  std::string text =
      fmt::format("{:36}{:^19} {:>11}\n", "", "simulated", "real") +
      fmt::format(kRow, "measure", "unit", header, header, "ratio", "distance", "within");
  for (const MeasureComparison& m : comparison.measures) text += RowOf(m);
  for (const auto& [name, drive] :
       {std::pair("simulated", &comparison.simulated), std::pair("real", &comparison.real)}) {
    fmt::format_to(std::back_inserter(text), "{:<9}  {} frames, {} pairs, {} without a motion\n",
                   name, drive->frames, drive->pairs, drive->lost_pairs);
  }
  const MeasureComparison& tracks = comparison.measures[static_cast<size_t>(Measure::kTrackFrames)];
  fmt::format_to(std::back_inserter(text), "mean track {:.2f} frames (real: {:.2f})\n",
                 tracks.simulated.mean, tracks.real.mean);
  if (comparison.is_scaled) {
    text +=
        "images differ in size: the simulated drive's counts and disparities are scaled to the "
        "real one's\n";
  }
  fmt::format_to(std::back_inserter(text),
                 "{} of {} medians are within their bounds (a factor of {}, Hamming distance {})\n",
                 comparison.within, comparison.bounded, kFactor, kHammingFactor);
  return text;
}

}  // namespace carmap
