#include "carmap/sim/renderer.h"

#include <tbb/blocked_range2d.h>
#include <tbb/parallel_for.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <opencv2/core.hpp>

#include "carmap/sim/ground_map.h"
#include "carmap/sim/random.h"
#include "carmap/sim/ray_scene.h"
#include "carmap/sim/sky.h"
#include "carmap/sim/texture.h"

namespace carmap {
namespace {

using Eigen::Vector2f;
using Eigen::Vector3f;

constexpr int kPacket = 8;
constexpr int kTileWidth = 32, kTileHeight = 16;
constexpr int kBatch = TextureSpots::kCapacity;
constexpr float kFar = std::numeric_limits<float>::infinity();
constexpr uint32_t kSkyGroup = ~0u;
constexpr int kSkyDirections = 16;
constexpr float kHazeM = 4000;  ///< in which contrast falls to 1/e
/// Where in the pixel the further samples of an edge lie: a rotated grid.
constexpr std::array<std::array<float, 2>, 4> kSubPixels = {
    {{-0.125f, -0.375f}, {0.375f, -0.125f}, {0.125f, 0.375f}, {-0.375f, 0.125f}}};

/// Directions to the upper half, one from each of 16 equal parts of it. Neighbouring pixels of a
/// block of 4 × 4 use another each (interleaved sampling, Keller and Heidrich 2001).
std::array<Vector3f, kSkyDirections> SkyDirections() {
  std::array<Vector3f, kSkyDirections> directions;
  for (int i = 0; i < kSkyDirections; ++i) {
    const int ring = i / 4, sector = i % 4;
    const float z = (static_cast<float>(ring) + 0.6f) / 4;
    const float azimuth = static_cast<float>(M_PI / 2) *
                          (static_cast<float>(sector) + 0.13f + 0.25f * static_cast<float>(ring));
    const float r = std::sqrt(1 - z * z);
    directions[i] = {r * std::cos(azimuth), r * std::sin(azimuth), z};
  }
  return directions;
}
constexpr std::array<uint8_t, 16> kDirectionInBlock = {0, 10, 5, 15, 9,  3, 12, 6,
                                                       7, 13, 2, 8,  14, 4, 11, 1};

struct View {
  PinholeCamera camera;
  Vector3f eye;                 ///< relative to the scene's origin, as all below
  Eigen::Matrix3f from_camera;  ///< rotation
  Vector3f right, down;         ///< how the ray changes from pixel to pixel
  float pixel_rad = 0;

  /// Not of unit length: the multiple that reaches a point is its depth.
  Vector3f Ray(float u, float v) const {
    return from_camera *
           Vector3f((u - static_cast<float>(camera.cx)) / static_cast<float>(camera.fx),
                    (v - static_cast<float>(camera.cy)) / static_cast<float>(camera.fy), 1);
  }
};

/// What a pixel's centre shows, kept until its neighbours are known.
struct Pixel {
  float depth_m = 0;
  uint32_t group = kSkyGroup;
  Vector3f normal = Vector3f::Zero(), position = Vector3f::Zero();
  float fixed = 0, ambient = 0;  ///< light: without and with the share of the sky that is open
  float open = 0, weight = 0;    ///< of the sky, as one direction tells, and what that counts
  float openness = 0.5f;         ///< ... as the neighbours tell too
  bool sunny = false, rough = false;
};

/// Samples that go through the stages of shading together.
struct Batch {
  int count = 0;
  float u[kBatch], v[kBatch];  ///< place in the image
  Vector3f ray[kBatch];
  Pixel pixel[kBatch];
  RayHit hit[kBatch];
  GroundCover cover[kBatch];
  TextureSpots spots;
  float brightness[kBatch];
  float mirrored[kBatch];  ///< what glossy surfaces show of their surroundings
};

/// Of two pixels: whether both lie on one smooth piece of a surface.
bool Continuous(const Pixel& a, const Pixel& b) {
  if (a.group != b.group) return false;
  if (a.group == kSkyGroup) return true;
  const float distance = std::abs(a.normal.dot(b.position - a.position));
  return a.normal.dot(b.normal) > 0.9f && distance < 0.005f + 0.001f * a.depth_m;
}

/// Of two pixels: whether about the same share of the sky is open to both.
bool Neighbourly(const Pixel& a, const Pixel& b) {
  if (a.group != b.group || a.group == kSkyGroup) return false;
  if (a.rough) return std::abs(a.depth_m - b.depth_m) < 0.3f;
  return a.normal.dot(b.normal) > 0.8f &&
         std::abs(a.normal.dot(b.position - a.position)) < 0.03f + 0.002f * a.depth_m;
}

/// All that Render needs to shade; does not change while it runs.
class Shader {
 public:
  Shader(const RayScene& scene, const GroundMap* ground, const Sky& sky, const Light& light,
         const View& view)
      : scene_(scene),
        ground_(ground),
        sky_(sky),
        light_(light),
        view_(view),
        to_sun_(light.to_sun_in_enu.cast<float>()),
        textures_(Textures::Get()) {}

  /// Fills in all of `pixel` but how open the sky is.
  void Shade(Batch& batch) const {
    CastPrimary(batch);
    CastToSun(batch);
    CastMirrored(batch);
    textures_.LookUp(batch.spots, batch.count, batch.brightness);
    for (int i = 0; i < batch.count; ++i) Illuminate(batch, i);
  }

  /// One ray to the sky from each of `samples`, in the direction that it names. Those of the same
  /// direction follow one another.
  struct SkySample {
    uint16_t sample_idx;
    uint8_t direction;
  };
  void CastToSky(const std::vector<SkySample>& samples, Batch& batch) const;

 private:
  void CastPrimary(Batch& batch) const;
  void CastToSun(Batch& batch) const;
  void CastMirrored(Batch& batch) const;
  float MirroredLight(uint32_t instance, uint32_t triangle, const Vector3f& position) const;
  void Meet(Batch& batch, int i, uint32_t instance, uint32_t triangle) const;
  void LayFootprint(Batch& batch, int i, const Vector3f& gradient_u,
                    const Vector3f& gradient_v) const;
  void CoverGround(Batch& batch, int i) const;
  void Illuminate(Batch& batch, int i) const;

  const RayScene& scene_;
  const GroundMap* ground_;
  const Sky& sky_;
  const Light& light_;
  const View& view_;
  const Vector3f to_sun_;
  const Textures& textures_;
  const std::array<Vector3f, kSkyDirections> sky_directions_ = SkyDirections();
};

RTCIntersectContext CoherentContext() {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  return context;
}

void Shader::CastPrimary(Batch& batch) const {
  RTCIntersectContext context = CoherentContext();
  alignas(32) std::array<int, kPacket> valid;
  RTCRayHit8 rays;
  for (int first = 0; first < batch.count; first += kPacket) {
    for (int k = 0; k < kPacket; ++k) {
      const int i = std::min(first + k, batch.count - 1);
      valid[k] = first + k < batch.count ? -1 : 0;
      const Vector3f& ray = batch.ray[i] = view_.Ray(batch.u[i], batch.v[i]);
      rays.ray.org_x[k] = view_.eye.x();
      rays.ray.org_y[k] = view_.eye.y();
      rays.ray.org_z[k] = view_.eye.z();
      rays.ray.dir_x[k] = ray.x();
      rays.ray.dir_y[k] = ray.y();
      rays.ray.dir_z[k] = ray.z();
      rays.ray.tnear[k] = 0.05f;
      rays.ray.tfar[k] = kFar;
      rays.ray.time[k] = 0;
      rays.ray.mask[k] = ~0u;
      rays.ray.id[k] = rays.ray.flags[k] = 0;
      rays.hit.geomID[k] = rays.hit.instID[0][k] = RTC_INVALID_GEOMETRY_ID;
    }
    rtcIntersect8(valid.data(), scene_.scene(), &context, &rays);
    for (int k = 0; k < kPacket && first + k < batch.count; ++k) {
      Pixel& pixel = batch.pixel[first + k] = Pixel{};
      if (rays.hit.geomID[k] == RTC_INVALID_GEOMETRY_ID) {
        batch.hit[first + k].surface = nullptr;
        continue;
      }
      pixel.depth_m = rays.ray.tfar[k];
      Meet(batch, first + k, rays.hit.instID[0][k], rays.hit.primID[k]);
    }
  }
}

void Shader::Meet(Batch& batch, int i, uint32_t instance, uint32_t triangle) const {
  Pixel& pixel = batch.pixel[i];
  pixel.position = view_.eye + pixel.depth_m * batch.ray[i];
  RayHit& hit = batch.hit[i];
  hit = scene_.HitAt(instance, triangle, pixel.position);
  pixel.group = hit.group;
  pixel.normal = hit.normal.dot(batch.ray[i]) > 0 ? Vector3f(-hit.normal) : hit.normal;
  const Surface& surface = *hit.surface;
  pixel.rough = surface.pattern == Pattern::kLeaves;
  if (surface.pattern == Pattern::kGround) {
    CoverGround(batch, i);
    return;
  }
  batch.spots.u_m[i] = hit.uv_m.x();
  batch.spots.v_m[i] = hit.uv_m.y();
  batch.spots.pattern[i] = surface.pattern;
  batch.spots.seed[i] = static_cast<uint32_t>(
      HashKeys(hit.placement->texture_seed, static_cast<uint64_t>(hit.group & 0xfff)) | 1);
  LayFootprint(batch, i, hit.gradient_u, hit.gradient_v);
  batch.cover[i] = {surface.pattern, surface.albedo * hit.placement->shade, surface.contrast,
                    surface.label};
}

/// The pixel's parallelogram on the surface, as longer axis and width.
void Shader::LayFootprint(Batch& batch, int i, const Vector3f& gradient_u,
                          const Vector3f& gradient_v) const {
  const Pixel& pixel = batch.pixel[i];
  const Vector3f& ray = batch.ray[i];
  const float facing = std::min(pixel.normal.dot(ray), -1e-4f);
  const auto step = [&](const Vector3f& change) {
    const Vector3f moved = pixel.depth_m * (change - ray * (pixel.normal.dot(change) / facing));
    return Vector2f(gradient_u.dot(moved), gradient_v.dot(moved));
  };
  Vector2f major = step(view_.right), other = step(view_.down);
  if (other.squaredNorm() > major.squaredNorm()) std::swap(major, other);
  const float length = std::max(major.norm(), 1e-9f);
  const float area = std::abs(major.x() * other.y() - major.y() * other.x());
  batch.spots.major_u_m[i] = major.x();
  batch.spots.major_v_m[i] = major.y();
  batch.spots.minor_m[i] = area / length;
}

void Shader::CoverGround(Batch& batch, int i) const {
  const Pixel& pixel = batch.pixel[i];
  batch.spots.u_m[i] = pixel.position.x();
  batch.spots.v_m[i] = pixel.position.y();
  LayFootprint(batch, i, Vector3f::UnitX(), Vector3f::UnitY());
  const Vector2f origin = scene_.origin_in_enu().head<2>().cast<float>();
  batch.cover[i] = ground_->CoverAt(pixel.position.head<2>() + origin,
                                    {batch.spots.major_u_m[i], batch.spots.major_v_m[i]});
  batch.spots.pattern[i] = batch.cover[i].pattern;
  batch.spots.seed[i] = 0;
}

void Shader::CastToSun(Batch& batch) const {
  if (light_.sun <= 0) return;
  RTCIntersectContext context = CoherentContext();
  alignas(32) std::array<int, kPacket> valid;
  std::array<int, kPacket> samples;
  RTCRay8 rays;
  int filled = 0;
  const auto cast = [&] {
    for (int k = 0; k < kPacket; ++k) valid[k] = k < filled ? -1 : 0;
    rtcOccluded8(valid.data(), scene_.scene(), &context, &rays);
    for (int k = 0; k < filled; ++k) batch.pixel[samples[k]].sunny = rays.tfar[k] >= 0;
    filled = 0;
  };
  for (int i = 0; i < batch.count; ++i) {
    const Pixel& pixel = batch.pixel[i];
    if (pixel.group == kSkyGroup) continue;
    const float facing = pixel.normal.dot(to_sun_);
    if (facing <= 0 && !pixel.rough) continue;
    const float lift = std::copysign(0.002f + 2e-4f * pixel.depth_m, facing);
    const Vector3f from = pixel.position + lift * pixel.normal;
    rays.org_x[filled] = from.x();
    rays.org_y[filled] = from.y();
    rays.org_z[filled] = from.z();
    rays.dir_x[filled] = to_sun_.x();
    rays.dir_y[filled] = to_sun_.y();
    rays.dir_z[filled] = to_sun_.z();
    rays.tnear[filled] = 0;
    rays.tfar[filled] = kFar;
    rays.time[filled] = 0;
    rays.mask[filled] = ~0u;
    rays.id[filled] = rays.flags[filled] = 0;
    samples[filled++] = i;
    if (filled == kPacket) cast();
  }
  if (filled > 0) cast();
}

void Shader::CastMirrored(Batch& batch) const {
  RTCIntersectContext context = CoherentContext();
  alignas(32) std::array<int, kPacket> valid;
  std::array<int, kPacket> indices;
  std::array<Vector3f, kPacket> froms, ways;
  RTCRayHit8 rays;
  int filled = 0;
  const auto cast = [&] {
    for (int k = 0; k < kPacket; ++k) valid[k] = k < filled ? -1 : 0;
    rtcIntersect8(valid.data(), scene_.scene(), &context, &rays);
    for (int k = 0; k < filled; ++k) {
      batch.mirrored[indices[k]] = rays.hit.geomID[k] == RTC_INVALID_GEOMETRY_ID
                                       ? sky_.Mirrored(ways[k])
                                       : MirroredLight(rays.hit.instID[0][k], rays.hit.primID[k],
                                                       froms[k] + rays.ray.tfar[k] * ways[k]);
    }
    filled = 0;
  };
  for (int i = 0; i < batch.count; ++i) {
    const Pixel& pixel = batch.pixel[i];
    if (pixel.group == kSkyGroup || batch.hit[i].surface->gloss <= 0) continue;
    const Vector3f view = batch.ray[i].normalized();
    const Vector3f way = view - 2 * pixel.normal.dot(view) * pixel.normal;
    const Vector3f from = pixel.position + (0.004f + 2e-4f * pixel.depth_m) * pixel.normal;
    rays.ray.org_x[filled] = from.x();
    rays.ray.org_y[filled] = from.y();
    rays.ray.org_z[filled] = from.z();
    rays.ray.dir_x[filled] = way.x();
    rays.ray.dir_y[filled] = way.y();
    rays.ray.dir_z[filled] = way.z();
    rays.ray.tnear[filled] = 0;
    rays.ray.tfar[filled] = kFar;
    rays.ray.time[filled] = 0;
    rays.ray.mask[filled] = ~0u;
    rays.ray.id[filled] = rays.ray.flags[filled] = 0;
    rays.hit.geomID[filled] = rays.hit.instID[0][filled] = RTC_INVALID_GEOMETRY_ID;
    froms[filled] = from;
    ways[filled] = way;
    indices[filled++] = i;
    if (filled == kPacket) cast();
  }
  if (filled > 0) cast();
}

/// Of a thing seen in a mirror: without texture and shadows.
float Shader::MirroredLight(uint32_t instance, uint32_t triangle, const Vector3f& position) const {
  const RayHit hit = scene_.HitAt(instance, triangle, position);
  float albedo = hit.surface->albedo * hit.placement->shade;
  if (hit.surface->pattern == Pattern::kGround) {
    const Vector2f origin = scene_.origin_in_enu().head<2>().cast<float>();
    albedo = ground_->CoverAt(position.head<2>() + origin, {0.3f, 0.3f}).albedo;
  }
  const float facing = std::max(0.f, hit.normal.dot(to_sun_));
  return albedo * static_cast<float>(0.7 * light_.sun * facing + 0.6 * light_.sky);
}

void Shader::CastToSky(const std::vector<SkySample>& samples, Batch& batch) const {
  RTCIntersectContext context = CoherentContext();
  alignas(32) std::array<int, kPacket> valid;
  std::array<int, kPacket> indices;
  RTCRay8 rays;
  int filled = 0;
  const auto cast = [&] {
    for (int k = 0; k < kPacket; ++k) valid[k] = k < filled ? -1 : 0;
    rtcOccluded8(valid.data(), scene_.scene(), &context, &rays);
    for (int k = 0; k < filled; ++k) {
      Pixel& pixel = batch.pixel[indices[k]];
      pixel.open = rays.tfar[k] >= 0 ? pixel.weight : 0;
    }
    filled = 0;
  };
  for (const auto& [i, direction] : samples) {
    Pixel& pixel = batch.pixel[i];
    const Vector3f& to_sky = sky_directions_[direction];
    const float facing = pixel.normal.dot(to_sky);
    pixel.weight = pixel.rough ? std::abs(facing) : std::max(facing, 0.f);
    if (pixel.weight <= 0) continue;
    const float lift = std::copysign(0.004f + 2e-4f * pixel.depth_m, facing);
    const Vector3f from = pixel.position + lift * pixel.normal;
    rays.org_x[filled] = from.x();
    rays.org_y[filled] = from.y();
    rays.org_z[filled] = from.z();
    rays.dir_x[filled] = to_sky.x();
    rays.dir_y[filled] = to_sky.y();
    rays.dir_z[filled] = to_sky.z();
    rays.tnear[filled] = 0;
    rays.tfar[filled] = kFar;
    rays.time[filled] = 0;
    rays.mask[filled] = ~0u;
    rays.id[filled] = rays.flags[filled] = 0;
    indices[filled++] = i;
    if (filled == kPacket) cast();
  }
  if (filled > 0) cast();
}

void Shader::Illuminate(Batch& batch, int i) const {
  Pixel& pixel = batch.pixel[i];
  if (pixel.group == kSkyGroup) {
    pixel.fixed = sky_.Radiance(batch.ray[i].normalized(), view_.pixel_rad);
    return;
  }
  const Surface& surface = *batch.hit[i].surface;
  const GroundCover& cover = batch.cover[i];
  const float up = pixel.normal.z(), facing = pixel.normal.dot(to_sun_);
  const auto sun = static_cast<float>(light_.sun), sky = static_cast<float>(light_.sky);
  float direct = 0;
  if (pixel.sunny) {
    // Leaves let through some of the light that falls on their backs.
    direct = sun * (facing > 0 ? facing : -0.5f * facing);
  }
  const float bounced = sky_.ground() * (0.6f - 0.4f * up) + 0.08f * (sun + sky);
  float fixed = direct + 0.5f * bounced;
  float ambient = sky * (0.5f + 0.5f * up) + 0.5f * bounced;

  const float texture = std::max(0.03f, 1 + cover.contrast * (batch.brightness[i] - 1));
  float reflectance = cover.albedo * texture;
  float mirrored = 0;
  if (surface.gloss > 0) {
    const Vector3f view = batch.ray[i].normalized();
    const float cosine = std::min(1.f, std::abs(pixel.normal.dot(view)));
    const float graze = 1 - cosine, graze2 = graze * graze;
    const float share = surface.gloss + (1 - surface.gloss) * graze2 * graze2 * graze;
    reflectance *= 1 - share;
    mirrored = share * batch.mirrored[i];
  }
  const float clear = std::exp(-pixel.depth_m / kHazeM);
  pixel.fixed = clear * (reflectance * fixed + mirrored) + (1 - clear) * sky_.haze();
  pixel.ambient = clear * reflectance * ambient;
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
  std::vector<Pixel> pixels;  ///< of the view that is being rendered
};

namespace {

View MakeView(const PinholeCamera& camera, const Rigid3& enu_from_camera,
              const Eigen::Vector3d& origin) {
  View view{.camera = camera};
  view.eye = (enu_from_camera.translation - origin).cast<float>();
  view.from_camera = enu_from_camera.rotation.toRotationMatrix().cast<float>();
  view.right = view.from_camera.col(0) / static_cast<float>(camera.fx);
  view.down = view.from_camera.col(1) / static_cast<float>(camera.fy);
  view.pixel_rad = static_cast<float>(1 / camera.fx);
  return view;
}

/// Image velocity of a point at (x, y, 1) of inverse depth `inverse_z`, in pixels per second.
Vector2f ImageVelocity(const View& view, float u, float v, float inverse_z,
                       const ViewMotion& motion) {
  const Eigen::Vector3d p((u - view.camera.cx) / view.camera.fx,
                          (v - view.camera.cy) / view.camera.fy, 1);
  const Eigen::Vector3d velocity =
      -motion.velocity_in_camera * double{inverse_z} - motion.angular_velocity_in_camera.cross(p);
  return Vector2f(static_cast<float>(view.camera.fx * (velocity.x() - p.x() * velocity.z())),
                  static_cast<float>(view.camera.fy * (velocity.y() - p.y() * velocity.z())));
}

/// One image being made.
class Painting {
 public:
  Painting(const Shader& shader, const View& view, const ViewMotion& motion, uint64_t seed,
           std::vector<Pixel>& pixels)
      : shader_(shader),
        view_(view),
        motion_(motion),
        seed_(seed),
        width_(view.camera.width),
        height_(view.camera.height),
        pixels_(pixels) {
    pixels_.resize(size_t(width_) * height_);
    const cv::Size size(width_, height_);
    result_.radiance.create(size, CV_32F);
    result_.depth_m.create(size, CV_32F);
    result_.labels.create(size, CV_8U);
    result_.instances.create(size, CV_16U);
    result_.mobilities.create(size, CV_8U);
    result_.motion_px.create(size, CV_32FC2);
  }

  RenderedView Paint() {
    ForTiles([&](const cv::Rect& tile, Batch& batch) { PaintCentres(tile, batch); });
    ForTiles([&](const cv::Rect& tile, Batch&) { OpenSky(tile); });
    ForTiles([&](const cv::Rect& tile, Batch& batch) { RefineEdges(tile, batch); });
    return std::move(result_);
  }

 private:
  template <typename Work>
  void ForTiles(Work work) const {
    const int columns = (width_ + kTileWidth - 1) / kTileWidth;
    const int rows = (height_ + kTileHeight - 1) / kTileHeight;
    tbb::parallel_for(0, columns * rows, [&](int i) {
      static thread_local std::vector<Batch> batch(1);
      const cv::Rect tile(i % columns * kTileWidth, i / columns * kTileHeight, kTileWidth,
                          kTileHeight);
      work(tile & cv::Rect(0, 0, width_, height_), batch[0]);
    });
  }

  Pixel& At(int x, int y) { return pixels_[size_t(y) * width_ + x]; }
  void PaintCentres(const cv::Rect& tile, Batch& batch);
  void StoreTruth(const Batch& batch, int i);
  void OpenSky(const cv::Rect& tile);
  bool OnEdge(int x, int y);
  void RefineEdges(const cv::Rect& tile, Batch& batch);
  void Refine(const std::vector<cv::Point>& edges, Batch& batch);
  float OpenShare(const Pixel& sample, const cv::Point& at);

  const Shader& shader_;
  const View& view_;
  const ViewMotion& motion_;
  const uint64_t seed_;
  const int width_, height_;
  std::vector<Pixel>& pixels_;
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
  shader_.Shade(batch);
  std::array<std::vector<Shader::SkySample>, kSkyDirections> by_direction;
  for (int i = 0; i < batch.count; ++i) {
    const int x = static_cast<int>(batch.u[i]), y = static_cast<int>(batch.v[i]);
    const uint8_t direction = kDirectionInBlock[(y % 4) * 4 + x % 4];
    if (batch.pixel[i].group == kSkyGroup) continue;
    by_direction[direction].push_back({static_cast<uint16_t>(i), direction});
  }
  std::vector<Shader::SkySample> samples;
  for (const auto& of_one : by_direction) {
    samples.insert(samples.end(), of_one.begin(), of_one.end());
  }
  shader_.CastToSky(samples, batch);
  for (int i = 0; i < batch.count; ++i) StoreTruth(batch, i);
}

void Painting::StoreTruth(const Batch& batch, int i) {
  const int x = static_cast<int>(batch.u[i]), y = static_cast<int>(batch.v[i]);
  const Pixel& pixel = batch.pixel[i];
  const bool sky = pixel.group == kSkyGroup;
  At(x, y) = pixel;
  result_.depth_m.at<float>(y, x) = pixel.depth_m;
  result_.labels.at<uint8_t>(y, x) =
      static_cast<uint8_t>(sky ? SemanticClass::kSky : batch.cover[i].label);
  result_.instances.at<uint16_t>(y, x) = sky ? 0 : batch.hit[i].placement->instance;
  result_.mobilities.at<uint8_t>(y, x) =
      static_cast<uint8_t>(sky ? Mobility::kStatic : batch.hit[i].placement->mobility);
  const Vector2f velocity =
      ImageVelocity(view_, batch.u[i], batch.v[i], sky ? 0 : 1 / pixel.depth_m, motion_);
  result_.motion_px.at<cv::Vec2f>(y, x) = {velocity.x(), velocity.y()};
}

/// Adds up what the directions of a block of pixels tell about the sky: each counts once, the outer
/// ones of the five by five by halves.
void Painting::OpenSky(const cv::Rect& tile) {
  for (int y = tile.y; y < tile.br().y; ++y) {
    for (int x = tile.x; x < tile.br().x; ++x) {
      Pixel& pixel = At(x, y);
      float open = 0, weight = 0;
      if (pixel.group != kSkyGroup) {
        for (int j = std::max(y - 2, 0); j <= std::min(y + 2, height_ - 1); ++j) {
          for (int i = std::max(x - 2, 0); i <= std::min(x + 2, width_ - 1); ++i) {
            const Pixel& other = At(i, j);
            if (!Neighbourly(pixel, other)) continue;
            const float share =
                (std::abs(i - x) == 2 ? 0.5f : 1) * (std::abs(j - y) == 2 ? 0.5f : 1);
            open += share * other.open;
            weight += share * other.weight;
          }
        }
      }
      if (weight > 0) pixel.openness = open / weight;
      result_.radiance.at<float>(y, x) = pixel.fixed + pixel.openness * pixel.ambient;
    }
  }
}

bool Painting::OnEdge(int x, int y) {
  const Pixel& pixel = At(x, y);
  const auto differs = [&](int i, int j) {
    if (i < 0 || j < 0 || i >= width_ || j >= height_) return false;
    const Pixel& other = At(i, j);
    return pixel.sunny != other.sunny || !Continuous(pixel, other);
  };
  return differs(x - 1, y) || differs(x + 1, y) || differs(x, y - 1) || differs(x, y + 1);
}

void Painting::RefineEdges(const cv::Rect& tile, Batch& batch) {
  std::vector<cv::Point> edges;
  constexpr size_t kMost = kBatch / kSubPixels.size();
  for (int y = tile.y; y < tile.br().y; ++y) {
    for (int x = tile.x; x < tile.br().x; ++x) {
      if (!OnEdge(x, y)) continue;
      edges.emplace_back(x, y);
      if (edges.size() == kMost) {
        Refine(edges, batch);
        edges.clear();
      }
    }
  }
  if (!edges.empty()) Refine(edges, batch);
}

float Painting::OpenShare(const Pixel& sample, const cv::Point& at) {
  float sum = 0, count = 0;
  for (int j = std::max(at.y - 1, 0); j <= std::min(at.y + 1, height_ - 1); ++j) {
    for (int i = std::max(at.x - 1, 0); i <= std::min(at.x + 1, width_ - 1); ++i) {
      const Pixel& other = At(i, j);
      if (!Neighbourly(sample, other)) continue;
      sum += other.openness;
      ++count;
    }
  }
  return count > 0 ? sum / count : 0.5f;
}

void Painting::Refine(const std::vector<cv::Point>& edges, Batch& batch) {
  batch.count = 0;
  for (const cv::Point& at : edges) {
    const bool mirror = UnitHash(seed_, uint64_t(at.y) << 32 | uint64_t(at.x)) < 0.5;
    for (const auto& [du, dv] : kSubPixels) {
      batch.u[batch.count] = static_cast<float>(at.x) + (mirror ? -du : du);
      batch.v[batch.count++] = static_cast<float>(at.y) + dv;
    }
  }
  shader_.Shade(batch);
  int i = 0;
  for (const cv::Point& at : edges) {
    float& radiance = result_.radiance.at<float>(at);
    float sum = radiance;
    for (size_t k = 0; k < kSubPixels.size(); ++k, ++i) {
      const Pixel& sample = batch.pixel[i];
      sum += sample.fixed;
      if (sample.ambient > 0) sum += sample.ambient * OpenShare(sample, at);
    }
    radiance = sum / (1 + kSubPixels.size());
  }
}

}  // namespace

Renderer::Renderer(std::shared_ptr<const World> world, const std::vector<Mesh>& vehicle_models,
                   const Light& light, uint64_t seed)
    : impl_(std::make_unique<Impl>(std::move(world), vehicle_models, light, seed)) {}

Renderer::~Renderer() = default;

void Renderer::SetTraffic(const std::vector<Placement>& traffic) {
  impl_->scene.SetTraffic(traffic);
}

RenderedView Renderer::Render(const PinholeCamera& camera, const Rigid3& enu_from_camera,
                              const ViewMotion& motion) const {
  impl_->scene.MoveOrigin(enu_from_camera.translation);
  const View view = MakeView(camera, enu_from_camera, impl_->scene.origin_in_enu());
  const Shader shader(impl_->scene, impl_->world->ground.get(), impl_->sky, impl_->light, view);
  return Painting(shader, view, motion, impl_->seed, impl_->pixels).Paint();
}

}  // namespace carmap
