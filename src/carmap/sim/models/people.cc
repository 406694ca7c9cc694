// People on foot and on two wheels, in phases of a step.
#include <algorithm>
#include <array>
#include <cmath>

#include "carmap/sim/models/model_kinds.h"

namespace carmap {
namespace {

using Eigen::Vector2f;
using Eigen::Vector3f;
using enum SemanticClass;

constexpr float kTau = 2 * static_cast<float>(M_PI);
constexpr uint32_t kPhases = 8;
/// Measures of a person 1.75 m tall.
constexpr float kThighM = 0.43f, kShinM = 0.42f, kUpperArmM = 0.3f, kForearmM = 0.26f;
constexpr float kHipM = 0.92f, kHipHalfM = 0.09f, kShoulderM = 1.37f, kShoulderHalfM = 0.17f;
constexpr float kStepRad = 0.435f;  ///< a thigh's swing to either side

enum class Outfit { kJacket, kCoat, kShirt, kSkirt };
enum class Carried { kNothing, kBag, kBackpack };

struct Look {
  float height_m, girth;  ///< 1: slim
  Outfit outfit;
  Carried carried;
  bool long_hair, hat;
  float top_albedo, legs_albedo, hair_albedo;
};

constexpr std::array<Look, 6> kLooks = {{
    {1.80f, 1.1f, Outfit::kJacket, Carried::kNothing, false, false, 0.1f, 0.16f, 0.06f},
    {1.68f, 1.0f, Outfit::kCoat, Carried::kBag, true, false, 0.42f, 0.06f, 0.2f},
    {1.76f, 1.0f, Outfit::kShirt, Carried::kNothing, false, false, 0.7f, 0.3f, 0.1f},
    {1.65f, 0.95f, Outfit::kSkirt, Carried::kBackpack, true, false, 0.2f, 0.12f, 0.04f},
    {1.30f, 0.95f, Outfit::kJacket, Carried::kBackpack, false, false, 0.5f, 0.1f, 0.25f},
    {1.72f, 1.3f, Outfit::kCoat, Carried::kBag, false, true, 0.15f, 0.2f, 0.5f},
}};

/// In the plane of walking: this far forward of straight down.
Vector3f Down(float forward_rad) { return {std::sin(forward_rad), 0, -std::cos(forward_rad)}; }

/// The joint between two links that reach from `from` towards `to`, bent to the side of `bend`.
Vector3f Joint(const Vector3f& from, const Vector3f& to, float first_m, float second_m,
               const Vector3f& bend) {
  const Vector3f way = to - from;
  const float reach = std::min(way.norm(), 0.999f * (first_m + second_m));
  const float along = (reach * reach + first_m * first_m - second_m * second_m) / (2 * reach);
  const float off = std::sqrt(std::max(0.f, first_m * first_m - along * along));
  const Vector3f direction = way.normalized();
  return from + along * direction + off * (bend - bend.dot(direction) * direction).normalized();
}

/// A body in some posture, dressed.
class Figure {
 public:
  Figure(MeshBuilder& builder, const Look& look, SemanticClass label)
      : b_(builder),
        look_(look),
        top_(b_.Use({Pattern::kFabric, look.top_albedo, 1, 0, label})),
        legs_(b_.Use({Pattern::kFabric, look.legs_albedo, 1, 0, label})),
        skin_(b_.Use({Pattern::kSkin, 0.4f, 1, 0, label})),
        hair_(b_.Use({Pattern::kFabric, look.hair_albedo, 1, 0, label})),
        shoe_(b_.Use({Pattern::kPlain, 0.06f, 1, 0, label})),
        bag_(b_.Use({Pattern::kFabric, 0.14f, 1, 0, label})) {}

  /// Hip, knee, ankle; the foot's toes point along `toes`.
  void Leg(const Vector3f& hip, const Vector3f& knee, const Vector3f& ankle, const Vector3f& toes) {
    const bool bare = look_.outfit == Outfit::kSkirt;
    const float g = look_.girth;
    b_.Tube({hip, knee}, {0.088f * g, 0.06f * g}, 7, bare ? skin_ : legs_);
    b_.Tube({knee, 0.5f * (knee + ankle) + Vector3f(-0.012f, 0, 0), ankle},
            {0.058f * g, 0.056f * g, 0.042f}, 7, bare ? skin_ : legs_);
    const Vector3f sole = Vector3f(0, 0, -0.055f), across(0, 0.042f, 0);
    const Vector3f heel = ankle - 0.07f * toes, tip = ankle + 0.18f * toes;
    b_.Prism({heel + sole - across, tip + sole - 0.8f * across, tip + sole + 0.8f * across,
              heel + sole + across},
             {0, 0, 0.05f}, shoe_, shoe_);
    b_.Prism({heel - across + 0.9f * sole, ankle + 0.08f * toes - across + 0.9f * sole,
              ankle + 0.08f * toes + across + 0.9f * sole, heel + across + 0.9f * sole},
             {0, 0, 0.08f}, shoe_, shoe_);
  }

  void Arm(const Vector3f& shoulder, const Vector3f& elbow, const Vector3f& hand) {
    const bool bare = look_.outfit == Outfit::kShirt;
    const float g = look_.girth * (look_.outfit == Outfit::kShirt ? 0.9f : 1.1f);
    b_.Ellipsoid(shoulder, {0.058f * g, 0.055f * g, 0.055f * g}, 7, 4, top_);
    b_.Tube({shoulder, elbow}, {0.052f * g, 0.043f * g}, 6, top_);
    b_.Tube({elbow, hand}, {0.043f * g, 0.03f * g}, 6, bare ? skin_ : top_);
    b_.Ellipsoid(hand + 0.05f * (hand - elbow).normalized(), {0.04f, 0.03f, 0.05f}, 6, 4, skin_);
  }

  /// From the hips upwards along the frame's z axis, which leans with the back; the hips are the
  /// frame's origin.
  void TorsoAndHead() {
    const float g = look_.girth;
    struct Section {
      float z, depth, width;
    };
    std::vector<Section> sections = {
        {-0.06f, 0.115f * g, 0.16f * g}, {0.12f, 0.105f * g, 0.145f * g},
        {0.32f, 0.128f * g, 0.175f * g}, {0.47f, 0.105f * g, 0.19f * g},
        {0.53f, 0.075f, 0.12f},          {0.57f, 0.055f, 0.06f}};
    std::vector<Points3> rings;
    for (const Section& section : sections) {
      rings.push_back(Ring(section.z, section.depth, section.width));
    }
    b_.Loft(rings, /*closed=*/true, top_);
    b_.Polygon({rings.front().rbegin(), rings.front().rend()}, legs_);
    b_.Cylinder({0.01f, 0, 0.55f}, {0.02f, 0, 0.64f}, 0.05f, 7, skin_);
    b_.Ellipsoid({0.03f, 0, 0.71f}, {0.098f, 0.077f, 0.122f}, 9, 7, skin_);
    b_.Ellipsoid({0.008f, 0, 0.745f}, {0.104f, 0.086f, 0.1f}, 9, 6, hair_);
    if (look_.long_hair) b_.Ellipsoid({-0.05f, 0, 0.63f}, {0.06f, 0.085f, 0.16f}, 7, 5, hair_);
    if (look_.hat) Hat();
    if (look_.carried == Carried::kBackpack) {
      b_.Ellipsoid({-0.2f * g, 0, 0.27f}, {0.11f, 0.15f, 0.23f}, 8, 6, bag_);
    }
  }

  /// A coat's or skirt's lower part, from the hips down to `length_m` below, wide enough for both
  /// knees.
  void Skirt(float length_m, float knees_forward_m) {
    const float g = look_.girth;
    const SurfaceIdx surface = look_.outfit == Outfit::kCoat ? top_ : legs_;
    const std::vector<Points3> rings = {
        Ring(-length_m, 0.15f * g + 0.75f * knees_forward_m, 0.2f * g),
        Ring(-0.2f, 0.13f * g + 0.2f * knees_forward_m, 0.185f * g),
        Ring(0.03f, 0.118f * g, 0.163f * g)};
    b_.Loft(rings, /*closed=*/true, surface);
  }

  void HandBag(const Vector3f& hand) {
    b_.Box(hand + Vector3f(-0.15f, -0.05f, -0.36f), hand + Vector3f(0.15f, 0.05f, -0.12f), bag_);
    for (const float x : {-0.08f, 0.08f}) {
      b_.Tube({hand + Vector3f(x, 0, -0.13f), hand + Vector3f(0, 0, -0.03f)}, {0.008f, 0.008f}, 3,
              bag_, false);
    }
  }

  void Helmet() { b_.Ellipsoid({0.015f, 0, 0.765f}, {0.135f, 0.1f, 0.095f}, 9, 6, bag_); }

  /// Over all of the head.
  void FullHelmet(SurfaceIdx shell, SurfaceIdx visor) {
    b_.Ellipsoid({0.02f, 0, 0.72f}, {0.145f, 0.125f, 0.15f}, 10, 8, shell);
    b_.Ellipsoid({0.075f, 0, 0.73f}, {0.1f, 0.1f, 0.05f}, 8, 5, visor);
  }

 private:
  static Points3 Ring(float z, float depth, float width) {
    Points3 ring = Circle({0, 0, z}, Vector3f::UnitZ(), 1, 9);
    for (Vector3f& p : ring) p.head<2>() = p.head<2>().cwiseProduct(Vector2f(depth, width));
    return ring;
  }

  void Hat() {
    b_.SetFrame(b_.frame() * FrameAt({0.01f, 0, 0.77f}));
    b_.Lathe({{0.17f, 0}, {0.17f, 0.012f}, {0.1f, 0.02f}, {0.09f, 0.11f}, {0, 0.12f}}, 12, bag_);
  }

  MeshBuilder& b_;
  const Look& look_;
  SurfaceIdx top_, legs_, skin_, hair_, shoe_, bag_;
};

/// On its feet, and as tall as `scale` times what was built.
Mesh StoodOnGround(const MeshBuilder& built, float scale) {
  const float low = BoundsOf(built.mesh()).min().z();
  MeshBuilder standing;
  standing.Add(built.mesh(), Eigen::Scaling(scale) * Eigen::Translation3f(0, 0, -low));
  return std::move(standing).Build();
}

Mesh Pedestrian(uint32_t variant) {
  const Look& look = kLooks[variant / kPhases];
  const float phase = kTau * static_cast<float>(variant % kPhases) / kPhases;
  MeshBuilder b;
  Figure figure(b, look, kPerson);
  float knees_forward = 0;
  for (const float side : {1.f, -1.f}) {  // left first; the legs are half a cycle apart
    const float own = side > 0 ? phase : phase + kTau / 2;
    const float thigh = kStepRad * std::sin(own);
    // The knee bends while the leg comes forward.
    const float knee = 0.08f + 0.75f * std::pow(std::max(0.f, std::cos(own + 0.35f)), 1.5f);
    const Vector3f hip(0, side * kHipHalfM, kHipM), bent = hip + kThighM * Down(thigh);
    const Vector3f ankle = bent + kShinM * Down(thigh - knee);
    const float toes_down = 0.5f * std::max(0.f, knee - 0.2f);
    figure.Leg(hip, bent, ankle, Vector3f(std::cos(toes_down), 0, -std::sin(toes_down)));
    knees_forward = std::max(knees_forward, std::abs(bent.x()));
    // Arms swing against the legs.
    const float swing = -0.8f * kStepRad * std::sin(own),
                elbow_bend = 0.3f + 0.2f * std::max(0.f, swing);
    const Vector3f shoulder(0, side * (kShoulderHalfM * look.girth), kShoulderM);
    const Vector3f out(0, side * 0.12f, 0);
    const Vector3f elbow = shoulder + kUpperArmM * (Down(swing) + out).normalized();
    const Vector3f hand = elbow + kForearmM * Down(swing + elbow_bend);
    figure.Arm(shoulder, elbow, hand);
    if (side < 0 && look.carried == Carried::kBag) figure.HandBag(hand);
  }
  b.SetFrame(FrameAt({0, 0, kHipM}, 0, 0.04f));
  if (look.outfit == Outfit::kCoat) figure.Skirt(0.4f, knees_forward);
  if (look.outfit == Outfit::kSkirt) figure.Skirt(0.42f, knees_forward);
  figure.TorsoAndHead();
  return StoodOnGround(b, look.height_m / 1.75f);
}

/// A wheel in the plane y = 0, standing on the ground at `x`.
void AddWheel(MeshBuilder& b, float x, float radius, float tyre_m, int spokes, SurfaceIdx rubber,
              SurfaceIdx metal) {
  const Vector3f hub(x, 0, radius);
  std::vector<Points3> rings;
  constexpr int kSides = 20;
  for (int i = 0; i <= kSides; ++i) {
    const float angle = kTau * static_cast<float>(i) / kSides;
    const Vector3f out(std::cos(angle), 0, std::sin(angle));
    rings.push_back({hub + radius * out, hub + (radius - tyre_m) * out + Vector3f(0, tyre_m / 2, 0),
                     hub + (radius - 2 * tyre_m) * out,
                     hub + (radius - tyre_m) * out - Vector3f(0, tyre_m / 2, 0)});
  }
  b.Loft(rings, /*closed=*/true, rubber);
  for (int i = 0; i < spokes; ++i) {
    const float angle = kTau * static_cast<float>(i) / static_cast<float>(spokes);
    const Vector3f rim =
        hub + (radius - 1.8f * tyre_m) * Vector3f(std::cos(angle), 0, std::sin(angle));
    b.Tube({hub + Vector3f(0, i % 2 ? 0.03f : -0.03f, 0), rim}, {0.004f, 0.004f}, 3, metal, false);
  }
  b.Cylinder(hub - Vector3f(0, 0.05f, 0), hub + Vector3f(0, 0.05f, 0), 0.03f, 6, metal);
}

/// Where a rider sits, holds on and treads.
struct Seat {
  Vector3f hips, grip;  ///< of the left hand
  float lean_rad;       ///< of the back, forward
};

/// Hips, back, arms, legs of one who rides; `foot(side)` is where each foot is.
void AddRider(MeshBuilder& b, Figure& figure, const Seat& seat,
              const std::array<Vector3f, 2>& feet) {
  const Eigen::Affine3f back = FrameAt(seat.hips, 0, seat.lean_rad);
  for (const int i : {0, 1}) {
    const float side = i == 0 ? 1 : -1;
    const Vector3f hip = seat.hips + Vector3f(0, side * kHipHalfM, 0);
    const Vector3f ankle = feet[i] + Vector3f(-0.08f, 0, 0.06f);
    figure.Leg(hip, Joint(hip, ankle, kThighM, kShinM, Vector3f(1, 0, 0.3f)), ankle,
               Vector3f(0.98f, 0, -0.2f));
    const Vector3f shoulder = back * Vector3f(0, side * kShoulderHalfM, kShoulderM - kHipM);
    const Vector3f hand = seat.grip.cwiseProduct(Vector3f(1, side, 1));
    figure.Arm(shoulder, Joint(shoulder, hand, kUpperArmM, kForearmM, Vector3f(-0.3f, side, -1)),
               hand);
  }
  b.SetFrame(back);
  figure.TorsoAndHead();
}

/// Where the figure's head would hang down, it looks ahead: the back bends less than it leans.
constexpr float kSportLean = 0.75f, kUprightLean = 0.22f;

void AddBicycle(MeshBuilder& b, float phase, bool sporty, float paint_albedo) {
  const SurfaceIdx frame = b.Use({Pattern::kPlain, paint_albedo, 1, 0.1f, kBicycle});
  const SurfaceIdx metal = b.Use({Pattern::kMetal, 0.45f, 1, 0.1f, kBicycle});
  const SurfaceIdx rubber = b.Use({Pattern::kRubber, 0.04f, 1, 0, kBicycle});
  const float radius = 0.34f;
  const Vector3f rear(-0.52f, 0, radius), front(0.55f, 0, radius), crank(-0.08f, 0, 0.28f);
  const Vector3f saddle(-0.25f, 0, 0.92f), head(0.36f, 0, 0.86f), fork(0.42f, 0, 0.66f);
  AddWheel(b, rear.x(), radius, sporty ? 0.028f : 0.04f, 10, rubber, metal);
  AddWheel(b, front.x(), radius, sporty ? 0.028f : 0.04f, 10, rubber, metal);
  const auto tube = [&](const Vector3f& from, const Vector3f& to, float r) {
    b.Tube({from, to}, {r, r}, 6, frame, false);
  };
  tube(crank, saddle, 0.017f);
  tube(crank, fork, 0.02f);
  tube(sporty ? Vector3f(saddle - Vector3f(-0.03f, 0, 0.12f)) : Vector3f(0.5f * (crank + saddle)),
       head, 0.018f);
  tube(fork, head, 0.02f);
  for (const float y : {-0.05f, 0.05f}) {
    const Vector3f off(0, y, 0);
    tube(rear + off, crank + 0.3f * off, 0.009f);
    tube(rear + off, saddle - Vector3f(0, 0, 0.18f) + 0.3f * off, 0.008f);
    tube(front + off, fork + 0.6f * off, 0.011f);
  }
  b.Ellipsoid(saddle + Vector3f(0, 0, 0.02f), {0.13f, 0.07f, 0.03f}, 8, 4, rubber);
  const float bar = sporty ? 0.9f : 1.06f;
  b.Tube({head, {0.4f, 0, bar}}, {0.015f, 0.013f}, 6, metal, false);
  b.Tube({{sporty ? 0.44f : 0.28f, -0.28f, bar},
          {0.4f, -0.15f, bar},
          {0.4f, 0.15f, bar},
          {sporty ? 0.44f : 0.28f, 0.28f, bar}},
         {0.013f, 0.012f, 0.012f, 0.013f}, 6, metal);
  for (const float side : {1.f, -1.f}) {
    const float own = side > 0 ? phase : phase + kTau / 2;
    const Vector3f pedal =
        crank + 0.17f * Vector3f(std::cos(own), 0, -std::sin(own)) + Vector3f(0, side * 0.1f, 0);
    b.Tube({crank + Vector3f(0, side * 0.06f, 0), pedal}, {0.012f, 0.01f}, 4, metal);
    b.Box(pedal - Vector3f(0.05f, 0.045f, 0.012f), pedal + Vector3f(0.05f, 0.045f, 0.012f), rubber);
  }
  b.Cylinder(crank + Vector3f(0, -0.045f, 0), crank + Vector3f(0, -0.035f, 0), 0.09f, 14, metal);
  if (sporty) return;
  // Mudguards, rack with a box, lamp.
  for (const Vector3f& hub : {rear, front}) {
    std::vector<Points3> rings;
    for (int i = 0; i <= 7; ++i) {
      const float angle = kTau * (0.02f + 0.06f * static_cast<float>(i));
      const Vector3f out(-std::cos(angle), 0, std::sin(angle));
      rings.push_back(
          {hub + 0.36f * out + Vector3f(0, 0.03f, 0), hub + 0.36f * out - Vector3f(0, 0.03f, 0)});
    }
    b.Loft(rings, /*closed=*/false, frame);
  }
  b.Box({-0.75f, -0.08f, 0.74f}, {-0.35f, 0.08f, 0.76f}, metal);
  b.Box({-0.72f, -0.15f, 0.77f}, {-0.4f, 0.15f, 0.97f},
        b.Use({Pattern::kFabric, 0.2f, 1, 0, kBicycle}));
  b.Cylinder({0.45f, 0, 0.84f}, {0.5f, 0, 0.84f}, 0.04f, 8,
             b.Use({Pattern::kPlain, 0.7f, 1, 0.2f, kBicycle}));
}

Mesh Cyclist(uint32_t variant) {
  constexpr std::array<uint32_t, 4> kRiders = {0, 3, 2, 1};
  const uint32_t rider = variant / kPhases;
  const bool sporty = rider % 2 == 0;
  Look look = kLooks[kRiders[rider]];
  look.carried = rider == 1 ? Carried::kBackpack : Carried::kNothing;
  if (look.outfit == Outfit::kCoat) look.outfit = Outfit::kJacket;
  const float phase = kTau * static_cast<float>(variant % kPhases) / kPhases;
  MeshBuilder b;
  AddBicycle(b, phase, sporty, std::array{0.08f, 0.3f, 0.6f, 0.15f}[rider]);
  Figure figure(b, look, kRider);
  std::array<Vector3f, 2> feet;
  for (const int i : {0, 1}) {
    const float own = i == 0 ? phase : phase + kTau / 2;
    feet[i] = Vector3f(-0.08f, i == 0 ? 0.11f : -0.11f, 0.28f) +
              0.17f * Vector3f(std::cos(own), 0, -std::sin(own));
  }
  const Seat seat = {{-0.22f, 0, 0.99f},
                     {sporty ? 0.42f : 0.28f, 0.26f, sporty ? 0.93f : 1.09f},
                     sporty ? kSportLean : kUprightLean};
  AddRider(b, figure, seat, feet);
  if (sporty) figure.Helmet();
  return StoodOnGround(b, 1);
}

Mesh Motorcycle(uint32_t variant) {
  MeshBuilder b;
  const bool scooter = variant == 1;
  const SurfaceIdx paint =
      b.Use({Pattern::kCarPaint, std::array{0.08f, 0.55f, 0.2f}[variant], 1, 0.15f, kMotorcycle});
  const SurfaceIdx dark = b.Use({Pattern::kPlain, 0.04f, 1, 0.02f, kMotorcycle});
  const SurfaceIdx metal = b.Use({Pattern::kMetal, 0.45f, 1, 0.12f, kMotorcycle});
  const SurfaceIdx rubber = b.Use({Pattern::kRubber, 0.04f, 1, 0, kMotorcycle});
  const float radius = scooter ? 0.24f : 0.31f, base = scooter ? 0.65f : 0.72f;
  AddWheel(b, -base, radius, 0.07f, 6, rubber, metal);
  AddWheel(b, base, radius, 0.06f, 6, rubber, metal);
  for (const float y : {-0.09f, 0.09f}) {  // fork, swing arm, exhaust
    b.Tube({{base, y, radius}, {0.5f, y, 0.95f}}, {0.028f, 0.025f}, 6, metal);
    b.Tube({{-base, y, radius}, {-0.15f, y, 0.42f}}, {0.03f, 0.03f}, 5, dark);
  }
  b.Tube({{0.1f, -0.16f, 0.3f}, {-0.3f, -0.19f, 0.3f}, {-0.85f, -0.2f, 0.42f}},
         {0.03f, 0.045f, 0.055f}, 8, metal);
  b.Box({-0.3f, -0.17f, 0.22f}, {0.28f, 0.17f, 0.55f}, dark);  // engine
  for (int i = 0; i < 4; ++i) {
    const float z = 0.42f + 0.05f * static_cast<float>(i);
    b.Box({-0.02f, -0.2f, z}, {0.24f, 0.2f, z + 0.02f}, metal);
  }
  if (scooter) {
    b.Prism(
        {{0.3f, -0.22f, 0.3f}, {0.42f, -0.22f, 0.28f}, {0.58f, -0.22f, 0.98f}, {0.48f, -0.22f, 1}},
        {0, 0.44f, 0}, paint, paint);
    b.Box({-0.25f, -0.18f, 0.26f}, {0.35f, 0.18f, 0.34f}, paint);
    b.Prism({{-0.9f, -0.17f, 0.5f},
             {-0.2f, -0.17f, 0.35f},
             {-0.05f, -0.17f, 0.72f},
             {-0.9f, -0.17f, 0.74f}},
            {0, 0.34f, 0}, paint, paint);
  } else {
    b.Ellipsoid({0.2f, 0, 0.83f}, {0.3f, 0.16f, 0.15f}, 10, 6, paint);  // tank
    b.Prism({{-0.85f, -0.09f, 0.82f},
             {-0.2f, -0.13f, 0.62f},
             {-0.1f, -0.13f, 0.76f},
             {-0.9f, -0.07f, 0.92f}},
            {0, 0.2f, 0}, paint, paint);
    b.Prism(
        {{0.45f, -0.2f, 0.6f}, {0.72f, -0.2f, 0.8f}, {0.68f, -0.2f, 1.02f}, {0.42f, -0.2f, 0.98f}},
        {0, 0.4f, 0}, paint, paint);
  }
  b.Box({-0.72f, -0.14f, 0.76f}, {0, 0.14f, 0.84f}, dark);  // seat
  b.Ellipsoid({scooter ? 0.6f : 0.72f, 0, 0.88f}, {0.06f, 0.1f, 0.08f}, 8, 5,
              b.Use({Pattern::kPlain, 0.75f, 1, 0.3f, kMotorcycle}));
  b.Quad({-0.95f, 0.1f, 0.6f}, {-0.95f, -0.1f, 0.6f}, {-0.93f, -0.1f, 0.8f}, {-0.93f, 0.1f, 0.8f},
         b.Use({Pattern::kSign, 0.75f, 1, 0.02f, kMotorcycle}));
  b.Box({-0.94f, -0.06f, 0.83f}, {-0.88f, 0.06f, 0.9f},
        b.Use({Pattern::kPlain, 0.1f, 1, 0.1f, kMotorcycle}));
  b.Tube({{0.42f, -0.36f, 1.04f}, {0.5f, 0, 1.05f}, {0.42f, 0.36f, 1.04f}},
         {0.016f, 0.016f, 0.016f}, 6, dark);
  for (const float side : {1.f, -1.f}) {
    b.Tube({{0.46f, side * 0.3f, 1.05f}, {0.44f, side * 0.4f, 1.2f}}, {0.008f, 0.008f}, 4, dark);
    b.Box({0.42f, side * 0.42f - 0.07f, 1.16f}, {0.44f, side * 0.42f + 0.07f, 1.26f}, dark);
  }
  Look look = kLooks[0];
  look.top_albedo = std::array{0.06f, 0.35f, 0.12f}[variant];
  look.legs_albedo = 0.06f;
  Figure figure(b, look, kRider);
  const float feet_x = scooter ? 0.15f : -0.05f, feet_z = scooter ? 0.38f : 0.32f,
              feet_y = scooter ? 0.13f : 0.24f;
  AddRider(b, figure, {{-0.3f, 0, 0.93f}, {0.42f, 0.33f, 1.05f}, variant == 2 ? 0.6f : 0.15f},
           {Vector3f(feet_x, feet_y, feet_z), Vector3f(feet_x, -feet_y, feet_z)});
  figure.FullHelmet(
      b.Use({Pattern::kCarPaint, std::array{0.7f, 0.1f, 0.3f}[variant], 1, 0.15f, kRider}),
      b.Use({Pattern::kGlass, 0.04f, 1, 0.4f, kRider}));
  return StoodOnGround(b, 1);
}

constexpr ModelKind kKinds[] = {
    {"pedestrian", kPhases* static_cast<uint32_t>(kLooks.size()), Pedestrian, kPhases, 1.45f},
    {"cyclist", kPhases * 4, Cyclist, kPhases, 5.2f},
    {"motorcycle", 3, Motorcycle},
};

}  // namespace

std::span<const ModelKind> PeopleKinds() { return kKinds; }

}  // namespace carmap
