// Trees, bushes, hedges.
//
// A crown is made backwards: first where its clusters of leaves are, then the branches that carry
// them, each cluster joined to the nearest branch there is (as in space colonization, Runions et
// al. 2007), as thick as what they carry (Leonardo's rule, Murray 1927).
#include <algorithm>
#include <array>
#include <cmath>

#include "carmap/sim/models/model_kinds.h"

namespace carmap {
namespace {

using Eigen::Vector3f;

constexpr auto kVegetation = SemanticClass::kVegetation;
constexpr float kTau = 2 * static_cast<float>(M_PI);

float Between(HashSequence& random, double low, double high) {
  return static_cast<float>(random.Between(low, high));
}

SurfaceIdx Leaves(MeshBuilder& b, float albedo) {
  return b.Use({Pattern::kLeaves, albedo, 1, 0.02f, kVegetation});
}

SurfaceIdx Bark(MeshBuilder& b, float albedo) {
  return b.Use({Pattern::kBark, albedo, 1, 0, kVegetation});
}

struct TreeShape {
  float height_m, crown_radius_m, crown_bottom_m;
  float widest;  ///< where the crown is widest: 0 at its bottom, 1 at its top
  int clusters, leaves_per_cluster;
  float cluster_radius_m, leaf_m;
  float bark_albedo, leaf_albedo;
};

struct BranchNode {
  Vector3f position;
  size_t parent;
  float from_root_m;  ///< along the branches
  float radius_m = 0;
};

/// The crown's radius at a share of its height.
float CrownRadius(const TreeShape& shape, float share) {
  const float from_widest = share < shape.widest ? (shape.widest - share) / shape.widest
                                                 : (share - shape.widest) / (1 - shape.widest);
  return shape.crown_radius_m * std::sqrt(std::max(0.f, 1 - from_widest * from_widest));
}

/// Middles of clusters, apart from each other, most of them in the crown's outer half.
std::vector<Vector3f> ScatterClusters(const TreeShape& shape, HashSequence& random) {
  const float crown_m = shape.height_m - shape.crown_bottom_m;
  std::vector<Vector3f> clusters;
  float apart_m = 2.2f * shape.crown_radius_m / std::sqrt(static_cast<float>(shape.clusters));
  while (clusters.size() < static_cast<size_t>(shape.clusters)) {
    const float share = Between(random, 0.04, 0.94), angle = Between(random, 0, kTau);
    const float inside = std::max(0.f, CrownRadius(shape, share) - 0.6f * shape.cluster_radius_m);
    const float radius = inside * std::pow(static_cast<float>(random.Unit()), 0.35f);
    const Vector3f at(radius * std::cos(angle), radius * std::sin(angle),
                      shape.crown_bottom_m + crown_m * share);
    const bool crowded = std::any_of(clusters.begin(), clusters.end(), [&](const Vector3f& other) {
      return (at - other).norm() < apart_m;
    });
    apart_m *= 0.995f;  // so that all find a place
    if (!crowded) clusters.push_back(at);
  }
  return clusters;
}

/// The trunk's nodes, from the earth to most of the height.
std::vector<BranchNode> GrowTrunk(const TreeShape& shape, HashSequence& random) {
  const float top = shape.crown_bottom_m + 0.7f * (shape.height_m - shape.crown_bottom_m);
  constexpr int kSteps = 7;
  std::vector<BranchNode> nodes = {{Vector3f(0, 0, -kFootingM), 0, 0}};
  for (int i = 1; i <= kSteps; ++i) {
    const float z = top * static_cast<float>(i) / kSteps;
    const float lean = 0.02f * shape.height_m * (i > 1 ? 1.f : 0.f);
    const Vector3f at(lean * Between(random, -1, 1), lean * Between(random, -1, 1), z);
    nodes.push_back({at, nodes.size() - 1, z});
  }
  return nodes;
}

/// Joins a cluster to the branches: where the way is short, and not all of it back to the root.
void JoinCluster(const Vector3f& cluster, float crown_bottom_m, std::vector<BranchNode>& nodes,
                 HashSequence& random) {
  size_t best = 0;
  float best_cost = INFINITY;
  for (size_t i = 1; i < nodes.size(); ++i) {
    const Vector3f way = cluster - nodes[i].position;
    if (nodes[i].position.z() < 0.8f * crown_bottom_m) continue;
    // Branches rise; downward ones are for willows.
    const float steepness = std::max(0.f, -way.z()) * 2;
    const float cost = way.norm() + steepness + 0.25f * nodes[i].from_root_m;
    if (cost < best_cost) best_cost = cost, best = i;
  }
  const Vector3f from = nodes[best].position, way = cluster - from;
  const float length = way.norm();
  const Vector3f bend(Between(random, -0.1, 0.1), Between(random, -0.1, 0.1), -0.12f);
  nodes.push_back({from + 0.5f * way + length * bend, best, nodes[best].from_root_m + length / 2});
  nodes.push_back({cluster, nodes.size() - 1, nodes[best].from_root_m + length});
}

/// From the twigs down: cross sections add up.
void ThickenBranches(float twig_radius_m, float flare, std::vector<BranchNode>& nodes) {
  constexpr float kPower = 2.4f;
  std::vector<float> sums(nodes.size(), 0);
  for (size_t i = nodes.size(); i-- > 0;) {
    if (sums[i] == 0) sums[i] = std::pow(twig_radius_m, kPower);
    if (i > 0) sums[nodes[i].parent] += sums[i];
    nodes[i].radius_m = std::pow(sums[i], 1 / kPower);
  }
  nodes[0].radius_m *= flare;
}

void AddBranches(MeshBuilder& b, const std::vector<BranchNode>& nodes, SurfaceIdx bark) {
  for (size_t i = 1; i < nodes.size(); ++i) {
    const BranchNode &node = nodes[i], &parent = nodes[node.parent];
    const bool forks_off = node.parent + 1 != i;
    const float start =
        forks_off ? std::min(parent.radius_m, 1.2f * node.radius_m) : parent.radius_m;
    const int sides = node.radius_m > 0.06f ? 7 : node.radius_m > 0.03f ? 5 : 3;
    b.Tube({parent.position, node.position}, {start, node.radius_m}, sides, bark, false);
  }
}

void AddTree(MeshBuilder& b, const TreeShape& shape, uint64_t seed) {
  HashSequence random(seed);
  std::vector<Vector3f> clusters = ScatterClusters(shape, random);
  const auto from_trunk = [](const Vector3f& p) { return p.head<2>().squaredNorm(); };
  std::sort(clusters.begin(), clusters.end(),
            [&](const Vector3f& p, const Vector3f& q) { return from_trunk(p) < from_trunk(q); });
  std::vector<BranchNode> nodes = GrowTrunk(shape, random);
  for (const Vector3f& cluster : clusters) {
    JoinCluster(cluster, shape.crown_bottom_m, nodes, random);
  }
  ThickenBranches(0.006f + 0.0008f * shape.height_m, 1.25f, nodes);
  AddBranches(b, nodes, Bark(b, shape.bark_albedo));

  const SurfaceIdx leaves = Leaves(b, shape.leaf_albedo),
                   lighter = Leaves(b, 1.25f * shape.leaf_albedo);
  for (const Vector3f& cluster : clusters) {
    const float size = shape.cluster_radius_m * Between(random, 0.75, 1.2);
    const Vector3f radii(size * Between(random, 0.85, 1.15), size * Between(random, 0.85, 1.15),
                         0.7f * size);
    const bool outer =
        cluster.z() > shape.crown_bottom_m + 0.6f * (shape.height_m - shape.crown_bottom_m);
    b.LeafCluster(cluster, radii, shape.leaves_per_cluster, shape.leaf_m, outer ? lighter : leaves,
                  random);
  }
}

Mesh Tree(uint32_t variant) {
  constexpr std::array<TreeShape, 8> kShapes = {{
      {9.5f, 3.2f, 2.6f, 0.4f, 46, 80, 0.9f, 0.23f, 0.16f, 0.15f},     // linden
      {12.0f, 4.0f, 3.2f, 0.5f, 48, 76, 1.15f, 0.29f, 0.2f, 0.14f},    // plane
      {7.5f, 2.4f, 2.3f, 0.5f, 38, 90, 0.72f, 0.19f, 0.14f, 0.13f},    // maple
      {10.5f, 2.3f, 2.2f, 0.45f, 44, 70, 0.7f, 0.18f, 0.45f, 0.19f},   // birch
      {6.0f, 2.6f, 1.9f, 0.45f, 42, 76, 0.68f, 0.17f, 0.15f, 0.17f},   // apple
      {13.5f, 4.4f, 3.0f, 0.55f, 50, 72, 1.25f, 0.31f, 0.13f, 0.12f},  // oak
      {11.0f, 1.9f, 1.6f, 0.4f, 46, 74, 0.66f, 0.2f, 0.15f, 0.13f},    // hornbeam, slender
      {8.5f, 3.0f, 2.5f, 0.6f, 44, 74, 0.85f, 0.21f, 0.17f, 0.22f},    // robinia
  }};
  MeshBuilder b;
  AddTree(b, kShapes[variant], 0x7ee0 + variant);
  return std::move(b).Build();
}

Mesh YoungTree(uint32_t variant) {
  constexpr std::array<TreeShape, 4> kShapes = {{
      {4.6f, 0.95f, 1.9f, 0.4f, 22, 46, 0.4f, 0.14f, 0.2f, 0.2f},
      {5.4f, 1.1f, 2.1f, 0.45f, 26, 46, 0.43f, 0.15f, 0.17f, 0.17f},
      {3.8f, 0.8f, 1.7f, 0.5f, 18, 48, 0.36f, 0.13f, 0.18f, 0.22f},
      {5.0f, 0.8f, 1.8f, 0.35f, 24, 44, 0.36f, 0.14f, 0.4f, 0.18f},
  }};
  MeshBuilder b;
  AddTree(b, kShapes[variant], 0x1077 + variant);
  const SurfaceIdx stake = b.Use({Pattern::kWood, 0.42f, 1, 0, SemanticClass::kPole});
  const int stakes = variant == 2 ? 1 : 3;
  const float top = 1.6f;
  Points3 heads;
  for (int i = 0; i < stakes; ++i) {
    const float angle = kTau * static_cast<float>(i) / static_cast<float>(stakes) + 0.3f;
    const Vector3f out(std::cos(angle), std::sin(angle), 0);
    heads.push_back(0.28f * out + Vector3f(0, 0, top));
    b.Tube({0.45f * out - Vector3f(0, 0, kFootingM), heads.back()}, {0.04f, 0.035f}, 7, stake);
  }
  for (size_t i = 0; stakes > 1 && i < heads.size(); ++i) {
    const Vector3f down(0, 0, 0.08f);
    AddBar(b, heads[i] - down, heads[(i + 1) % heads.size()] - down, 0.03f, 0.07f, stake);
  }
  const SurfaceIdx strap = b.Use({Pattern::kFabric, 0.25f, 1, 0, SemanticClass::kPole});
  for (const Vector3f& head : heads) {
    AddBar(b, head - Vector3f(0, 0, 0.15f), {0, 0, top - 0.15f}, 0.01f, 0.05f, strap);
  }
  return std::move(b).Build();
}

struct ConiferShape {
  float height_m, radius_m, bottom_m;
  int whorls, branches, sprays;
  float droop;  ///< of a branch's end below its start, per length
  float leaf_albedo;
};

/// A branch of needles: sprays to both sides and hanging, shorter towards the tip.
void AddNeedleBranch(MeshBuilder& b, const Vector3f& from, const Vector3f& tip, int sprays,
                     SurfaceIdx needles, SurfaceIdx bark, HashSequence& random) {
  const Vector3f along = tip - from;
  const float length = along.norm();
  b.Tube({from, tip}, {0.012f + 0.008f * length, 0.004f}, 3, bark, false);
  const Vector3f across = along.cross(Vector3f::UnitZ()).normalized();
  for (int i = 0; i < sprays; ++i) {
    const float share =
        (static_cast<float>(i) + Between(random, 0.6, 1.4)) / static_cast<float>(sprays);
    const float side = i % 2 ? 1.f : -1.f;
    const Vector3f stem = from + std::min(share, 1.f) * along;
    const float spray = std::min(0.6f, 0.32f * length) * (1.25f - 0.6f * share) + 0.16f;
    const Vector3f out = (0.8f * along.normalized() + side * Between(random, 0.3, 1) * across +
                          Vector3f(0, 0, Between(random, -0.75, 0.1)))
                             .normalized();
    const Vector3f wide =
        out.cross(Vector3f(Between(random, -0.6, 0.6), Between(random, -0.6, 0.6), 1)).normalized();
    const float half = spray * Between(random, 0.2, 0.34);
    b.Quad(stem, stem + 0.45f * spray * out - half * wide, stem + spray * out,
           stem + 0.55f * spray * out + half * wide, needles,
           {Between(random, 0, 9), Between(random, 0, 9)});
  }
}

void AddSpruce(MeshBuilder& b, const ConiferShape& shape, uint64_t seed) {
  HashSequence random(seed);
  const SurfaceIdx bark = Bark(b, 0.13f);
  const SurfaceIdx inner = Leaves(b, 0.8f * shape.leaf_albedo),
                   outer = Leaves(b, 1.2f * shape.leaf_albedo);
  const float trunk_radius = 0.012f * shape.height_m + 0.02f;
  b.Tube({{0, 0, -kFootingM}, {0, 0, 0.4f * shape.height_m}, {0, 0, 0.98f * shape.height_m}},
         {1.2f * trunk_radius, 0.7f * trunk_radius, 0.01f}, 7, bark, false);
  float turn = 0;
  for (int whorl = 0; whorl < shape.whorls; ++whorl) {
    const float share = static_cast<float>(whorl) / static_cast<float>(shape.whorls);
    const float z = shape.bottom_m + (shape.height_m - shape.bottom_m) * std::pow(share, 0.92f);
    const int branches = std::max(4, shape.branches - static_cast<int>(3 * share));
    turn += 2.4f;
    for (int i = 0; i < branches; ++i) {
      const float angle = turn + kTau * (static_cast<float>(i) + Between(random, -0.3, 0.3)) /
                                     static_cast<float>(branches);
      const float reach = shape.radius_m * (1 - 0.93f * share) * Between(random, 0.75, 1.1);
      const Vector3f from(0, 0, z + Between(random, -0.28, 0.28));
      const float droop = shape.droop * (1 - share) - 0.5f * share + Between(random, -0.2, 0.2);
      Vector3f tip =
          from + Vector3f(reach * std::cos(angle), reach * std::sin(angle), -reach * droop);
      tip.z() = std::max(tip.z(), 0.2f);  // the lowest lie on the ground
      const int sprays =
          std::max(4, static_cast<int>(static_cast<float>(shape.sprays) * (1 - 0.6f * share)));
      AddNeedleBranch(b, from, tip, sprays, i % 2 ? inner : outer, bark, random);
    }
  }
  b.LeafCluster({0, 0, 0.97f * shape.height_m}, {0.08f, 0.08f, 0.03f * shape.height_m}, 24, 0.16f,
                outer, random);
}

/// Dense and narrow, as they stand in gardens and churchyards.
void AddThuja(MeshBuilder& b, float height_m, float radius_m, uint64_t seed) {
  HashSequence random(seed);
  const SurfaceIdx dark = Leaves(b, 0.05f), leaves = Leaves(b, 0.12f);
  b.Tube({{0, 0, -kFootingM}, {0, 0, 0.5f}}, {0.09f, 0.08f}, 6, Bark(b, 0.15f), false);
  const auto radius_at = [&](float share) {
    return radius_m *
           std::pow(std::sin(static_cast<float>(M_PI) * std::pow(0.03f + 0.97f * share, 0.6f)),
                    0.6f);
  };
  std::vector<Eigen::Vector2f> core;
  for (int i = 0; i <= 8; ++i) {
    const float share = static_cast<float>(i) / 8;
    core.emplace_back(i == 0 || i == 8 ? 0.f : 0.75f * radius_at(share),
                      0.15f + 0.93f * (height_m - 0.15f) * share);
  }
  b.Lathe(core, 9, dark);
  for (int i = 0; i < 1300; ++i) {
    const float share = std::pow(static_cast<float>(random.Unit()), 0.9f),
                angle = Between(random, 0, kTau);
    const float radius = radius_at(share) * Between(random, 0.78, 1.05);
    const Vector3f out(std::cos(angle), std::sin(angle), 1.3f);
    const Vector3f stem(radius * std::cos(angle), radius * std::sin(angle),
                        0.1f + (height_m - 0.25f) * share);
    b.Leaf(stem, out.normalized(), 0.2f, leaves, random);
  }
}

Mesh Conifer(uint32_t variant) {
  constexpr std::array<ConiferShape, 3> kShapes = {{
      {11.0f, 2.3f, 0.8f, 21, 8, 16, 0.35f, 0.09f},
      {8.0f, 1.9f, 0.3f, 19, 8, 15, 0.25f, 0.11f},
      {14.0f, 2.7f, 1.6f, 23, 8, 16, 0.4f, 0.08f},
  }};
  MeshBuilder b;
  if (variant < kShapes.size()) {
    AddSpruce(b, kShapes[variant], 0x591c + variant);
  } else if (variant == 3) {
    AddThuja(b, 4.5f, 0.75f, 0x7407);
  } else {  // a pine: a bare trunk below clouds of needles
    AddTree(b, {11.5f, 2.6f, 5.5f, 0.6f, 32, 70, 0.8f, 0.19f, 0.22f, 0.1f}, 0x914e);
  }
  return std::move(b).Build();
}

Mesh Bush(uint32_t variant) {
  struct Shape {
    float radius_m, height_m;
    int clusters, leaves;
    float leaf_m, albedo;
  };
  constexpr std::array<Shape, 5> kShapes = {{{0.8f, 1.3f, 14, 70, 0.11f, 0.15f},
                                             {1.1f, 1.9f, 18, 76, 0.14f, 0.13f},
                                             {0.6f, 0.7f, 10, 66, 0.085f, 0.2f},
                                             {0.95f, 1.1f, 16, 70, 0.1f, 0.11f},
                                             {1.3f, 2.5f, 22, 80, 0.16f, 0.17f}}};
  const Shape& shape = kShapes[variant];
  MeshBuilder b;
  HashSequence random(0xb054, variant);
  const SurfaceIdx leaves = Leaves(b, shape.albedo), lighter = Leaves(b, 1.4f * shape.albedo);
  const SurfaceIdx bark = Bark(b, 0.15f);
  for (int i = 0; i < shape.clusters; ++i) {
    const float angle = 2.4f * static_cast<float>(i);  // the golden angle spreads them
    const float share =
        std::sqrt((static_cast<float>(i) + 0.5f) / static_cast<float>(shape.clusters));
    const float size = shape.radius_m * Between(random, 0.32, 0.5);
    const float radius = share * (shape.radius_m - 0.7f * size);
    const float rise =
        (shape.height_m - 0.8f * size) * (1 - 0.75f * share * share) * Between(random, 0.75, 1);
    const Vector3f at(radius * std::cos(angle), radius * std::sin(angle),
                      std::max(0.75f * size, rise));
    b.Tube({{0.15f * at.x(), 0.15f * at.y(), -kFootingM / 4}, at}, {0.018f, 0.006f}, 3, bark,
           false);
    b.LeafCluster(at, {size, size, 0.85f * size}, shape.leaves, shape.leaf_m,
                  i % 3 ? leaves : lighter, random);
  }
  return std::move(b).Build();
}

/// Cut to a box, 2 m of it: leaves on and in a dark core.
Mesh Hedge(uint32_t variant) {
  const float height_m = std::array{1.2f, 1.8f, 0.8f, 2.2f}[variant];
  const float half = std::array{0.32f, 0.4f, 0.25f, 0.5f}[variant];
  const float albedo = std::array{0.15f, 0.11f, 0.19f, 0.13f}[variant];
  MeshBuilder b;
  HashSequence random(0x4ed6e, variant);
  const SurfaceIdx dark = Leaves(b, 0.5f * albedo), leaves = Leaves(b, albedo),
                   lighter = Leaves(b, 1.4f * albedo);
  const float in = 0.1f;
  b.Box({-1, -half + in, -kFootingM / 4}, {1, half - in, height_m - in}, dark, false);
  // Gentle waves so that no face is a plane; the same at both ends, where the next piece begins.
  const float phase = Between(random, 0, kTau);
  const auto wave = [&](float x, float z) {
    return 0.03f * std::sin(static_cast<float>(M_PI) * x + phase) +
           0.025f * std::sin(5 * z + phase);
  };
  // The two long faces, the top, the ends, as one strip.
  const float ends = 2 * height_m, top = ends + 2 * half, around = top + height_m;
  const int count = static_cast<int>(250 * around);
  for (int i = 0; i < count; ++i) {
    const float x = Between(random, -1, 1), s = Between(random, 0, around);
    Vector3f stem, out;
    if (s < ends) {
      const float side = s < height_m ? 1.f : -1.f, z = s < height_m ? s : s - height_m;
      stem = {x, side * (half - 0.05f + wave(x, z)), 0.03f + 0.95f * z};
      out = {0, side, 0.5f};
    } else if (s < top) {
      stem = {x, s - ends - half, height_m - 0.06f + wave(x, s)};
      out = Vector3f::UnitZ();
    } else {
      stem = {x < 0 ? -0.97f : 0.97f, half * (2 * std::abs(x) - 1), 0.03f + 0.95f * (s - top)};
      out = {x, 0, 0.5f};
    }
    const float depth = Between(random, -0.1, 0.03);
    b.Leaf(stem + depth * out, out.normalized(), 0.14f, i % 4 ? leaves : lighter, random);
  }
  return std::move(b).Build();
}

constexpr ModelKind kKinds[] = {
    {"tree", 8, Tree}, {"young-tree", 4, YoungTree}, {"conifer", 5, Conifer},
    {"bush", 5, Bush}, {"hedge", 4, Hedge},
};

}  // namespace

std::span<const ModelKind> VegetationKinds() { return kKinds; }

}  // namespace carmap
