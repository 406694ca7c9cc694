#include "carmap/index/kd_tree.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <nanoflann.hpp>
#include <utility>

namespace carmap {
namespace {

/// How nanoflann reads the points.
struct Cloud {
  std::vector<Eigen::Vector3d> points;

  size_t kdtree_get_point_count() const { return points.size(); }
  double kdtree_get_pt(uint32_t idx, size_t axis) const { return points[idx][axis]; }
  template <typename Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }
};

using Tree = nanoflann::KDTreeSingleIndexAdaptor<
    nanoflann::L2_Simple_Adaptor<double, Cloud, double, uint32_t>, Cloud, 3, uint32_t>;
using Hit = std::pair<uint32_t, double>;  ///< point and its squared distance

/// Appends the node and all below it; returns its number.
uint32_t AppendNode(const Tree::Node& node, uint32_t& node_count, KdTreeTables& tables) {
  const uint32_t number = node_count++;
  if (node.child1 == nullptr) {
    tables.links.push_back(static_cast<uint32_t>(node.node_type.lr.left));
    tables.links.push_back(static_cast<uint32_t>(node.node_type.lr.right));
    return number;
  }
  const size_t place = tables.links.size();
  tables.links.resize(place + 3);
  tables.splits.push_back(static_cast<float>(node.node_type.sub.divlow));
  tables.splits.push_back(static_cast<float>(node.node_type.sub.divhigh));
  tables.links[place] = static_cast<uint32_t>(node.node_type.sub.divfeat);
  tables.links[place + 1] = AppendNode(*node.child1, node_count, tables);
  tables.links[place + 2] = AppendNode(*node.child2, node_count, tables);
  return number;
}

bool IsNearer(const Hit& a, const Hit& b) {
  return std::pair(a.second, a.first) < std::pair(b.second, b.first);
}

/// The nearest points of a search, as nanoflann fills it; it ends after some leaves of the tree,
/// since points can lie so that the nearest are only found by looking at all.
class NearestHits {
 public:
  NearestHits(double squared_radius, size_t max_count)
      : squared_radius_(squared_radius),
        max_count_(max_count),
        leaves_left_(kLeavesPerHit * max_count) {}

  bool addPoint(double squared_distance, uint32_t idx) {
    if (hits_.size() == max_count_) {
      if (hits_.front().second <= squared_distance) return true;
      std::pop_heap(hits_.begin(), hits_.end(), IsNearer);
      hits_.pop_back();
    }
    hits_.emplace_back(idx, squared_distance);
    std::push_heap(hits_.begin(), hits_.end(), IsNearer);
    return true;
  }
  /// Below it nanoflann looks on. It asks once for each leaf and each branch.
  double worstDist() {
    if (leaves_left_ == 0) return -1;
    --leaves_left_;
    // A branch that begins as far away as the last of enough hits adds nothing.
    return hits_.size() < max_count_ ? squared_radius_ : std::nextafter(hits_.front().second, -1);
  }
  bool full() const { return true; }
  size_t size() const { return hits_.size(); }
  std::vector<Hit> Take() { return std::move(hits_); }

 private:
  static constexpr size_t kLeavesPerHit = 16;

  const double squared_radius_;
  const size_t max_count_;
  size_t leaves_left_;
  std::vector<Hit> hits_;  ///< a heap, the farthest first
};

std::vector<uint32_t> NearestFirst(std::vector<Hit> hits) {
  std::sort(hits.begin(), hits.end(), IsNearer);
  std::vector<uint32_t> idxs;
  idxs.reserve(hits.size());
  for (const Hit& hit : hits) idxs.push_back(hit.first);
  return idxs;
}

/// nanoflann finds what is nearer than the bound; points exactly on it count too.
double SquaredBound(double radius_m) {
  return std::nextafter(radius_m * radius_m, std::numeric_limits<double>::max());
}

}  // namespace

struct KdTree::Impl {
  explicit Impl(std::vector<Eigen::Vector3d> points)
      : cloud{std::move(points)}, tree(3, cloud, nanoflann::KDTreeSingleIndexAdaptorParams(10)) {}

  const Cloud cloud;
  const Tree tree;
};

KdTree::KdTree(std::vector<Eigen::Vector3d> points)
    : impl_(std::make_unique<const Impl>(std::move(points))) {}
KdTree::~KdTree() = default;
KdTree::KdTree(KdTree&&) noexcept = default;
KdTree& KdTree::operator=(KdTree&&) noexcept = default;

const std::vector<Eigen::Vector3d>& KdTree::points() const { return impl_->cloud.points; }

KdTreeTables KdTree::Tables() const {
  KdTreeTables tables;
  tables.links = impl_->tree.vAcc;
  uint32_t node_count = 0;
  if (impl_->tree.root_node != nullptr) AppendNode(*impl_->tree.root_node, node_count, tables);
  return tables;
}

std::vector<uint32_t> KdTree::WithinRadius(const Eigen::Vector3d& center, double radius_m) const {
  if (size() == 0) return {};
  std::vector<Hit> hits;
  impl_->tree.radiusSearch(center.data(), SquaredBound(radius_m), hits,
                           nanoflann::SearchParams(32, 0, false));
  return NearestFirst(std::move(hits));
}

std::vector<uint32_t> KdTree::WithinRadius(const Eigen::Vector3d& center, double radius_m,
                                           size_t max_count) const {
  if (size() == 0 || max_count == 0) return {};
  NearestHits hits(SquaredBound(radius_m), max_count);
  impl_->tree.findNeighbors(hits, center.data(), nanoflann::SearchParams());
  return NearestFirst(hits.Take());
}

std::vector<uint32_t> KdTree::Nearest(const Eigen::Vector3d& center, size_t count) const {
  count = std::min(count, size());
  if (count == 0) return {};
  std::vector<uint32_t> idxs(count);
  std::vector<double> squared_distances(count);
  impl_->tree.knnSearch(center.data(), count, idxs.data(), squared_distances.data());
  std::vector<Hit> hits;
  for (size_t i = 0; i < count; ++i) hits.emplace_back(idxs[i], squared_distances[i]);
  return NearestFirst(std::move(hits));
}

}  // namespace carmap
