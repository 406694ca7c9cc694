#include "carmap/sim/simulation.h"

#include <fmt/format.h>
#include <tbb/parallel_invoke.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "carmap/base/random.h"
#include "carmap/base/status_macros.h"
#include "carmap/sim/ego_motion.h"
#include "carmap/sim/render/renderer.h"
#include "carmap/sim/town/world_builder.h"

namespace carmap {
namespace {

struct PlannedWorld {
  Route route;
  std::vector<Eigen::Vector3d> heights;
  World world;
};

absl::StatusOr<PlannedWorld> Plan(const WorldOptions& options,
                                  const std::optional<Trajectory>& recorded) {
  if (recorded) {
    CARMAP_ASSIGN_OR_RETURN(RecordedPath path, RouteAlong(*recorded));
    World world = BuildWorld(options.scene, path.route, path.positions_in_enu, options.seed);
    return PlannedWorld{path.route, std::move(path.positions_in_enu), std::move(world)};
  }
  Route route = MakeRoute(options.shape, options.scene, options.length_m, options.seed);
  World world = BuildWorld(options.scene, route, {}, options.seed);
  return PlannedWorld{std::move(route), {}, std::move(world)};
}

template <typename Number>
absl::Status CheckRange(const char* what, Number value, Number low, Number high) {
  if (value >= low && value <= high) return absl::OkStatus();
  return absl::InvalidArgumentError(
      fmt::format("{} {} is not between {} and {}; choose one that is", what, value, low, high));
}

absl::Status CheckOptions(const WorldOptions& world, const DriveOptions& drive) {
  CARMAP_RETURN_IF_ERROR(CheckRange("length", world.length_m, 100.0, 20'000.0));
  CARMAP_RETURN_IF_ERROR(CheckRange("width", drive.width, 64, 4096));
  CARMAP_RETURN_IF_ERROR(CheckRange("height", drive.height, 32, 4096));
  CARMAP_RETURN_IF_ERROR(CheckRange("frame rate", drive.frame_rate_hz, 1.0, 100.0));
  CARMAP_RETURN_IF_ERROR(CheckRange("GPS rate", drive.gps_rate_hz, 1.0, 10.0));
  const LaneRange lanes = LanesOf(world.scene, drive.reverse);
  CARMAP_RETURN_IF_ERROR(CheckRange("lane", drive.lane, lanes.first, lanes.last));
  if (drive.frames) {
    CARMAP_RETURN_IF_ERROR(
        CheckRange("number of frames", *drive.frames, size_t{1}, size_t{100'000}));
  }
  if (drive.speed_mps) {
    CARMAP_RETURN_IF_ERROR(CheckRange("speed", *drive.speed_mps, 0.5, 60.0));
  }
  return absl::OkStatus();
}

/// Metres to the left of the route, whichever way it is driven.
double LeftOfRoute(const DriveOptions& drive, const RoadProfile& profile) {
  const int lane = drive.reverse ? profile.last_oncoming - drive.lane : drive.lane;
  return lane * profile.lane_width_m;
}

/// Where along the route the recorded frames were; standing still stays standing still.
std::vector<double> AlongAsRecorded(const Route& route,
                                    const std::vector<Eigen::Vector3d>& positions) {
  std::vector<double> along;
  double s = 0;
  for (size_t i = 0; i < positions.size(); ++i) {
    if (i > 0) s += (positions[i] - positions[i - 1]).head<2>().norm();
    along.push_back(s);
  }
  const double scale = s > 0 ? route.length_m() / s : 0;
  for (double& value : along) value *= scale;
  return along;
}

std::vector<double> PlanDrive(const PlannedWorld& planned, const DriveOptions& drive,
                              double usual_speed_mps) {
  constexpr size_t kMaxFrames = 100'000;
  const Route& route = planned.route;
  std::vector<double> along;
  if (!planned.heights.empty() && !drive.speed_mps) {
    along = AlongAsRecorded(route, planned.heights);
  } else {
    along = AlongAtSpeed(route, drive.speed_mps.value_or(usual_speed_mps), drive.frame_rate_hz,
                         drive.frames.value_or(kMaxFrames));
  }
  if (!drive.frames && route.closed()) {
    along.erase(std::find_if(along.begin(), along.end(),
                             [&](double s) { return s > route.length_m() + 1; }),
                along.end());
  }
  if (drive.reverse) {
    for (double& s : along) s = route.length_m() - s;
  }
  along.resize(std::min(along.size(), drive.frames.value_or(along.size())));
  return along;
}

/// Two cameras with faults as large as those of KITTI's: a few tenths of a pixel between what
/// rectification should give and gives, a few percent of brightness.
std::array<SimulatedCamera, 2> DrawCameras(const DriveOptions& drive) {
  constexpr double kRadPerPx = 1 / 718.856, kEdgeX = 0.86, kEdgeY = 0.26;
  constexpr std::array<double, 6> kAtEdge = {
      1, kEdgeX, kEdgeY, kEdgeX * kEdgeX, kEdgeX * kEdgeY, kEdgeY * kEdgeY};
  constexpr std::array<double, 6> kColumnPx = {0.15, 0.15, 0.08, 0.35, 0.15, 0.08};
  constexpr std::array<double, 6> kRowPx = {0.25, 0.5, 0.25, 0.35, 0.45, 0.1};
  std::array<SimulatedCamera, 2> cameras;
  for (size_t i = 0; i < cameras.size(); ++i) {
    auto& [residual, sensor] = cameras[i];
    sensor.seed = HashKeys(drive.traffic_seed, drive.light_seed);
    if (drive.rig_seed == 0) continue;
    HashSequence draw(drive.rig_seed, i);
    for (size_t k = 0; k < kAtEdge.size(); ++k) {
      const double rad = kRadPerPx / kAtEdge[k];
      residual.column[k] = static_cast<float>(rad * kColumnPx[k] * draw.Between(-1, 1));
      residual.row[k] = static_cast<float>(rad * kRowPx[k] * draw.Between(-1, 1));
    }
    sensor.sensitivity = draw.Between(0.96, 1.04);
    sensor.black_level = draw.Between(-2, 2);
    sensor.vignetting = draw.Between(0.1, 0.2);
  }
  return cameras;
}

}  // namespace

// On a road without a median the oncoming lanes may be used too.
LaneRange LanesOf(Scene scene, bool reverse) {
  const RoadProfile profile = ProfileOf(scene);
  const bool divided = profile.last_lane < profile.first_oncoming;
  if (!reverse) return {profile.first_lane, divided ? profile.last_lane : profile.last_oncoming};
  return {0, profile.last_oncoming - (divided ? profile.first_oncoming : profile.first_lane)};
}

StereoRig SimulatedRig(int width, int height) {
  const double focal_px = 718.856 * width / 1241;
  // KITTI's principal point lies a little above the middle.
  return {{focal_px, focal_px, 0.5 * (width - 1), 0.485 * height, width, height}, 0.54};
}

struct Simulation::Impl {
  StereoRig rig;
  Route route;
  std::shared_ptr<const World> world;
  EgoMotion ego;
  Light light;
  std::array<SimulatedCamera, 2> cameras;
  GpsModel gps_model;
  Trajectory enu_from_camera;
  std::vector<SimulatedFix> fixes;
  std::unique_ptr<Traffic> traffic;
  std::unique_ptr<Renderer> renderer;
  std::map<size_t, double> metered_gain;  ///< by frame, of the last few

  RenderedView RenderLeft(size_t frame_idx) {
    renderer->SetTraffic(traffic->At(frame_idx));
    return renderer->Render(rig.camera, ego.EnuFromCamera(frame_idx), ego.MotionAt(frame_idx),
                            cameras[0].residual);
  }
  double GainFor(size_t frame_idx);
};

/// An automatic exposure that follows the light over the last four frames.
double Simulation::Impl::GainFor(size_t frame_idx) {
  constexpr size_t kFrames = 4;
  const size_t first = frame_idx > kFrames ? frame_idx - kFrames : 0;
  const size_t end = std::max<size_t>(frame_idx, 1);
  double log_gain = 0;
  for (size_t i = first; i < end; ++i) {
    if (!metered_gain.contains(i)) metered_gain[i] = AutomaticGain(RenderLeft(i).radiance);
    log_gain += std::log(metered_gain.at(i)) / static_cast<double>(end - first);
  }
  metered_gain.erase(metered_gain.begin(), metered_gain.lower_bound(first));
  return std::exp(log_gain);
}

absl::StatusOr<std::unique_ptr<Simulation>> Simulation::Create(
    const WorldOptions& world_options, const DriveOptions& drive,
    const std::optional<Trajectory>& recorded, const std::vector<Change>& changes) {
  CARMAP_RETURN_IF_ERROR(CheckOptions(world_options, drive));
  const RoadProfile profile = ProfileOf(world_options.scene);
  CARMAP_ASSIGN_OR_RETURN(PlannedWorld planned, Plan(world_options, recorded));
  CARMAP_RETURN_IF_ERROR(ApplyChanges(changes, planned.world));
  const std::vector<double> along = PlanDrive(planned, drive, profile.speed_mps);

  const auto world = std::make_shared<const World>(std::move(planned.world));
  EgoMotionOptions ego_options;
  ego_options.frame_rate_hz = drive.frame_rate_hz;
  ego_options.left_m = LeftOfRoute(drive, profile);
  ego_options.reverse = drive.reverse;
  ego_options.road_seed = HashKeys(world_options.seed, static_cast<uint64_t>(drive.lane + 100));
  auto impl = std::unique_ptr<Impl>(
      new Impl{.rig = SimulatedRig(drive.width, drive.height),
               .route = planned.route,
               .world = world,
               .ego = EgoMotion(planned.route, world->ground, along, ego_options),
               .light = MakeLight(drive.weather, drive.light_seed),
               .cameras = DrawCameras(drive),
               .gps_model = ModelOf(drive.gps)});
  impl->gps_model.rate_hz = drive.gps_rate_hz;
  for (size_t i = 0; i < along.size(); ++i) {
    impl->enu_from_camera.push_back(
        {Timestamp::FromSeconds(impl->ego.TimeOf(i)), impl->ego.EnuFromCamera(i)});
  }
  impl->fixes = SimulateGps(impl->enu_from_camera, world->origin, impl->gps_model,
                            HashKeys(drive.traffic_seed, drive.light_seed));
  impl->traffic =
      std::make_unique<Traffic>(world, planned.route, profile, drive.traffic, drive.traffic_seed,
                                impl->ego.States(), static_cast<uint32_t>(world->models.size()));
  impl->renderer =
      std::make_unique<Renderer>(world, impl->traffic->models(), impl->light, world_options.seed);
  return std::unique_ptr<Simulation>(new Simulation(std::move(impl)));
}

Simulation::Simulation(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Simulation::~Simulation() = default;

size_t Simulation::frame_count() const { return impl_->ego.frame_count(); }
const StereoRig& Simulation::rig() const { return impl_->rig; }
const Trajectory& Simulation::enu_from_camera() const { return impl_->enu_from_camera; }
const World& Simulation::world() const { return *impl_->world; }
const Route& Simulation::route() const { return impl_->route; }
const Light& Simulation::light() const { return impl_->light; }
const std::array<SimulatedCamera, 2>& Simulation::cameras() const { return impl_->cameras; }
const GpsModel& Simulation::gps_model() const { return impl_->gps_model; }
const std::vector<SimulatedFix>& Simulation::fixes() const { return impl_->fixes; }

SimulatedFrame Simulation::Render(size_t frame_idx) {
  const double gain = impl_->GainFor(frame_idx);
  const auto frame = static_cast<uint32_t>(frame_idx);
  const SimulatedCamera &left = impl_->cameras[0], &right = impl_->cameras[1];
  impl_->renderer->SetTraffic(impl_->traffic->At(frame_idx));
  SimulatedFrame result;
  auto views = impl_->renderer->RenderStereo(impl_->rig, impl_->ego.EnuFromCamera(frame_idx),
                                             impl_->ego.MotionAt(frame_idx),
                                             {left.residual, right.residual});
  result.left_truth = std::move(views[0]);
  result.right_truth = std::move(views[1]);
  impl_->metered_gain[frame_idx] = AutomaticGain(result.left_truth.radiance);
  tbb::parallel_invoke(
      [&] { result.left = Expose(result.left_truth, left.sensor, gain, frame, 0); },
      [&] { result.right = Expose(result.right_truth, right.sensor, gain, frame, 1); });
  return result;
}

absl::StatusOr<std::vector<Change>> DrawChangesOf(const WorldOptions& world,
                                                  const std::optional<Trajectory>& recorded,
                                                  uint64_t seed) {
  CARMAP_ASSIGN_OR_RETURN(const PlannedWorld planned, Plan(world, recorded));
  return DrawChanges(planned.world, planned.route, seed);
}

}  // namespace carmap
