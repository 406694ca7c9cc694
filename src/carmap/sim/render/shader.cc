#include "carmap/sim/render/shader.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "carmap/base/random.h"

namespace carmap {
namespace {

using Eigen::Vector2f;
using Eigen::Vector3f;

constexpr int kLanes = 8;
constexpr float kFar = std::numeric_limits<float>::infinity();
/// Duller things show the sky alone.
constexpr float kLeastMirror = 0.09f;
constexpr float kGroundAlbedo = 0.15f;  ///< where it is not looked up
constexpr float kHazeM = 4000;          ///< in which contrast falls to 1/e

/// Rays collected into packets of eight, which Embree traces together. `Packet` is RTCRay8, which
/// only tells whether something is in the way, or RTCRayHit8. `done(index, lane, packet)` is called
/// for each ray.
template <typename Packet, typename Done>
class Caster {
 public:
  Caster(RTCScene scene, Done done) : scene_(scene), done_(done) {
    rtcInitIntersectContext(&context_);
    context_.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  }
  ~Caster() {
    if (filled_ > 0) Cast();
  }
  Caster(const Caster&) = delete;
  Caster& operator=(const Caster&) = delete;

  void Add(int index, const Vector3f& from, const Vector3f& way, float near = 0) {
    RTCRay8& rays = Rays(packet_);
    rays.org_x[filled_] = from.x();
    rays.org_y[filled_] = from.y();
    rays.org_z[filled_] = from.z();
    rays.dir_x[filled_] = way.x();
    rays.dir_y[filled_] = way.y();
    rays.dir_z[filled_] = way.z();
    rays.tnear[filled_] = near;
    rays.tfar[filled_] = kFar;
    rays.time[filled_] = 0;
    rays.mask[filled_] = ~0u;
    rays.id[filled_] = rays.flags[filled_] = 0;
    indices_[filled_++] = index;
    if (filled_ == kLanes) Cast();
  }

 private:
  static RTCRay8& Rays(RTCRay8& packet) { return packet; }
  static RTCRay8& Rays(RTCRayHit8& packet) { return packet.ray; }
  void Trace(RTCRay8& packet) { rtcOccluded8(valid_, scene_, &context_, &packet); }
  void Trace(RTCRayHit8& packet) {
    std::fill_n(packet.hit.geomID, kLanes, RTC_INVALID_GEOMETRY_ID);
    std::fill_n(packet.hit.instID[0], kLanes, RTC_INVALID_GEOMETRY_ID);
    rtcIntersect8(valid_, scene_, &context_, &packet);
  }
  void Cast() {
    for (int k = 0; k < kLanes; ++k) valid_[k] = k < filled_ ? -1 : 0;
    Trace(packet_);
    for (int k = 0; k < filled_; ++k) done_(indices_[k], k, packet_);
    filled_ = 0;
  }

  RTCScene scene_;
  Done done_;
  RTCIntersectContext context_;
  alignas(32) int valid_[kLanes];
  Packet packet_{};  ///< unused lanes too: where packets of eight are split, Embree looks at them
  int indices_[kLanes];
  int filled_ = 0;
};

template <typename Packet, typename Done>
Caster<Packet, Done> MakeCaster(const RayScene& scene, Done done) {
  return {scene.scene(), done};
}

Vector3f EndOf(const RTCRay8& rays, int lane) {
  const Vector3f from(rays.org_x[lane], rays.org_y[lane], rays.org_z[lane]);
  const Vector3f way(rays.dir_x[lane], rays.dir_y[lane], rays.dir_z[lane]);
  return from + rays.tfar[lane] * way;
}

RayHit HitOf(const RayScene& scene, const RTCRayHit8& packet, int lane) {
  return scene.HitAt(packet.hit.instID[0][lane], packet.hit.primID[lane],
                     {packet.hit.u[lane], packet.hit.v[lane]}, EndOf(packet.ray, lane));
}

/// From where a ray leaves a surface, so that it does not meet it again at once.
Vector3f Start(const Sample& sample, float side) {
  const float lift = std::copysign(0.003f + 2e-4f * sample.depth_m, side);
  return sample.position + lift * sample.normal;
}

}  // namespace

View::View(const PinholeCamera& the_camera, const RectificationResidual& the_residual,
           const Rigid3& enu_from_camera, const Eigen::Vector3d& origin_in_enu)
    : camera(the_camera),
      residual(the_residual),
      eye((enu_from_camera.translation - origin_in_enu).cast<float>()),
      from_camera(enu_from_camera.rotation.toRotationMatrix().cast<float>()),
      right(from_camera.col(0) / static_cast<float>(camera.fx)),
      down(from_camera.col(1) / static_cast<float>(camera.fy)),
      pixel_rad(static_cast<float>(1 / camera.fx)) {}

Vector3f View::Ray(float u, float v) const {
  const float x = (u - static_cast<float>(camera.cx)) / static_cast<float>(camera.fx);
  const float y = (v - static_cast<float>(camera.cy)) / static_cast<float>(camera.fy);
  const auto at = [&](const std::array<float, 6>& c) {
    return c[0] + c[1] * x + c[2] * y + c[3] * x * x + c[4] * x * y + c[5] * y * y;
  };
  return from_camera * Vector3f(x + at(residual.column), y + at(residual.row), 1);
}

bool Continuous(const Sample& a, const Sample& b) {
  if (a.group != b.group) return false;
  if (a.is_sky()) return true;
  const float distance = std::abs(a.normal.dot(b.position - a.position));
  return a.normal.dot(b.normal) > 0.9f && distance < 0.005f + 0.001f * a.depth_m;
}

Shader::Shader(const RayScene& scene, const GroundMap* ground, const Sky& sky, const Light& light,
               const Textures& textures, const View& view)
    : scene_(scene),
      ground_(ground),
      sky_(sky),
      light_(light),
      view_(view),
      textures_(textures),
      to_sun_(light.to_sun_in_enu.cast<float>()) {
  // Evenly over the upper half, on a spiral by the golden angle.
  for (int i = 0; i < kSkyDirections; ++i) {
    const float z = (static_cast<float>(i) + 0.5f) / kSkyDirections, r = std::sqrt(1 - z * z);
    const float azimuth = 2.39996f * static_cast<float>(i);
    sky_directions_[i] = {r * std::cos(azimuth), r * std::sin(azimuth), z};
  }
}

void Shader::Illuminate(Batch& batch) const {
  CastToSun(batch);
  CastMirrored(batch);
  textures_.LookUp(batch.spots, batch.count, batch.brightness);
  for (int i = 0; i < batch.count; ++i) Illuminate(batch, i);
}

void Shader::Meet(Batch& batch) const {
  auto caster = MakeCaster<RTCRayHit8>(scene_, [&](int i, int lane, const RTCRayHit8& packet) {
    if (packet.hit.geomID[lane] == RTC_INVALID_GEOMETRY_ID) return;
    batch.sample[i].depth_m = packet.ray.tfar[lane];
    batch.sample[i].position = EndOf(packet.ray, lane);
    Meet(batch, i, HitOf(scene_, packet, lane));
  });
  for (int i = 0; i < batch.count; ++i) {
    batch.sample[i] = Sample{};
    batch.ray[i] = view_.Ray(batch.u[i], batch.v[i]);
    caster.Add(i, view_.eye, batch.ray[i], 0.05f);
  }
}

void Shader::Meet(Batch& batch, int i, const RayHit& hit) const {
  batch.hit[i] = hit;
  Sample& sample = batch.sample[i];
  sample.group = hit.group;
  // Of the side that is seen; where a rounded shape would turn away, that of the face.
  const float side = hit.face_normal.dot(batch.ray[i]) > 0 ? -1.f : 1.f;
  const bool turned_away = side * hit.normal.dot(batch.ray[i]) > 0;
  sample.normal = side * (turned_away ? hit.face_normal : hit.normal);
  const Surface& surface = *hit.surface;
  sample.rough = surface.pattern == Pattern::kLeaves;
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
  const Sample& sample = batch.sample[i];
  const Vector3f& ray = batch.ray[i];
  const float facing = std::min(sample.normal.dot(ray), -1e-4f);
  const auto step = [&](const Vector3f& change) {
    const Vector3f moved = sample.depth_m * (change - ray * (sample.normal.dot(change) / facing));
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
  const Sample& sample = batch.sample[i];
  batch.spots.u_m[i] = sample.position.x();
  batch.spots.v_m[i] = sample.position.y();
  LayFootprint(batch, i, Vector3f::UnitX(), Vector3f::UnitY());
  const Vector2f origin = scene_.origin_in_enu().head<2>().cast<float>();
  batch.cover[i] = ground_->CoverAt(sample.position.head<2>() + origin,
                                    {batch.spots.major_u_m[i], batch.spots.major_v_m[i]});
  batch.spots.pattern[i] = batch.cover[i].pattern;
  batch.spots.seed[i] = 0;
}

void Shader::CastToSun(Batch& batch) const {
  auto caster = MakeCaster<RTCRay8>(scene_, [&](int i, int lane, const RTCRay8& packet) {
    batch.sample[i].sunny = packet.tfar[lane] >= 0 ? 1 : 0;
  });
  for (int i = 0; i < batch.count; ++i) {
    Sample& sample = batch.sample[i];
    const float facing = sample.normal.dot(to_sun_);
    if (light_.sun <= 0 || (facing <= 0 && !sample.rough)) {
      sample.sunny = 0;
    } else if (sample.sunny == Sample::kUnknown) {
      caster.Add(i, Start(sample, facing), to_sun_);
    }
  }
}

void Shader::CastMirrored(Batch& batch) const {
  auto caster = MakeCaster<RTCRayHit8>(scene_, [&](int i, int lane, const RTCRayHit8& packet) {
    const RTCRay8& rays = packet.ray;
    batch.sample[i].mirrored =
        packet.hit.geomID[lane] == RTC_INVALID_GEOMETRY_ID
            ? sky_.Mirrored({rays.dir_x[lane], rays.dir_y[lane], rays.dir_z[lane]})
            : MirroredLight(HitOf(scene_, packet, lane));
  });
  for (int i = 0; i < batch.count; ++i) {
    Sample& sample = batch.sample[i];
    const float gloss = sample.is_sky() ? 0 : batch.hit[i].surface->gloss;
    if (gloss <= 0 || sample.mirrored != Sample::kUnknown) continue;
    const Vector3f view = batch.ray[i].normalized();
    const Vector3f way = view - 2 * sample.normal.dot(view) * sample.normal;
    if (sample.rough || gloss < kLeastMirror) {
      sample.mirrored = sky_.ground() + sample.sunny * (sky_.Mirrored(way) - sky_.ground());
    } else {
      caster.Add(i, Start(sample, 1), way);
    }
  }
}

/// Of a thing seen in a mirror: without texture and shadows.
float Shader::MirroredLight(const RayHit& hit) const {
  const bool ground = hit.surface->pattern == Pattern::kGround;
  const float albedo = ground ? kGroundAlbedo : hit.surface->albedo * hit.placement->shade;
  const float facing = std::max(0.f, hit.normal.dot(to_sun_));
  return albedo * static_cast<float>(0.7 * light_.sun * facing + 0.6 * light_.sky);
}

void Shader::LookToSky(const std::vector<std::pair<int, int>>& samples, Batch& batch) const {
  auto caster = MakeCaster<RTCRay8>(scene_, [&](int i, int lane, const RTCRay8& packet) {
    batch.sample[i].open = packet.tfar[lane] >= 0 ? batch.sample[i].weight : 0;
  });
  for (const auto& [i, direction] : samples) {
    Sample& sample = batch.sample[i];
    if (sample.rough && light_.sun > 0) {  // Where the sun gets through to a leaf, the sky does.
      sample.weight = 1;
      sample.open = 0.3f + 0.4f * sample.sunny;
      continue;
    }
    const float facing = sample.normal.dot(sky_directions_[direction]);
    sample.weight = sample.rough ? std::abs(facing) : std::max(facing, 0.f);
    if (sample.weight > 0) caster.Add(i, Start(sample, facing), sky_directions_[direction]);
  }
}

void Shader::Illuminate(Batch& batch, int i) const {
  Sample& sample = batch.sample[i];
  if (sample.is_sky()) {
    sample.fixed = sky_.Radiance(batch.ray[i].normalized(), view_.pixel_rad);
    return;
  }
  const Surface& surface = *batch.hit[i].surface;
  const GroundCover& cover = batch.cover[i];
  const float up = sample.normal.z(), facing = sample.normal.dot(to_sun_);
  const auto sun = static_cast<float>(light_.sun), sky = static_cast<float>(light_.sky);
  // Leaves let through some of the light that falls on their backs.
  const float direct = sample.sunny * sun * (facing > 0 ? facing : -0.5f * facing);
  const float bounced = sky_.ground() * (0.6f - 0.4f * up) + 0.08f * (sun + sky);
  float fixed = direct + 0.5f * bounced;
  float ambient = sky * (0.5f + 0.5f * up) + 0.5f * bounced;

  const float texture = std::max(0.03f, 1 + cover.contrast * (batch.brightness[i] - 1));
  float reflectance = cover.albedo * texture;
  float mirrored = 0;
  if (surface.gloss > 0) {
    const Vector3f view = batch.ray[i].normalized();
    const float cosine = std::min(1.f, std::abs(sample.normal.dot(view)));
    const float graze = 1 - cosine, graze2 = graze * graze;
    const float share = surface.gloss + (1 - surface.gloss) * graze2 * graze2 * graze;
    reflectance *= 1 - share;
    mirrored = share * sample.mirrored;
  }
  const float clear = std::exp(-sample.depth_m / kHazeM);
  sample.fixed = clear * (reflectance * fixed + mirrored) + (1 - clear) * sky_.haze();
  sample.ambient = clear * reflectance * ambient;
}

}  // namespace carmap
