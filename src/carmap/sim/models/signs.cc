// Signs, signals, lamps and poles.
#include <algorithm>
#include <array>
#include <cmath>

#include "carmap/sim/models/model_kinds.h"

namespace carmap {
namespace {

using Eigen::Vector2f;
using Eigen::Vector3f;
using enum SemanticClass;

const Vector3f kFront = -Vector3f::UnitX();  // the way that signs look
constexpr float kTau = 2 * static_cast<float>(M_PI);

/// Regular, in the plane x = `x` and looking to -x; the first corner at `first_rad` from the
/// viewer's right, counter-clockwise.
Points3 Outline(float x, float z, float radius_m, int corners, float first_rad) {
  Points3 points;
  for (int i = 0; i < corners; ++i) {
    const float angle = first_rad + kTau * static_cast<float>(i) / static_cast<float>(corners);
    points.emplace_back(x, -radius_m * std::cos(angle), z + radius_m * std::sin(angle));
  }
  return points;
}

Points3 Rectangle(float x, float z, float width_m, float height_m) {
  const float y = width_m / 2, h = height_m / 2;
  return {{x, y, z - h}, {x, -y, z - h}, {x, -y, z + h}, {x, y, z + h}};
}

/// What a traffic sign looks like, with its middle `z` above ground.
struct SignShape {
  Points3 (*outline)(float x, float z);
  float border_share, face_albedo, border_albedo;
};

constexpr float kUp = kTau / 4;
const std::array<SignShape, 8> kSignShapes = {{
    {[](float x, float z) { return Outline(x, z, 0.31f, 24, 0); }, 0.2f, 0.75f, 0.17f},  // limit
    {[](float x, float z) { return Outline(x, z - 0.13f, 0.52f, 3, kUp); }, 0.2f, 0.75f, 0.17f},
    {[](float x, float z) { return Outline(x, z + 0.13f, 0.52f, 3, -kUp); }, 0.2f, 0.8f, 0.17f},
    {[](float x, float z) { return Outline(x, z, 0.42f, 4, 0); }, 0.25f, 0.55f, 0.8f},  // priority
    {[](float x, float z) { return Outline(x, z, 0.45f, 8, kTau / 16); }, 0.06f, 0.2f, 0.8f},
    {[](float x, float z) { return Outline(x, z, 0.31f, 24, 0); }, 0.05f, 0.16f, 0.8f},  // way
    {[](float x, float z) { return Outline(x, z, 0.31f, 24, 0); }, 0.22f, 0.13f, 0.2f},  // no stop
    {[](float x, float z) { return Rectangle(x, z, 0.6f, 0.6f); }, 0.06f, 0.18f, 0.8f},  // crossing
}};

void AddSign(MeshBuilder& b, const SignShape& shape, float z) {
  AddPlate(b, shape.outline(-0.045f, z), shape.border_share, b.Use(SignFace(shape.face_albedo)),
           b.Use(Painted(shape.border_albedo, kTrafficSign)), b.Use(Steel(0.45f, kTrafficSign)));
}

void AddSupplement(MeshBuilder& b, float z) {
  AddPlate(b, Rectangle(-0.045f, z, 0.42f, 0.23f), 0.08f, b.Use(SignFace(0.75f)),
           b.Use(Painted(0.1f, kTrafficSign)), b.Use(Steel(0.45f, kTrafficSign)));
}

void AddClamp(MeshBuilder& b, float z) {
  b.Box({-0.044f, -0.05f, z - 0.02f}, {0.035f, 0.05f, z + 0.02f}, b.Use(Steel(0.4f, kPole)));
}

/// A board on two posts that tells the way.
Mesh DirectionSign() {
  MeshBuilder b;
  const SurfaceIdx post = b.Use(Steel(0.4f, kPole));
  for (const float y : {-0.8f, 0.8f}) AddPost(b, 0, y, 3.1f, 0.045f, post);
  AddBoard(b, {-0.075f, 0, 2.4f}, 2.5f, 1.3f, 0.05f, 0.04f, b.Use(SignFace(0.7f)),
           b.Use(Steel(0.4f, kTrafficSign)));
  return std::move(b).Build();
}

/// Arrow-shaped, pointing to the left or right at a crossing.
Mesh ArrowSign() {
  MeshBuilder b;
  AddPost(b, 0, 0, 2.9f, 0.038f, b.Use(Steel(0.42f, kPole)));
  const SurfaceIdx back = b.Use(Steel(0.45f, kTrafficSign));
  const SurfaceIdx border = b.Use(Painted(0.1f, kTrafficSign));
  float z = 2.7f;
  for (const float albedo : {0.6f, 0.75f, 0.75f}) {
    const float side = z > 2.5f ? 1.f : -1.f, x = -0.045f;
    Points3 arrow = {{x, side * 0.45f, z - 0.15f},
                     {x, side * -0.55f, z - 0.15f},
                     {x, side * -0.72f, z},
                     {x, side * -0.55f, z + 0.15f},
                     {x, side * 0.45f, z + 0.15f}};
    if (side < 0) std::reverse(arrow.begin(), arrow.end());
    AddPlate(b, arrow, 0.06f, b.Use(SignFace(albedo)), border, back);
    AddClamp(b, z);
    z -= 0.34f;
  }
  return std::move(b).Build();
}

Mesh TrafficSign(uint32_t variant) {
  constexpr auto kPlain = static_cast<uint32_t>(kSignShapes.size());
  if (variant == kPlain) return DirectionSign();
  if (variant == kPlain + 1) return ArrowSign();
  MeshBuilder b;
  const bool two = variant >= kPlain;  // beyond: pairs and signs with a supplement
  const uint32_t first = two ? (variant * 3) % kPlain : variant;
  const float top = two ? 3.05f : 2.55f + 0.1f * static_cast<float>(variant % 3);
  AddPost(b, 0, 0, top + 0.12f, 0.032f, b.Use(Steel(0.42f, kPole)));
  const float z = top - 0.25f;
  AddSign(b, kSignShapes[first], z);
  AddClamp(b, z);
  if (two && variant % 2 == 0) {
    AddSign(b, kSignShapes[5 + variant % 3], z - 0.75f);
    AddClamp(b, z - 0.75f);
  } else if (two || variant == 6) {
    AddSupplement(b, z - 0.48f);
    AddClamp(b, z - 0.48f);
  }
  return std::move(b).Build();
}

Mesh StreetName(uint32_t variant) {
  MeshBuilder b;
  const float top = 2.6f + 0.2f * static_cast<float>(variant);
  AddPost(b, 0, 0, top, 0.03f, b.Use(Steel(0.4f, kPole)));
  const SurfaceIdx face = b.Use(SignFace(variant == 1 ? 0.8f : 0.2f));
  const SurfaceIdx edge = b.Use(Painted(0.7f, kTrafficSign));
  const auto blade = [&](float yaw_rad, float z) {
    b.SetFrame(FrameAt({0, 0, z}, yaw_rad));
    for (const float side : {1.f, -1.f}) {  // to be read from both sides
      b.Quad({side * -0.025f, side * 0.36f, -0.09f}, {side * -0.025f, side * -0.36f, -0.09f},
             {side * -0.025f, side * -0.36f, 0.09f}, {side * -0.025f, side * 0.36f, 0.09f}, face);
    }
    b.Box({-0.024f, -0.37f, -0.1f}, {0.024f, 0.37f, 0.1f}, edge);
    b.SetFrame(Eigen::Affine3f::Identity());
  };
  blade(0, top - 0.12f);
  blade(kTau / 4, top - 0.34f);
  return std::move(b).Build();
}

/// A lamp's head at the end of its arm, looking down; the arm comes along +y.
void AddLampHead(MeshBuilder& b, const Vector3f& at, float length_m, float droop_rad) {
  b.SetFrame(FrameAt(at, kTau / 4, droop_rad));
  b.Prism({{0, -0.06f, 0.05f},
           {length_m * 0.3f, -0.15f, 0.07f},
           {length_m, -0.11f, 0.05f},
           {length_m, 0.11f, 0.05f},
           {length_m * 0.3f, 0.15f, 0.07f},
           {0, 0.06f, 0.05f}},
          {0, 0, -0.1f}, b.Use(Painted(0.35f, kPole)), b.Use(Painted(0.4f, kPole)));
  b.Box({length_m * 0.3f, -0.1f, -0.07f}, {length_m * 0.95f, 0.1f, -0.045f},
        b.Use({Pattern::kPlain, 0.85f, 1, 0.2f, kPole}));
  b.SetFrame(Eigen::Affine3f::Identity());
}

Mesh CurvedLamp(float height_m, float reach_m, float albedo) {
  MeshBuilder b;
  const SurfaceIdx steel = b.Use(Steel(albedo, kPole));
  AddPost(b, 0, 0, 1.1f, 0.085f, steel, 10);
  b.Box({0.06f, -0.04f, 0.5f}, {0.092f, 0.04f, 0.9f}, b.Use(Painted(0.25f, kPole)));
  const float bend = height_m - 1.1f;
  Points3 path = {{0, 0, 1.1f}, {0, 0, bend}};
  std::vector<float> radii = {0.07f, 0.05f};
  for (int i = 1; i <= 5; ++i) {
    const float angle = kTau / 4 * 0.9f * static_cast<float>(i) / 5;
    path.emplace_back(0, reach_m * (1 - std::cos(angle)), bend + 1.05f * std::sin(angle));
    radii.push_back(0.05f - 0.004f * static_cast<float>(i));
  }
  b.Tube(path, radii, 8, steel);
  AddLampHead(b, path.back(), 0.75f, -0.08f);
  return std::move(b).Build();
}

/// A straight mast with a slanting head, as in new housing areas.
Mesh SlantingLamp() {
  MeshBuilder b;
  const SurfaceIdx steel = b.Use(Steel(0.16f, kPole));
  b.Tube({{0, 0, -kFootingM}, {0, 0, 5.8f}}, {0.07f, 0.045f}, 10, steel);
  b.Tube({{0, 0, 5.4f}, {0, 0.55f, 5.55f}}, {0.03f, 0.025f}, 6, steel);
  AddLampHead(b, {0, 0.35f, 5.5f}, 0.8f, -0.35f);
  return std::move(b).Build();
}

/// A column with a lantern on it, for footways and old streets.
Mesh Lantern(bool globe) {
  MeshBuilder b;
  const SurfaceIdx iron = b.Use(Steel(0.1f, kPole));
  const SurfaceIdx glass = b.Use({Pattern::kPlain, 0.75f, 1, 0.2f, kPole});
  b.Lathe({{0.12f, -kFootingM},
           {0.12f, 0.1f},
           {0.08f, 0.2f},
           {0.075f, 0.7f},
           {0.05f, 0.85f},
           {0.04f, 3.3f},
           {0.07f, 3.35f},
           {0.03f, 3.5f},
           {0, 3.5f}},
          10, iron);
  if (globe) {
    b.Ellipsoid({0, 0, 3.7f}, {0.22f, 0.22f, 0.22f}, 12, 8, glass);
  } else {
    b.Lathe({{0, 3.5f}, {0.14f, 3.5f}, {0.22f, 3.95f}}, 6, glass);
    b.Lathe({{0.22f, 3.95f}, {0.26f, 3.95f}, {0.06f, 4.15f}, {0, 4.25f}}, 6, iron);
  }
  return std::move(b).Build();
}

Mesh Lamp(uint32_t variant) {
  switch (variant) {
    case 0:
      return CurvedLamp(8, 1.6f, 0.4f);
    case 1:
      return SlantingLamp();
    case 2:
      return Lantern(/*globe=*/false);
    case 3:
      return CurvedLamp(10, 2.2f, 0.35f);
    default:
      return Lantern(/*globe=*/true);
  }
}

Mesh Pole(uint32_t variant) {
  MeshBuilder b;
  const float height_m = 8 + static_cast<float>(variant);
  const SurfaceIdx wood = b.Use({Pattern::kWood, 0.2f, 1, 0, kPole});
  const SurfaceIdx steel = b.Use(Steel(0.35f, kPole));
  const SurfaceIdx insulator = b.Use({Pattern::kPlain, 0.6f, 1, 0.15f, kPole});
  b.Tube({{0, 0, -kFootingM}, {0, 0, height_m}}, {0.14f, 0.09f}, 9, wood);
  const int arms = variant == 2 ? 1 : 2;
  for (int arm = 0; arm < arms; ++arm) {
    const float z = height_m - 0.3f - 0.8f * static_cast<float>(arm);
    AddBar(b, {0.12f, -0.9f, z}, {0.12f, 0.9f, z}, 0.09f, 0.11f, wood);
    for (const float side : {1.f, -1.f}) {
      b.Tube({{0.12f, side * 0.55f, z - 0.03f}, {0.12f, 0, z - 0.5f}}, {0.015f, 0.015f}, 4, steel);
      for (const float y : {0.4f, 0.82f}) {
        b.Tube({{0.12f, side * y, z + 0.05f}, {0.12f, side * y, z + 0.25f}}, {0.045f, 0.03f}, 6,
               insulator);
      }
    }
  }
  if (variant == 1) {  // with a transformer
    b.Cylinder({-0.4f, 0, height_m - 3}, {-0.4f, 0, height_m - 2.1f}, 0.27f, 12, steel);
    AddBar(b, {-0.2f, 0, height_m - 2.5f}, {0, 0, height_m - 2.5f}, 0.1f, 0.3f, steel);
  }
  return std::move(b).Build();
}

/// Three lights, or two for pedestrians, one above the other; their middle at the frame's origin,
/// looking to -x.
void AddSignalHead(MeshBuilder& b, const Vector3f& at, int lights, bool with_board) {
  const SurfaceIdx body = b.Use(Painted(0.05f, kTrafficLight));
  const SurfaceIdx hood = b.Use(Painted(0.04f, kTrafficLight));
  const float height_m = 0.31f * static_cast<float>(lights);
  b.SetFrame(FrameAt(at));
  b.Box({-0.1f, -0.15f, -height_m / 2}, {0.1f, 0.15f, height_m / 2}, body);
  if (with_board) {
    AddBoard(b, {0.02f, 0, 0}, 0.62f, height_m + 0.3f, 0.02f, 0.035f, body,
             b.Use(Painted(0.75f, kTrafficLight)));
  }
  for (int i = 0; i < lights; ++i) {
    const float z = 0.31f * (static_cast<float>(i) - 0.5f * static_cast<float>(lights - 1));
    const bool lit = i == 0;
    b.Polygon(Circle({-0.105f, 0, z}, kFront, 0.105f, 12),
              b.Use({Pattern::kPlain, lit ? 0.9f : 0.12f, 1, 0.1f, kTrafficLight}));
    std::vector<Points3> rings;
    for (const float x : {-0.1f, -0.3f}) {
      Points3& ring = rings.emplace_back();
      for (int k = 0; k <= 8; ++k) {
        const float angle = kTau * (static_cast<float>(k) / 8 * 0.66f - 0.08f);
        const float y = -0.115f * std::cos(angle), rise = 0.115f * std::sin(angle);
        ring.emplace_back(x, y, z + rise);
      }
    }
    b.Loft(rings, /*closed=*/false, hood);
  }
  b.SetFrame(Eigen::Affine3f::Identity());
}

Mesh TrafficLight(uint32_t variant) {
  MeshBuilder b;
  const SurfaceIdx steel = b.Use(Steel(0.33f, kPole));
  const SurfaceIdx button = b.Use(Painted(0.5f, kPole));
  if (variant == 1) {  // over the road
    b.Tube({{0, 0, -kFootingM}, {0, 0, 5.9f}}, {0.11f, 0.08f}, 10, steel);
    b.Tube({{0, 0, 5.6f}, {0, 2, 5.75f}, {0, 4.6f, 5.8f}}, {0.07f, 0.06f, 0.045f}, 8, steel);
    AddSignalHead(b, {-0.12f, 4.3f, 5.55f}, 3, true);
  } else {
    AddPost(b, 0, 0, 3.4f, 0.055f, steel, 10);
  }
  AddSignalHead(b, {-0.22f, 0, 2.85f}, 3, variant == 2);
  AddBar(b, {-0.14f, 0, 3.2f}, {0, 0, 3.2f}, 0.04f, 0.04f, steel);
  AddBar(b, {-0.14f, 0, 2.5f}, {0, 0, 2.5f}, 0.04f, 0.04f, steel);
  if (variant != 2) {  // pedestrians' own, across the road
    MeshBuilder across;
    AddSignalHead(across, {-0.22f, 0, 2.45f}, 2, false);
    b.Add(across.mesh(), FrameAt({0, 0, 0}, -kTau / 4));
  }
  b.Box({-0.1f, -0.06f, 1}, {-0.04f, 0.06f, 1.2f}, button);
  return std::move(b).Build();
}

Mesh Billboard(uint32_t variant) {
  MeshBuilder b;
  const SurfaceIdx poster = b.Use({Pattern::kPoster, 0.5f, 1, 0.05f, kUnlabelled});
  const SurfaceIdx frame = b.Use(Steel(variant == 1 ? 0.15f : 0.35f, kUnlabelled));
  const SurfaceIdx post = b.Use(Steel(0.3f, kPole));
  if (variant == 1) {  // a glazed case at the height of eyes, to be read from both sides
    AddBoard(b, {-0.08f, 0, 1.6f}, 1.3f, 1.9f, 0.16f, 0.07f, poster, frame);
    MeshBuilder back;
    AddBoard(back, {-0.08f, 0, 1.6f}, 1.3f, 1.9f, 0.16f, 0.07f,
             back.Use({Pattern::kPoster, 0.5f, 1, 0.05f, kUnlabelled}),
             back.Use(Steel(0.15f, kUnlabelled)));
    b.Add(back.mesh(), FrameAt({0, 0, 0}, kTau / 2));
    b.Box({-0.1f, -0.3f, -kFootingM}, {0.1f, 0.3f, 0.65f}, frame);
    return std::move(b).Build();
  }
  const float width_m = variant == 2 ? 5.2f : 3.8f, height_m = variant == 2 ? 2.9f : 2.7f;
  const float bottom_m = variant == 2 ? 2.4f : 0.9f;
  AddBoard(b, {-0.12f, 0, bottom_m + height_m / 2}, width_m, height_m, 0.12f, 0.12f, poster, frame);
  for (const float share : {-0.32f, 0.32f}) {
    const float y = share * width_m;
    b.Box({-0.06f, y - 0.07f, -kFootingM}, {0.08f, y + 0.07f, bottom_m + height_m - 0.2f}, post);
    AddBar(b, {0.02f, y, bottom_m + height_m * 0.6f}, {1.3f, y, -kFootingM}, 0.08f, 0.08f, post);
  }
  return std::move(b).Build();
}

/// A lattice of bars between two planes, along y.
void AddTruss(MeshBuilder& b, float from_y, float to_y, float bottom_m, SurfaceIdx steel) {
  constexpr float kDepthM = 0.8f, kHeightM = 1;
  constexpr int kBays = 14;
  for (const float x : {0.f, kDepthM}) {
    for (const float z : {bottom_m, bottom_m + kHeightM}) {
      AddBar(b, {x, from_y, z}, {x, to_y, z}, 0.1f, 0.1f, steel);
    }
  }
  const float step = (to_y - from_y) / kBays;
  for (int i = 0; i < kBays; ++i) {
    const float y = from_y + step * static_cast<float>(i), next = y + step;
    const float low = i % 2 ? bottom_m : bottom_m + kHeightM;
    const float high = i % 2 ? bottom_m + kHeightM : bottom_m;
    for (const float x : {0.f, kDepthM})
      AddBar(b, {x, y, low}, {x, next, high}, 0.06f, 0.06f, steel);
    for (const float z : {bottom_m, bottom_m + kHeightM}) {
      AddBar(b, {0, y, z}, {kDepthM, next, z}, 0.05f, 0.05f, steel);
    }
  }
}

Mesh Gantry(uint32_t variant) {
  constexpr float kHalfSpanM = 9.2f, kClearM = 6.2f;
  MeshBuilder b;
  const SurfaceIdx steel = b.Use(Steel(0.42f, kPole));
  const SurfaceIdx foot = b.Use({Pattern::kConcrete, 0.45f, 1, 0, kPole});
  for (const float y : {-kHalfSpanM, kHalfSpanM}) {
    for (const float x : {0.f, 0.8f}) {
      b.Box({x - 0.13f, y - 0.13f, 0}, {x + 0.13f, y + 0.13f, kClearM + 1.1f}, steel, false);
    }
    for (float z = 1; z < kClearM; z += 1.3f) {
      AddBar(b, {0, y, z}, {0.8f, y, z + 0.65f}, 0.08f, 0.08f, steel);
      AddBar(b, {0.8f, y, z + 0.65f}, {0, y, z + 1.3f}, 0.08f, 0.08f, steel);
    }
    b.Box({-0.4f, y - 0.5f, -kFootingM}, {1.2f, y + 0.5f, 0.25f}, foot);
  }
  AddTruss(b, -kHalfSpanM, kHalfSpanM, kClearM, steel);
  const SurfaceIdx rear = b.Use(Steel(0.4f, kTrafficSign));
  if (variant == 0) {
    AddBoard(b, {-0.25f, -4.6f, kClearM + 0.7f}, 5.4f, 3.2f, 0.08f, 0.08f, b.Use(SignFace(0.2f)),
             rear);
    AddBoard(b, {-0.25f, 2.2f, kClearM + 0.7f}, 6.2f, 3.6f, 0.08f, 0.08f, b.Use(SignFace(0.2f)),
             rear);
  } else {  // a signal over each lane
    for (int lane = 0; lane < 4; ++lane) {
      const float y = 3.7f * (static_cast<float>(lane) - 1.5f);
      AddBoard(b, {-0.35f, y, kClearM + 0.5f}, 1.5f, 1.5f, 0.3f, 0.12f, b.Use(SignFace(0.06f)),
               b.Use(Painted(0.12f, kTrafficSign)));
    }
  }
  return std::move(b).Build();
}

constexpr ModelKind kKinds[] = {
    {"lamp", 5, Lamp},
    {"pole", 3, Pole},
    {"traffic-sign", 14, TrafficSign},
    {"traffic-light", 3, TrafficLight},
    {"street-name", 3, StreetName},
    {"billboard", 3, Billboard},
    {"gantry", 2, Gantry},
};

}  // namespace

std::span<const ModelKind> SignKinds() { return kKinds; }

}  // namespace carmap
