#include "carmap/slam/repeated_frames.h"

#include <algorithm>
#include <utility>

#include "carmap/localize/motion_model.h"

namespace carmap {
namespace {

bool HasPose(const Trajectory& trajectory, size_t i) {
  return trajectory[i].world_from_camera.has_value();
}

/// What the vehicle moves in so many seconds at its speed from frame `a` to frame `b`.
Rigid3 MotionIn(double seconds, const Trajectory& trajectory, size_t a, size_t b) {
  const double elapsed_s = trajectory[b].timestamp->seconds() - trajectory[a].timestamp->seconds();
  return Extrapolate(trajectory[a].world_from_camera->Inverse() * *trajectory[b].world_from_camera,
                     seconds / elapsed_s);
}

/// From frame `shown` on; none where no other frame tells the speed.
Rigid3 MotionAfter(size_t shown, double seconds, const Trajectory& trajectory) {
  for (size_t after = shown + 1; after < trajectory.size(); ++after) {
    if (HasPose(trajectory, after)) return MotionIn(seconds, trajectory, shown, after);
  }
  for (size_t before = shown; before-- > 0;) {
    if (HasPose(trajectory, before)) return MotionIn(seconds, trajectory, before, shown);
  }
  return {};
}

}  // namespace

void PlaceRepeatedFrames(const std::vector<size_t>& repeated, Trajectory& trajectory) {
  Trajectory placed = trajectory;
  for (const size_t i : repeated) {
    size_t shown = i;
    while (shown > 0 && std::binary_search(repeated.begin(), repeated.end(), shown)) --shown;
    if (!HasPose(trajectory, shown)) continue;
    const double seconds =
        trajectory[i].timestamp->seconds() - trajectory[shown].timestamp->seconds();
    placed[i].world_from_camera =
        *trajectory[shown].world_from_camera * MotionAfter(shown, seconds, trajectory);
  }
  trajectory = std::move(placed);
}

}  // namespace carmap
