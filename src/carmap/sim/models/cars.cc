// Cars and vans: a body lofted along its length, a greenhouse lofted upwards from it, wheels.
#include <algorithm>
#include <array>
#include <cmath>

#include "carmap/sim/models/model_kinds.h"

namespace carmap {
namespace {

using Eigen::Vector2f;
using Eigen::Vector3f;

constexpr auto kCar = SemanticClass::kCar;

/// Distances along the car are from its front bumper backwards; a side view, as a draughtsman has
/// it.
struct CarShape {
  float length_m, width_m, height_m;
  float front_axle_m, rear_axle_m, wheel_radius_m, sill_m;
  std::vector<Vector2f> deck;  ///< (along, height) of bonnet, belt line and boot
  /// The greenhouse: where its glass meets the deck and the roof, before and behind.
  float cowl_m, roof_front_m, roof_rear_m, rear_base_m;
  float roof_half_width_m;
  /// (from, to) along the belt of the windows of a side, from the front. What is between is pillar.
  std::vector<Vector2f> windows;
  float rear_round = 1;  ///< 0: the tail is a box's
  bool rear_glass = true;
  bool roof_rails = false;
  enum { kPainted, kLow, kHigh } dark_bumpers = kPainted;  ///< how far up they are of dark plastic
};

float Along(const std::vector<Vector2f>& line, float at) {
  for (size_t i = 1; i < line.size(); ++i) {
    if (at > line[i].x() && i + 1 < line.size()) continue;
    const float share = (at - line[i - 1].x()) / (line[i].x() - line[i - 1].x());
    return line[i - 1].y() + std::clamp(share, 0.f, 1.f) * (line[i].y() - line[i - 1].y());
  }
  return line.back().y();
}

/// Lines along the body's side, from the sill to the edge of the deck.
enum Level { kSill, kLower, kCrease, kShoulder, kDeckEdge, kLevels };

class CarBody {
 public:
  CarBody(const CarShape& shape, float paint_albedo)
      : shape_(shape),
        paint_(builder_.Use({Pattern::kCarPaint, paint_albedo, 1, 0.15f, kCar})),
        seam_(builder_.Use({Pattern::kCarPaint, 0.4f * paint_albedo, 1, 0, kCar})),
        dark_(builder_.Use({Pattern::kPlain, 0.035f, 1, 0.03f, kCar})),
        glass_(builder_.Use({Pattern::kGlass, 0.04f, 1, 0.3f, kCar})),
        head_light_(builder_.Use({Pattern::kPlain, 0.65f, 1, 0.35f, kCar})),
        tail_light_(builder_.Use({Pattern::kPlain, 0.16f, 1, 0.1f, kCar})),
        metal_(builder_.Use({Pattern::kMetal, 0.45f, 0.6f, 0.15f, kCar})) {}

  Mesh Build() && {
    AddSides();
    AddEnd(/*front=*/true);
    AddEnd(/*front=*/false);
    AddGreenhouse();
    AddUnderbody();
    for (const float axle : {shape_.front_axle_m, shape_.rear_axle_m}) {
      for (const float side : {1.f, -1.f}) AddWheel(axle, side);
    }
    AddDetails();
    return std::move(builder_).Build();
  }

 private:
  float X(float along) const { return shape_.length_m / 2 - along; }

  float Roundness(float along) const { return along > shape_.length_m / 2 ? shape_.rear_round : 1; }

  /// How the body narrows to its ends, seen from above.
  float HalfWidth(float along) const {
    const float from_end = std::min(along, shape_.length_m - along);
    return shape_.width_m / 2 *
           (1 - Roundness(along) *
                    Along({{0, 0.16f}, {0.12f, 0.1f}, {0.35f, 0.04f}, {0.8f, 0}}, from_end));
  }

  /// The sill, or the edge of a wheel arch.
  float LowerEdge(float along) const {
    const float arch_radius = shape_.wheel_radius_m + 0.06f;
    for (const float axle : {shape_.front_axle_m, shape_.rear_axle_m}) {
      const float share = (along - axle) / (1.03f * arch_radius);
      if (std::abs(share) >= 1) continue;
      const float top = shape_.wheel_radius_m + arch_radius - 0.02f;
      return shape_.sill_m + (top - shape_.sill_m) * std::sqrt(1 - share * share);
    }
    return shape_.sill_m;
  }

  /// On the left side; `along` is where the level would be on a body with upright ends.
  Vector3f SidePoint(float along, Level level) const {
    constexpr std::array<float, kLevels> kWidth = {0.95f, 0.985f, 1, 0.975f, 0.91f};
    // How far the ends lean back from the bumper at each level.
    constexpr std::array<float, kLevels> kLean = {0.06f, 0, 0.03f, 0.09f, 0.15f};
    const float deck = Along(shape_.deck, along), low = LowerEdge(along);
    const std::array<float, kLevels> heights = {
        low, shape_.sill_m + 0.2f, shape_.sill_m + 0.2f + 0.45f * (deck - shape_.sill_m - 0.2f),
        deck - 0.08f, deck};
    const float height =
        std::max(heights[level], std::min(low + 0.025f * static_cast<float>(level), deck));
    const float middle = shape_.length_m / 2;
    const float lean = kLean[level] * (middle - along) / middle * Roundness(along);
    return {X(along) - lean - Recess(along, 1), HalfWidth(along) * kWidth[level], height};
  }

  Vector3f OnDeck(float along, float share) const {
    const Vector3f edge = SidePoint(along, kDeckEdge);
    return {edge.x() + Recess(along, 1) - Recess(along, share), share * edge.y(),
            edge.z() + 0.035f * (1 - share * share)};
  }

  /// How far the ends are arched back from their middle; next to nothing at the wheels.
  float Recess(float along, float share) const {
    const float middle = shape_.length_m / 2, to_end = (middle - along) / middle;
    return 0.13f * Roundness(along) * std::pow(to_end, 4.f) *
           (to_end > 0 ? share * share : -share * share);
  }

  std::vector<float> Stations() const {
    std::vector<float> stations = {
        0, 0.12f, 0.35f, shape_.length_m - 0.35f, shape_.length_m - 0.12f, shape_.length_m};
    for (const float axle : {shape_.front_axle_m, shape_.rear_axle_m}) {
      const float radius = 1.03f * (shape_.wheel_radius_m + 0.06f);
      for (const float share : {-1.f, -0.92f, -0.7f, -0.35f, 0.f, 0.35f, 0.7f, 0.92f, 1.f}) {
        stations.push_back(axle + share * radius);
      }
    }
    for (const Vector2f& knot : shape_.deck) stations.push_back(knot.x());
    std::sort(stations.begin(), stations.end());
    const auto near = [](float a, float b) { return b - a < 0.03f; };
    stations.erase(std::unique(stations.begin(), stations.end(), near), stations.end());
    stations.back() = shape_.length_m;
    return stations;
  }

  static constexpr std::array<float, 5> kColumns = {-1, -0.7f, 0, 0.7f, 1};

  void AddSides() {
    const std::vector<float> stations = Stations();
    std::vector<Points3> rings;
    for (const float along : stations) {
      Points3& ring = rings.emplace_back();
      for (int level = 0; level < kLevels; ++level) {
        ring.push_back(
            SidePoint(along, static_cast<Level>(level)).cwiseProduct(Vector3f(1, -1, 1)));
      }
      for (const float share : {-0.7f, 0.f, 0.7f}) ring.push_back(OnDeck(along, share));
      for (int level = kLevels; level-- > 0;)
        ring.push_back(SidePoint(along, static_cast<Level>(level)));
    }
    const size_t sides = rings.front().size() - 1;
    builder_.Loft(rings, /*closed=*/false, [&](size_t station, size_t side) {
      const size_t level = std::min(side, sides - 1 - side);
      const float from = stations[station], to = stations[station + 1];
      if (level >= kDeckEdge) {  // nothing of the deck is seen below the greenhouse
        const bool covered = from > shape_.cowl_m + 0.05f && to < shape_.rear_base_m - 0.05f;
        return covered ? kNoSurface : paint_;
      }
      if (level == kCrease && to <= 0.36f) return head_light_;
      if (level == kCrease && from >= shape_.length_m - 0.13f) return tail_light_;
      if (level == kSill && shape_.dark_bumpers != CarShape::kPainted) return dark_;
      return paint_;
    });
  }

  Points3 EndRow(bool front, Level level) const {
    const float along = front ? 0 : shape_.length_m;
    const Vector3f edge = SidePoint(along, level);
    Points3 row;
    for (const float share : kColumns) {
      const float crown = level == kDeckEdge ? 0.035f * (1 - share * share) : 0;
      row.emplace_back(edge.x() + Recess(along, 1) - Recess(along, share),
                       (front ? share : -share) * edge.y(), edge.z() + crown);
    }
    return row;
  }

  void AddEnd(bool front) {
    std::vector<Points3> rows;
    for (int level = 0; level < kLevels; ++level) {
      rows.push_back(EndRow(front, static_cast<Level>(level)));
    }
    builder_.Loft(rows, /*closed=*/false, [&](size_t level, size_t column) {
      const bool outer = column == 0 || column == 3;
      if (level == kCrease && outer) return front ? head_light_ : tail_light_;
      if (front && !outer && level == kCrease) return dark_;  // the grille
      if (level == kSill && (!outer || shape_.dark_bumpers != CarShape::kPainted)) return dark_;
      if (level == kLower && shape_.dark_bumpers == CarShape::kHigh) return dark_;
      return paint_;
    });
    const Vector3f low = rows[kLower][2], crease = rows[kCrease][2], shoulder = rows[kShoulder][2];
    const Vector3f plate =
        front ? Vector3f(0.5f * (low + crease)) : Vector3f(0.5f * (crease + shoulder));
    const Vector3f lower = front ? low : crease, upper = front ? crease : shoulder;
    AddNumberPlate(plate, (upper - lower).normalized(), front);
    if (front) AddSlats(crease, shoulder);
  }

  void AddNumberPlate(const Vector3f& centre, const Vector3f& up, bool front) {
    const Vector3f right = front ? Vector3f::UnitY() : Vector3f(-Vector3f::UnitY());
    const Vector3f out = 0.015f * right.cross(up);
    const Vector3f across = 0.26f * right, rise = 0.055f * up;
    const SurfaceIdx face = builder_.Use({Pattern::kSign, 0.75f, 1, 0.03f, kCar});
    const Points3 corners = {centre - across - rise + out, centre + across - rise + out,
                             centre + across + rise + out, centre - across + rise + out};
    // Characters of 7 cm: the pattern's smallest, shrunk.
    constexpr float kShrink = 2.5f;
    const uint32_t first = builder_.AddVertex(corners[0], {0, 0});
    builder_.AddVertex(corners[1], {0.52f * kShrink, 0});
    builder_.AddVertex(corners[2], {0.52f * kShrink, 0.11f * kShrink});
    builder_.AddVertex(corners[3], {0, 0.11f * kShrink});
    builder_.AddTriangle(first, first + 1, first + 2, face);
    builder_.AddTriangle(first, first + 2, first + 3, face);
  }

  /// Of the grille, before the dark.
  void AddSlats(const Vector3f& low, const Vector3f& high) {
    for (const float share : {0.25f, 0.6f}) {
      const Vector3f at = low + share * (high - low);
      AddBar(builder_, at + Vector3f(0, -0.4f, 0), at + Vector3f(0, 0.4f, 0), 0.02f, 0.022f,
             metal_);
    }
  }

  /// An upright line of the greenhouse: where it stands on the deck and where it meets the roof.
  struct Post {
    Vector3f base, top;
    bool glass_behind;  ///< between it and the next, counter-clockwise seen from above
  };

  float RoofHeight(float along) const {
    const float middle = 0.45f * shape_.roof_front_m + 0.55f * shape_.roof_rear_m;
    const float share = (along - middle) / (shape_.roof_rear_m - middle);
    return shape_.height_m - 0.045f - 0.05f * share * share;
  }

  Post MakePost(float base_along, float top_along, float share, bool glass_behind) const {
    const float forward = share == 0 ? (base_along < shape_.length_m / 2 ? 0.12f : -0.06f) : 0;
    Vector3f base = OnDeck(base_along - forward, share);
    if (std::abs(share) > 0.99f) base.y() *= 0.985f;
    // The roof's ends are arched as the deck is, a little less.
    const float arch =
        share == 0 ? 0.8f * (base.x() - OnDeck(base_along, 1).x()) - 0.7f * forward : 0;
    const Vector3f top(X(top_along) + arch, share * shape_.roof_half_width_m,
                       RoofHeight(top_along) + (share == 0 ? 0.03f : 0));
    return {base - Vector3f(0, 0, 0.02f), top, glass_behind};
  }

  /// Of the left side, from the windscreen's middle to that of the rear window.
  std::vector<Post> LeftPosts() const {
    const CarShape& s = shape_;
    const auto top_of = [&](float base) {
      const float share = (base - s.cowl_m) / (s.rear_base_m - s.cowl_m);
      return s.roof_front_m + share * (s.roof_rear_m - s.roof_front_m);
    };
    std::vector<Post> posts = {MakePost(s.cowl_m, s.roof_front_m, 0, true),
                               MakePost(s.cowl_m, s.roof_front_m, 0.93f, false)};
    for (const Vector2f& window : s.windows) {
      // Pillars lean with the windscreen in front and stand upright behind.
      posts.push_back(MakePost(window.x(), top_of(window.x()), 1, true));
      posts.push_back(MakePost(window.y(), top_of(window.y()), 1, false));
    }
    if (s.windows.back().y() < s.rear_base_m - 0.3f) {
      posts.push_back(MakePost(s.rear_base_m - 0.12f, s.roof_rear_m - 0.1f, 1, false));
    }
    posts.push_back(MakePost(s.rear_base_m, s.roof_rear_m, 0.9f, s.rear_glass));
    posts.push_back(MakePost(s.rear_base_m, s.roof_rear_m, 0, s.rear_glass));
    return posts;
  }

  void AddGreenhouse() {
    const std::vector<Post> left = LeftPosts();
    std::vector<Post> around = left;
    for (size_t i = left.size() - 1; i-- > 1;) {
      Post post = left[i];
      post.base.y() *= -1;
      post.top.y() *= -1;
      post.glass_behind = left[i - 1].glass_behind;
      around.push_back(post);
    }
    std::vector<Points3> rings;
    for (const float share : {0.f, 0.07f, 0.5f, 0.9f, 1.f}) {
      Points3& ring = rings.emplace_back();
      for (const Post& post : around) {
        const float barrel = 0.025f * 4 * share * (1 - share);
        Vector3f p = post.base + share * (post.top - post.base);
        p.y() *= 1 + barrel;
        ring.push_back(p);
      }
    }
    builder_.Loft(rings, /*closed=*/true, [&](size_t ring, size_t side) {
      const bool pane = around[side].glass_behind;
      if (ring == 1 || ring == 2)
        return pane ? glass_ : IsMiddlePillar(around[side]) ? dark_ : paint_;
      return ring == 0 && pane ? dark_ : paint_;
    });
    AddRoof(left);
  }

  bool IsMiddlePillar(const Post& post) const {
    const float along = shape_.length_m / 2 - post.base.x();
    return shape_.windows.size() > 1 && along > shape_.windows.front().x() + 0.2f &&
           along < shape_.windows[1].x() + 0.05f && std::abs(post.base.y()) > 0.1f;
  }

  void AddRoof(const std::vector<Post>& left) {
    std::vector<Points3> rows;
    for (size_t i = 1; i + 1 < left.size(); ++i) {
      const Vector3f& edge = left[i].top;
      Vector3f middle(edge.x(), 0, edge.z() + 0.045f);
      if (i == 1) middle = left.front().top;
      if (i + 2 == left.size()) middle = left.back().top;
      rows.push_back({edge.cwiseProduct(Vector3f(1, -1, 1)),
                      {middle.x(), -0.55f * edge.y(), 0.35f * edge.z() + 0.65f * middle.z()},
                      middle,
                      {middle.x(), 0.55f * edge.y(), 0.35f * edge.z() + 0.65f * middle.z()},
                      edge});
    }
    builder_.Loft(rows, /*closed=*/false, paint_);
  }

  void AddUnderbody() {
    const float inner = shape_.width_m / 2 - 0.28f;
    builder_.Box({-shape_.length_m / 2 + 0.2f, -inner, shape_.sill_m - 0.02f},
                 {shape_.length_m / 2 - 0.2f, inner, 0.62f * shape_.deck.front().y() + 0.1f},
                 dark_);
    const float outer = 0.94f * shape_.width_m / 2, radius = shape_.wheel_radius_m + 0.1f;
    const float from = shape_.front_axle_m + radius, to = shape_.rear_axle_m - radius;
    builder_.Box({X(to), -outer, shape_.sill_m - 0.01f}, {X(from), outer, shape_.sill_m + 0.03f},
                 dark_);
  }

  void AddWheel(float axle, float side) {
    const float radius = shape_.wheel_radius_m, outer = shape_.width_m / 2 - 0.02f;
    const SurfaceIdx rubber = builder_.Use({Pattern::kRubber, 0.04f, 1, 0, kCar});
    // Turned so that the lathe's axis points out of the car.
    builder_.SetFrame(FrameAt({X(axle), side * (outer - 0.2f), radius}, 0, 0,
                              -side * static_cast<float>(M_PI / 2)));
    constexpr int kSides = 14;
    builder_.Lathe({{radius, 0},
                    {radius, 0.17f},
                    {0.94f * radius, 0.2f},
                    {0.68f * radius, 0.2f},
                    {0.64f * radius, 0.17f}},
                   kSides, rubber);
    builder_.Lathe({{0.64f * radius, 0.17f}, {0, 0.185f}}, kSides, metal_);
    constexpr int kHoles = 5;
    for (int i = 0; i < kHoles; ++i) {
      const float angle = 2 * static_cast<float>(M_PI) * (static_cast<float>(i) + 0.3f) / kHoles;
      const auto at = [&](float share, float turn) {
        return Vector3f(share * radius * std::cos(angle + turn),
                        share * radius * std::sin(angle + turn), 0.188f);
      };
      builder_.Quad(at(0.24f, -0.3f), at(0.58f, -0.38f), at(0.58f, 0.38f), at(0.24f, 0.3f), dark_);
    }
    builder_.SetFrame(Eigen::Affine3f::Identity());
  }

  /// A dark line on both sides, between two points given as (along, level).
  void AddSeam(Vector2f from, Vector2f to, float width_m) {
    const Vector2f direction = (to - from).normalized();
    const Vector2f across = width_m / 2 * Vector2f(std::abs(direction.y()) > 0.5f ? 1 : 0, 0);
    for (const float side : {1.f, -1.f}) {
      const auto at = [&](const Vector2f& p) -> Vector3f {
        const int level = std::min(static_cast<int>(p.y()), kDeckEdge - 1);
        const Vector3f a = SidePoint(p.x(), static_cast<Level>(level));
        const Vector3f b = SidePoint(p.x(), static_cast<Level>(level + 1));
        const Vector3f on =
            a + (p.y() - static_cast<float>(level)) * (b - a) + Vector3f(0, 0.004f, 0);
        return on.cwiseProduct(Vector3f(1, side, 1));
      };
      const Vector2f left = from + side * across, right = from - side * across;
      builder_.Quad(at(right), at(left), at(left + (to - from)), at(right + (to - from)), seam_);
    }
  }

  void AddDoor(float from, float to) {
    for (const float along : {from, to}) {
      for (int level = kSill; level < kDeckEdge; ++level) {
        AddSeam({along, static_cast<float>(level)}, {along, static_cast<float>(level + 1)}, 0.018f);
      }
    }
    const Vector3f handle = SidePoint(to - 0.18f, kShoulder);
    for (const float side : {1.f, -1.f}) {
      const float y = side * handle.y();
      builder_.Box({handle.x() - 0.09f, std::min(y, y - side * 0.03f), handle.z() - 0.05f},
                   {handle.x() + 0.09f, std::max(y, y + side * 0.025f), handle.z() - 0.02f}, dark_);
    }
  }

  void AddDetails() {
    for (const Vector2f& window : shape_.windows) {
      // Rear doors end before the wheel, front doors behind theirs.
      const float arch = shape_.wheel_radius_m + 0.1f;
      const float from = std::max(window.x() - 0.06f, shape_.front_axle_m + arch);
      const float to = std::min(window.y() + 0.06f, shape_.rear_axle_m - 0.55f * arch);
      if (to - from > 0.4f) AddDoor(from, to);
    }
    const Vector3f mirror = SidePoint(shape_.windows.front().x() + 0.12f, kDeckEdge);
    for (const float side : {1.f, -1.f}) {
      builder_.SetFrame(
          FrameAt({mirror.x(), side * (mirror.y() + 0.1f), mirror.z() + 0.1f}, side * 0.25f));
      builder_.Box({-0.06f, -0.11f, -0.07f}, {0.07f, 0.11f, 0.08f}, paint_);
      builder_.Quad({-0.063f, 0.1f, -0.06f}, {-0.063f, -0.1f, -0.06f}, {-0.063f, -0.1f, 0.07f},
                    {-0.063f, 0.1f, 0.07f}, glass_);
      builder_.SetFrame(Eigen::Affine3f::Identity());
    }
    if (shape_.roof_rails) {
      for (const float side : {1.f, -1.f}) {
        const float y = side * (shape_.roof_half_width_m - 0.08f);
        const float z = shape_.height_m - 0.02f;
        AddBar(builder_, {X(shape_.roof_front_m + 0.25f), y, z},
               {X(shape_.roof_rear_m - 0.2f), y, z}, 0.035f, 0.035f, metal_);
      }
    }
  }

  const CarShape& shape_;
  MeshBuilder builder_;
  SurfaceIdx paint_, seam_, dark_, glass_, head_light_, tail_light_, metal_;
};

/// Paint of one variant after the other: black, silver, white, dark blue or green, red, grey.
float PaintOf(uint32_t variant) {
  return std::array{0.05f, 0.42f, 0.75f, 0.09f, 0.16f, 0.25f}[variant % 6];
}

Mesh Hatchback(uint32_t variant) {
  CarShape shape = {
      4.0f,  1.74f,
      1.46f, 0.8f,
      3.28f, 0.31f,
      0.2f,  {{0, 0.7f}, {0.45f, 0.83f}, {0.95f, 0.93f}, {3.75f, 1.0f}, {4.0f, 0.98f}},
      1.0f,  1.78f,
      3.4f,  3.82f,
      0.57f, {{1.22f, 2.12f}, {2.22f, 3.1f}}};
  if (variant % 2 == 1) {  // older, with a plain nose and dark bumpers
    shape.deck = {{0, 0.68f}, {0.3f, 0.78f}, {1.05f, 0.9f}, {3.8f, 0.94f}, {4.0f, 0.92f}};
    shape.height_m = 1.41f;
    shape.cowl_m = 1.15f, shape.roof_front_m = 1.85f, shape.roof_rear_m = 3.5f;
    shape.windows = {{1.36f, 2.35f}, {2.47f, 3.35f}};
    shape.dark_bumpers = CarShape::kHigh;
  }
  return CarBody(shape, PaintOf(variant)).Build();
}

Mesh Saloon(uint32_t variant) {
  CarShape shape = {
      4.65f, 1.8f,
      1.45f, 0.85f,
      3.6f,  0.32f,
      0.19f, {{0, 0.68f}, {0.5f, 0.8f}, {1.2f, 0.93f}, {3.6f, 1.0f}, {4.2f, 1.03f}, {4.65f, 0.98f}},
      1.25f, 2.05f,
      3.25f, 3.95f,
      0.57f, {{1.5f, 2.42f}, {2.52f, 3.35f}}};
  if (variant % 2 == 1) shape.cowl_m = 1.35f, shape.roof_rear_m = 3.35f, shape.height_m = 1.42f;
  return CarBody(shape, PaintOf(variant + 1)).Build();
}

Mesh Estate(uint32_t variant) {
  CarShape shape = {
      4.6f,  1.78f,
      1.5f,  0.85f,
      3.55f, 0.32f,
      0.2f,  {{0, 0.68f}, {0.5f, 0.8f}, {1.15f, 0.93f}, {4.35f, 0.98f}, {4.6f, 0.96f}},
      1.2f,  1.98f,
      4.05f, 4.42f,
      0.58f, {{1.43f, 2.35f}, {2.45f, 3.3f}, {3.42f, 4.12f}}};
  shape.roof_rails = true;
  if (variant % 2 == 1) shape.dark_bumpers = CarShape::kLow;
  return CarBody(shape, PaintOf(variant + 3)).Build();
}

Mesh Suv(uint32_t variant) {
  CarShape shape = {4.5f,  1.85f,
                    1.7f,  0.85f,
                    3.5f,  0.36f,
                    0.27f, {{0, 0.88f}, {0.35f, 1.0f}, {1.1f, 1.1f}, {4.3f, 1.14f}, {4.5f, 1.1f}},
                    1.15f, 1.8f,
                    3.85f, 4.3f,
                    0.62f, {{1.36f, 2.28f}, {2.38f, 3.2f}, {3.32f, 3.95f}}};
  shape.roof_rails = variant % 2 == 0;
  shape.dark_bumpers = CarShape::kLow;
  return CarBody(shape, PaintOf(variant + 2)).Build();
}

Mesh Van(uint32_t variant) {
  CarShape shape = {5.5f,  2.0f,
                    2.4f,  0.95f,
                    4.3f,  0.34f,
                    0.24f, {{0, 0.85f}, {0.35f, 1.05f}, {0.85f, 1.2f}, {5.4f, 1.22f}, {5.5f, 1.2f}},
                    0.8f,  1.6f,
                    5.4f,  5.42f,
                    0.86f, {{1.15f, 2.0f}}};
  shape.rear_glass = false;
  shape.rear_round = 0.15f;
  if (variant % 2 == 1) {  // for passengers
    shape.windows = {{1.15f, 2.0f}, {2.12f, 3.3f}, {3.42f, 4.4f}, {4.5f, 5.2f}};
    shape.rear_glass = true;
    shape.height_m = 2.05f;
    shape.length_m = 5.2f;
    shape.deck = {{0, 0.85f}, {0.35f, 1.05f}, {0.85f, 1.2f}, {5.1f, 1.22f}, {5.2f, 1.2f}};
    shape.windows.back().y() = 4.95f;
    shape.roof_rear_m = 5.0f, shape.rear_base_m = 5.1f;
  }
  shape.dark_bumpers = CarShape::kLow;
  return CarBody(shape, PaintOf(variant + 2)).Build();
}

constexpr ModelKind kKinds[] = {
    {"hatchback", 6, Hatchback},
    {"saloon", 6, Saloon},
    {"estate", 6, Estate},
    {"suv", 4, Suv},
    {"van", 4, Van},
};

}  // namespace

std::span<const ModelKind> CarKinds() { return kKinds; }

}  // namespace carmap
