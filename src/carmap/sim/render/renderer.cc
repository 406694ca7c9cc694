#include "carmap/sim/render/renderer.h"

#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <opencv2/core.hpp>
#include <optional>
#include <utility>

#include "carmap/base/random.h"
#include "carmap/sim/render/openness.h"
#include "carmap/sim/render/ray_scene.h"
#include "carmap/sim/render/shader.h"
#include "carmap/sim/render/sky.h"

namespace carmap {
namespace {

/// Where in the pixel the further samples of an edge lie, or their mirror images. Where there are
/// but leaves, the first must do.
constexpr std::array<std::array<float, 2>, 2> kSubPixels = {{{-0.3f, -0.35f}, {0.35f, 0.3f}}};

/// Image velocity in pixels per second of a point seen at (u, v).
cv::Vec2f ImageVelocity(const PinholeCamera& camera, double u, double v, double inverse_depth,
                        const ViewMotion& motion) {
  const Eigen::Vector3d p((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1);
  const Eigen::Vector3d velocity =
      -motion.velocity_in_camera * inverse_depth - motion.angular_velocity_in_camera.cross(p);
  return {static_cast<float>(camera.fx * (velocity.x() - p.x() * velocity.z())),
          static_cast<float>(camera.fy * (velocity.y() - p.y() * velocity.z()))};
}

/// One image being made.
class Painting {
 public:
  Painting(const Shader& shader, const PinholeCamera& camera, const ViewMotion& motion,
           uint64_t seed, std::vector<Sample>& centres)
      : shader_(shader),
        camera_(camera),
        motion_(motion),
        seed_(seed),
        size_(camera.width, camera.height),
        centres_(centres) {
    centres_.resize(static_cast<size_t>(size_.area()));
    result_.radiance.create(size_, CV_32F);
    result_.depth_m.create(size_, CV_32F);
    result_.labels.create(size_, CV_8U);
    result_.instances.create(size_, CV_16U);
    result_.mobilities.create(size_, CV_8U);
    result_.motion_px.create(size_, CV_32FC2);
  }

  RenderedView Paint() {
    ForTiles([&](const cv::Rect& tile, Batch& batch) { PaintCentres(tile, batch); });
    ForTiles([&](const cv::Rect& tile, Batch&) { OpenSky(tile); });
    ForTiles([&](const cv::Rect& tile, Batch& batch) { RefineEdges(tile, batch); });
    return std::move(result_);
  }

 private:
  /// A pixel that needs so many samples more.
  struct Edge {
    cv::Point at;
    int samples;
  };

  template <typename Work>
  void ForTiles(Work work) const {
    const int columns = (size_.width + kTileWidth - 1) / kTileWidth;
    const int rows = (size_.height + kTileHeight - 1) / kTileHeight;
    tbb::parallel_for(0, columns * rows, [&](int i) {
      static thread_local const auto batch = std::make_unique<Batch>();
      const cv::Rect tile(i % columns * kTileWidth, i / columns * kTileHeight, kTileWidth,
                          kTileHeight);
      work(tile & cv::Rect({}, size_), *batch);
    });
  }

  Sample& At(int x, int y) { return centres_[static_cast<size_t>(y) * size_.width + x]; }
  bool Contains(int x, int y) const {
    return x >= 0 && y >= 0 && x < size_.width && y < size_.height;
  }
  void PaintCentres(const cv::Rect& tile, Batch& batch);
  void LookToSky(Batch& batch) const;
  void StoreTruth(const Batch& batch, int i);
  void OpenSky(const cv::Rect& tile);
  static float Radiance(const Sample& sample) {
    return sample.fixed + sample.openness * sample.ambient;
  }
  static bool Differ(const Sample& a, const Sample& b);
  int FurtherSamples(int x, int y);
  void RefineEdges(const cv::Rect& tile, Batch& batch);
  void Refine(const std::vector<Edge>& edges, Batch& batch);
  void TakeLightOfCentres(const cv::Point& at, Sample& sample);

  const Shader& shader_;
  const PinholeCamera& camera_;
  const ViewMotion& motion_;
  const uint64_t seed_;
  const cv::Size size_;
  std::vector<Sample>& centres_;
  RenderedView result_;
};

void Painting::PaintCentres(const cv::Rect& tile, Batch& batch) {
  batch.count = 0;
  // In blocks of 4 × 2, so that packets are narrow.
  for (int y = tile.y; y < tile.br().y; y += 2) {
    for (int x = tile.x; x < tile.br().x; x += 4) {
      for (int k = 0; k < 8; ++k) {
        const cv::Point at(x + k % 4, y + k / 4);
        if (!tile.contains(at)) continue;
        batch.u[batch.count] = static_cast<float>(at.x);
        batch.v[batch.count++] = static_cast<float>(at.y);
      }
    }
  }
  shader_.Meet(batch);
  shader_.Illuminate(batch);
  LookToSky(batch);
  for (int i = 0; i < batch.count; ++i) StoreTruth(batch, i);
}

void Painting::LookToSky(Batch& batch) const {
  std::array<std::vector<std::pair<int, int>>, Shader::kSkyDirections> by_direction;
  for (int i = 0; i < batch.count; ++i) {
    if (batch.sample[i].is_sky()) continue;
    const std::optional<int> direction =
        SkyDirectionAt(static_cast<int>(batch.u[i]), static_cast<int>(batch.v[i]));
    if (direction) by_direction[*direction].emplace_back(i, *direction);
  }
  std::vector<std::pair<int, int>> samples;
  for (const auto& of_one : by_direction) {
    samples.insert(samples.end(), of_one.begin(), of_one.end());
  }
  shader_.LookToSky(samples, batch);
}

void Painting::StoreTruth(const Batch& batch, int i) {
  const int x = static_cast<int>(batch.u[i]), y = static_cast<int>(batch.v[i]);
  const Sample& sample = At(x, y) = batch.sample[i];
  const Placement* placement = sample.is_sky() ? nullptr : batch.hit[i].placement;
  const SemanticClass label = placement == nullptr ? SemanticClass::kSky : batch.cover[i].label;
  const PlacementMobility mobility =
      placement == nullptr ? PlacementMobility::kStatic : placement->mobility;
  result_.depth_m.at<float>(y, x) = sample.depth_m;
  result_.labels.at<uint8_t>(y, x) = static_cast<uint8_t>(label);
  result_.instances.at<uint16_t>(y, x) = placement == nullptr ? 0 : placement->instance;
  result_.mobilities.at<uint8_t>(y, x) = static_cast<uint8_t>(mobility);
  result_.motion_px.at<cv::Vec2f>(y, x) =
      ImageVelocity(camera_, x, y, sample.is_sky() ? 0 : 1 / sample.depth_m, motion_);
}

void Painting::OpenSky(const cv::Rect& tile) {
  SpreadOpenness(tile, size_, centres_);
  for (int y = tile.y; y < tile.br().y; ++y) {
    for (int x = tile.x; x < tile.br().x; ++x) {
      result_.radiance.at<float>(y, x) = Radiance(At(x, y));
    }
  }
}

/// Whether an edge lies between neighbours that one can see.
bool Painting::Differ(const Sample& a, const Sample& b) {
  constexpr float kLeastContrast = 0.04f;
  const float light_a = Radiance(a), light_b = Radiance(b);
  return std::abs(light_a - light_b) > kLeastContrast * (light_a + light_b) &&
         (a.sunny != b.sunny || !Continuous(a, b));
}

int Painting::FurtherSamples(int x, int y) {
  const Sample& sample = At(x, y);
  bool edge = false, leaves = sample.rough;
  for (const auto& [i, j] : {std::pair(x - 1, y), {x + 1, y}, {x, y - 1}, {x, y + 1}}) {
    if (!Contains(i, j)) continue;
    const Sample& other = At(i, j);
    edge |= Differ(sample, other);
    leaves &= other.rough;
  }
  return !edge ? 0 : leaves ? 1 : 2;
}

void Painting::RefineEdges(const cv::Rect& tile, Batch& batch) {
  std::vector<Edge> edges;
  int samples = 0;
  for (int y = tile.y; y < tile.br().y; ++y) {
    for (int x = tile.x; x < tile.br().x; ++x) {
      const int wanted = FurtherSamples(x, y);
      if (wanted == 0) continue;
      if (samples + wanted > Batch::kCapacity) {
        Refine(edges, batch);
        edges.clear();
        samples = 0;
      }
      edges.push_back({{x, y}, wanted});
      samples += wanted;
    }
  }
  if (!edges.empty()) Refine(edges, batch);
}

/// What the centres round a pixel tell of a sample in it: the mean over those that lie on the same
/// thing. In the sun or not it is only if they agree, but for leaves.
void Painting::TakeLightOfCentres(const cv::Point& at, Sample& sample) {
  float openness = 0, sunny = 0, mirrored = 0, count = 0;
  for (const auto& [x, y] : {std::pair(at.x, at.y),
                             {at.x - 1, at.y},
                             {at.x + 1, at.y},
                             {at.x, at.y - 1},
                             {at.x, at.y + 1}}) {
    if (!Contains(x, y)) continue;
    const Sample& other = At(x, y);
    if (!Neighbourly(sample, other)) continue;
    openness += other.openness;
    sunny += other.sunny;
    mirrored += other.mirrored;
    ++count;
  }
  if (count == 0) return;
  sample.openness = openness / count;
  sample.mirrored = mirrored / count;
  if (sample.rough || sunny == 0 || sunny == count) sample.sunny = sunny / count;
}

void Painting::Refine(const std::vector<Edge>& edges, Batch& batch) {
  batch.count = 0;
  for (const auto& [at, samples] : edges) {
    const bool mirror = UnitHash(seed_, uint64_t(at.y) << 32 | uint64_t(at.x)) < 0.5;
    for (int k = 0; k < samples; ++k) {
      const auto& [du, dv] = kSubPixels[k];
      batch.u[batch.count] = static_cast<float>(at.x) + (mirror ? -du : du);
      batch.v[batch.count++] = static_cast<float>(at.y) + dv;
    }
  }
  shader_.Meet(batch);
  int i = 0;
  for (const auto& [at, samples] : edges) {
    for (int k = 0; k < samples; ++k, ++i) TakeLightOfCentres(at, batch.sample[i]);
  }
  shader_.Illuminate(batch);
  i = 0;
  for (const auto& [at, samples] : edges) {
    float& radiance = result_.radiance.at<float>(at);
    float sum = radiance;
    for (int k = 0; k < samples; ++k, ++i) {
      sum += Radiance(batch.sample[i]);
    }
    radiance = sum / static_cast<float>(1 + samples);
  }
}

}  // namespace

struct Renderer::Impl {
  Impl(std::shared_ptr<const World> the_world, const std::vector<Mesh>& vehicle_models,
       const Light& the_light, uint64_t the_seed)
      : world(std::move(the_world)),
        scene(world, vehicle_models),
        light(the_light),
        sky(the_light),
        seed(the_seed) {}

  const std::shared_ptr<const World> world;
  RayScene scene;
  const Light light;
  const Sky sky;
  const uint64_t seed;
  const Textures& textures = Textures::Get();

  RenderedView Render(const PinholeCamera& camera, const Rigid3& enu_from_camera,
                      const ViewMotion& motion, const RectificationResidual& residual,
                      std::vector<Sample>& samples) const {
    const View view(camera, residual, enu_from_camera, scene.origin_in_enu());
    const Shader shader(scene, world->ground.get(), sky, light, textures, view);
    return Painting(shader, camera, motion, seed, samples).Paint();
  }

  std::array<std::vector<Sample>, 2> centres;  ///< of the views that are being rendered
};

Renderer::Renderer(std::shared_ptr<const World> world, const std::vector<Mesh>& vehicle_models,
                   const Light& light, uint64_t seed)
    : impl_(std::make_unique<Impl>(std::move(world), vehicle_models, light, seed)) {}

Renderer::~Renderer() = default;

void Renderer::SetTraffic(const std::vector<Placement>& traffic) {
  impl_->scene.SetTraffic(traffic);
}

RenderedView Renderer::Render(const PinholeCamera& camera, const Rigid3& enu_from_camera,
                              const ViewMotion& motion,
                              const RectificationResidual& residual) const {
  impl_->scene.MoveOrigin(enu_from_camera.translation);
  return impl_->Render(camera, enu_from_camera, motion, residual, impl_->centres[0]);
}

std::array<RenderedView, 2> Renderer::RenderStereo(
    const StereoRig& rig, const Rigid3& enu_from_left, const ViewMotion& motion,
    const std::array<RectificationResidual, 2>& residuals) const {
  impl_->scene.MoveOrigin(enu_from_left.translation);
  const Rigid3 left_from_right = {Eigen::Quaterniond::Identity(), {rig.baseline_m, 0, 0}};
  const std::array<Rigid3, 2> poses = {enu_from_left, enu_from_left * left_from_right};
  std::array<RenderedView, 2> views;
  // What one does by itself is done beside the other's rays.
  tbb::parallel_for(0, 2, [&](int i) {
    views[i] = impl_->Render(rig.camera, poses[i], motion, residuals[i], impl_->centres[i]);
  });
  return views;
}

}  // namespace carmap
