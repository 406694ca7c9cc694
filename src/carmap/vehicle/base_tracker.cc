#include "carmap/vehicle/base_tracker.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>

#include "carmap/localize/landmark_matcher.h"
#include "carmap/localize/landmark_shift.h"
#include "carmap/localize/motion_model.h"

namespace carmap {
namespace {

/// Landmarks around a place serve as long as the vehicle is so near to it.
constexpr double kNeighbourhoodM = 3, kNeighbourhoodRad = 0.2;
/// A pose settles when the second search starts so near to the first one's result.
constexpr double kSettledM = 0.05, kSettledRad = 0.001;

double DistanceBetween(const UncertainPose& a, const UncertainPose& b) {
  return (a.camera_from_base.Inverse().translation - b.camera_from_base.Inverse().translation)
      .norm();
}

}  // namespace

BaseTracker::BaseTracker(std::shared_ptr<const ReconstructedMap> base, const StereoRig& rig,
                         std::shared_ptr<const Vocabulary> vocabulary,
                         const BaseTrackerOptions& options)
    : rig_(rig), vocabulary_(std::move(vocabulary)), options_(options) {
  Swap(std::move(base));
}

void BaseTracker::Swap(std::shared_ptr<const ReconstructedMap> base) {
  search_.reset();  // before the map that it searches
  base_ = std::move(base);
  search_.emplace(*base_, vocabulary_, options_.search);
  neighbourhood_.clear();
}

VehiclePose BaseTracker::Take(const ExtractedFrame& frame, const TrackedFrame& own) {
  const std::optional<Step> step = StepOf(frame, own);
  if (!own.reference) {  // nothing but its motion so far tells where it is
    return step ? Report(*step, {}) : VehiclePose();
  }
  rig_.disparity_bias = own.disparity_bias;
  const FeatureGrid grid(*frame.features, rig_.camera.width, rig_.camera.height);
  Observation seen;
  if (step && window_) {
    const UncertainPose predicted = AfterMotion(window_->newest(), step->motion, step->covariance);
    if (auto observation = Observe(grid, predicted)) seen = *std::move(observation);
    window_->Add(step->motion, step->covariance, std::move(seen.landmarks));
    dead_reckoned_m_ =
        seen.inliers.empty() ? dead_reckoned_m_ + step->motion.translation.norm() : 0;
    unclear_m_ += step->motion.translation.norm();
    if (seen.inliers.size() >= options_.clear_inliers) {
      unclear_m_ = 0;
      motion_known_at_s_ = frame.timestamp.seconds();
    }
    if (SigmaM(window_->newest().covariance) > options_.max_sigma_m) window_.reset();
  }
  if (step) FollowHypotheses(grid, *step);
  if (!window_ || unclear_m_ > options_.search_after_m ||
      SigmaM(window_->newest().covariance) > options_.search_sigma_m) {
    SearchPlaces(grid, frame.gps);
    if (const Hypothesis* believed = BelievedHypothesis()) Believe(*believed, seen);
  } else {
    hypotheses_.clear();
  }
  return Report({}, std::move(seen));
}

/// By the drive's own tracking; where that was lost or says what no vehicle can do, the vehicle is
/// taken to have kept its speed.
std::optional<BaseTracker::Step> BaseTracker::StepOf(const ExtractedFrame& frame,
                                                     const TrackedFrame& own) {
  const double elapsed_s = last_time_ ? frame.timestamp.seconds() - last_time_->seconds() : 0;
  std::optional<Step> step;
  const bool is_steady =
      own.camera_from_previous && IsPossible(*own.camera_from_previous, own.since_previous_s,
                                             frame.timestamp.seconds() - motion_known_at_s_);
  const bool is_believed =
      own.camera_from_previous && (is_steady || steady_motions_ < options_.steady_motions);
  if (is_believed) {
    MotionNoise noise = options_.window.motion;
    if (!is_steady || steady_motions_ < options_.steady_motions)
      noise.step_m = options_.unsteady_step_m;
    step = Step{*own.camera_from_previous, MotionCovariance(*own.camera_from_previous, noise)};
  } else if (last_motion_s_ > 0) {
    const Rigid3 motion = Extrapolate(last_motion_, elapsed_s / last_motion_s_);
    MotionNoise noise = options_.window.motion;
    noise.drift_ratio = options_.unseen_motion_ratio;
    noise.drift_rad_per_m = options_.unseen_motion_ratio / 10;
    step = Step{motion, MotionCovariance(motion, noise)};
  }
  if (own.reference) last_time_ = frame.timestamp;
  if (is_believed) {
    steady_motions_ = is_steady ? steady_motions_ + 1 : 1;
    last_motion_ = *own.camera_from_previous;
    last_motion_s_ = own.since_previous_s;
    motion_known_at_s_ = frame.timestamp.seconds();
  }
  return step;
}

/// Whether a vehicle that moved as the last possible motion says can move so that much later.
bool BaseTracker::IsPossible(const Rigid3& motion, double interval_s, double elapsed_s) const {
  if (last_motion_s_ <= 0 || interval_s <= 0) return true;
  const double speed_m_s = last_motion_.translation.norm() / last_motion_s_;
  const Eigen::Vector3d change_m_s =
      motion.translation / interval_s - last_motion_.translation / last_motion_s_;
  return change_m_s.norm() <= options_.max_acceleration_m_s2 * elapsed_s +
                                  options_.speed_tolerance_m_s +
                                  options_.speed_tolerance_ratio * speed_m_s;
}

const std::vector<uint32_t>& BaseTracker::LandmarksNear(const Rigid3& base_from_camera) {
  const Rigid3 moved = neighbourhood_center_.Inverse() * base_from_camera;
  if (neighbourhood_.empty() || moved.translation.norm() > kNeighbourhoodM ||
      RotationAngle(moved.rotation) > kNeighbourhoodRad) {
    neighbourhood_center_ = base_from_camera;
    neighbourhood_ = LandmarksAround(*base_, base_from_camera, options_.neighbourhood);
  }
  return neighbourhood_;
}

SeenLandmarks BaseTracker::See(const FeatureGrid& grid, const Rigid3& camera_from_base,
                               const std::vector<LandmarkMatch>& matches) const {
  SeenLandmarks seen;
  seen.measurements = MeasurementsOf(base_->snapshot, grid.features(), rig_, matches);
  for (size_t i = 0; i < matches.size(); ++i) {
    const LandmarkShift shift = ShiftOf(base_->snapshot.landmarks[matches[i].landmark_idx], rig_,
                                        camera_from_base, options_.window.noise);
    seen.common_shift_px.push_back(options_.common_disparity_px * shift.along);
    seen.measurements[i].landmark_sigma_px = shift.sigma_px;
  }
  return seen;
}

PoseEstimate BaseTracker::MatchAndRefine(const FeatureGrid& grid, const UncertainPose& predicted,
                                         const Rigid3& camera_from_base, double position_radius_m,
                                         double radius_px, Observation& observation) {
  const std::vector<LandmarkMatch> matches = MatchByProjection(
      base_->snapshot, LandmarksNear(camera_from_base.Inverse()), grid, rig_, camera_from_base,
      {.radius_px = radius_px, .position_radius_m = position_radius_m});
  observation = {See(grid, camera_from_base, matches), matches};
  return RefinePose(rig_, options_.window.noise, observation.landmarks.measurements,
                    camera_from_base, kInitialErrorPx,
                    PosePrior{predicted.camera_from_base, predicted.covariance.inverse()});
}

std::optional<BaseTracker::Observation> BaseTracker::Observe(const FeatureGrid& grid,
                                                             const UncertainPose& predicted) {
  const double position_radius_m = options_.search_sigmas * SigmaM(predicted.covariance);
  const double radius_px = options_.min_radius_px +
                           options_.search_sigmas * rig_.camera.fx * SigmaRad(predicted.covariance);
  Observation seen;
  PoseEstimate estimate = MatchAndRefine(grid, predicted, predicted.camera_from_base,
                                         position_radius_m, radius_px, seen);
  const Vector6d moved = PoseDifference(predicted.camera_from_base, estimate.camera_from_map);
  if (moved.head<3>().norm() > kSettledM || moved.tail<3>().norm() > kSettledRad) {
    estimate =
        MatchAndRefine(grid, predicted, estimate.camera_from_map, 0, options_.min_radius_px, seen);
  }
  const auto inliers = static_cast<size_t>(estimate.inlier_count);
  const Vector6d deviation = PoseDifference(predicted.camera_from_base, estimate.camera_from_map);
  if (inliers < options_.min_inliers ||
      static_cast<double>(inliers) <
          options_.min_inlier_share * static_cast<double>(seen.inliers.size()) ||
      deviation.dot(predicted.covariance.ldlt().solve(deviation)) > options_.max_square_deviation) {
    return std::nullopt;
  }
  Observation agreeing;
  agreeing.landmarks.inlier_share =
      static_cast<double>(inliers) / static_cast<double>(seen.inliers.size());
  for (size_t i = 0; i < seen.inliers.size(); ++i) {
    if (!estimate.is_inlier[i]) continue;
    agreeing.inliers.push_back(seen.inliers[i]);
    agreeing.landmarks.measurements.push_back(seen.landmarks.measurements[i]);
    agreeing.landmarks.common_shift_px.push_back(seen.landmarks.common_shift_px[i]);
  }
  return agreeing;
}

bool BaseTracker::IsFollowed(const std::vector<Hypothesis>& hypotheses,
                             const UncertainPose& pose) const {
  return std::any_of(hypotheses.begin(), hypotheses.end(), [&](const Hypothesis& known) {
    return DistanceBetween(known.pose, pose) < options_.same_place_m;
  });
}

/// Those that come together are one: the one followed for longer stays.
void BaseTracker::FollowHypotheses(const FeatureGrid& grid, const Step& step) {
  std::vector<Hypothesis> followed;
  for (Hypothesis& hypothesis : hypotheses_) {
    hypothesis.pose = AfterMotion(hypothesis.pose, step.motion, step.covariance);
    const auto found = TrackAround(*base_, grid, rig_, hypothesis.pose.camera_from_base,
                                   options_.search.tracking, options_.neighbourhood);
    if (!found && !hypothesis.is_seen) continue;  // twice in a row
    hypothesis.is_seen = found.has_value();
    hypothesis.inliers.clear();
    if (found) {
      hypothesis.pose = {found->camera_from_map, WithSharedErrors(found->covariance)};
      hypothesis.inliers = found->inliers;
      hypothesis.total_inliers += found->inliers.size();
      ++hypothesis.frames;
    }
    if (!IsFollowed(followed, hypothesis.pose)) followed.push_back(std::move(hypothesis));
  }
  hypotheses_ = std::move(followed);
}

void BaseTracker::SearchPlaces(const FeatureGrid& grid, const std::optional<GpsFix>& gps) {
  for (PlaceHypothesis& place : search_->Search(grid, rig_, gps)) {
    const UncertainPose pose{place.camera_from_map, WithSharedErrors(place.covariance)};
    if (IsFollowed(hypotheses_, pose) || hypotheses_.size() == options_.max_hypotheses) continue;
    const size_t inliers = place.inliers.size();
    hypotheses_.push_back({pose, std::move(place.inliers), inliers,
                           /*frames=*/1,
                           /*is_seen=*/true});
  }
}

/// The hypothesis that frames enough agree with, or one frame beyond doubt, if no other comes near.
const BaseTracker::Hypothesis* BaseTracker::BelievedHypothesis() const {
  const auto best = std::max_element(
      hypotheses_.begin(), hypotheses_.end(),
      [](const Hypothesis& a, const Hypothesis& b) { return a.total_inliers < b.total_inliers; });
  if (best == hypotheses_.end() || !best->is_seen) return nullptr;
  const bool is_sure = best->inliers.size() >= options_.sure_place_inliers ||
                       (best->frames >= options_.min_place_frames &&
                        best->total_inliers >= options_.total_place_inliers);
  const bool has_rival =
      std::any_of(hypotheses_.begin(), hypotheses_.end(), [&](const Hypothesis& other) {
        return &other != &*best &&
               static_cast<double>(other.total_inliers) >
                   options_.max_rival_share * static_cast<double>(best->total_inliers);
      });
  return is_sure && !has_rival ? &*best : nullptr;
}

/// Goes on from there, unless the vehicle knows better where it is.
void BaseTracker::Believe(const Hypothesis& hypothesis, Observation& seen) {
  const bool is_confirmed =
      window_ && DistanceBetween(hypothesis.pose, window_->newest()) < options_.same_place_m;
  const bool is_better = static_cast<double>(hypothesis.inliers.size()) >=
                         options_.min_gain * static_cast<double>(seen.inliers.size());
  if (!is_confirmed && is_better) {
    seen.inliers = hypothesis.inliers;
    window_.emplace(rig_, options_.window, hypothesis.pose);
    dead_reckoned_m_ = 0;
  }
  if (is_confirmed || is_better) {
    unclear_m_ = 0;
    hypotheses_.clear();
  }
}

/// `step` leads from the window's newest frame to the present one.
VehiclePose BaseTracker::Report(const Step& step, Observation seen) {
  VehiclePose result;
  if (!window_) return result;
  result.pose = AfterMotion(window_->newest(), step.motion, step.covariance);
  result.inliers = std::move(seen.inliers);
  result.known_by = result.inliers.empty() ? KnownBy::kDeadReckoning : KnownBy::kMap;
  result.dead_reckoned_m = dead_reckoned_m_ + step.motion.translation.norm();
  if (SigmaM(result.pose->covariance) > options_.max_sigma_m) result = VehiclePose();
  return result;
}

}  // namespace carmap
