// A simulated drive: a world, the vehicle's way through it, traffic, light and sensors (§5.1).
//
// Frames follow from the options alone, each by itself: in any order, the same bytes. Owned by one
// thread; rendering uses all cores.
#pragma once

#include <absl/status/statusor.h>

#include <array>
#include <cstdint>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <vector>

#include "carmap/dataset/trajectory.h"
#include "carmap/geometry/camera.h"
#include "carmap/sim/gps_simulator.h"
#include "carmap/sim/render/light.h"
#include "carmap/sim/render/renderer.h"
#include "carmap/sim/render/sensor.h"
#include "carmap/sim/road/route.h"
#include "carmap/sim/road/route_shapes.h"
#include "carmap/sim/road/scene.h"
#include "carmap/sim/town/change.h"
#include "carmap/sim/town/world.h"
#include "carmap/sim/traffic/traffic.h"

namespace carmap {

/// The world: the same for all drives that are to meet in it.
struct WorldOptions {
  Scene scene = Scene::kSuburb;
  RouteShape shape = RouteShape::kCurves;  ///< unless the drive follows a recorded path
  double length_m = 1000;                  ///< of the route, unless recorded
  uint64_t seed = 1;
};

/// One drive through it.
struct DriveOptions {
  std::optional<size_t> frames = std::nullopt;  ///< absent: to the end of the route, or one lap
  int width = 1241, height = 376;               ///< pixels
  double frame_rate_hz = 10;
  int lane = 0;  ///< to the left of the route's own, seen in the direction of driving
  std::optional<double> speed_mps = std::nullopt;  ///< absent: the scene's, or as recorded
  bool reverse = false;
  TrafficDensity traffic = TrafficDensity::kParked;
  uint64_t traffic_seed = 1;
  Weather weather = Weather::kSunny;
  uint64_t light_seed = 1;
  uint64_t rig_seed = 1;  ///< of what calibration left of the cameras' faults; 0: a perfect rig
  GpsQuality gps = GpsQuality::kOpen;
  double gps_rate_hz = 10;
};

/// Lanes that a drive may choose, DriveOptions::lane, from right to left.
struct LaneRange {
  int first = 0, last = 0;
};
LaneRange LanesOf(Scene scene, bool reverse);

/// A left or right camera: what its makers and its calibration left to be wished.
struct SimulatedCamera {
  RectificationResidual residual;
  SensorOptions sensor;
};

/// KITTI's stereo rig (fx 718.856 px at 1241 px of width, baseline 0.54 m) at another size: the
/// field of view across stays.
StereoRig SimulatedRig(int width, int height);

struct SimulatedFrame {
  cv::Mat left, right;  ///< CV_8U
  RenderedView left_truth, right_truth;
};

class Simulation {
 public:
  /// `recorded` is a path in KITTI's frame to build the world along and to follow. Errors:
  /// InvalidArgument for options outside their limits, each with what is allowed; as RouteAlong; as
  /// ApplyChanges.
  static absl::StatusOr<std::unique_ptr<Simulation>> Create(
      const WorldOptions& world, const DriveOptions& drive,
      const std::optional<Trajectory>& recorded, const std::vector<Change>& changes);
  ~Simulation();

  size_t frame_count() const;
  const StereoRig& rig() const;
  /// Poses of the left camera with their times.
  const Trajectory& enu_from_camera() const;
  const World& world() const;
  const Route& route() const;
  const Light& light() const;
  const std::array<SimulatedCamera, 2>& cameras() const;
  const GpsModel& gps_model() const;
  const std::vector<SimulatedFix>& fixes() const;

  SimulatedFrame Render(size_t frame_idx);

 private:
  struct Impl;
  explicit Simulation(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// Changes drawn for the world that these options make.
absl::StatusOr<std::vector<Change>> DrawChangesOf(const WorldOptions& world,
                                                  const std::optional<Trajectory>& recorded,
                                                  uint64_t seed);

}  // namespace carmap
