// A k-d tree over points in space (paper §3.2): what lies near a place.
//
// Immutable once built, thread-safe. Rebuilt wherever it is needed, never stored (§3.5).
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

namespace carmap {

/// A tree as plain numbers, the form in which a file that stored it would have it.
struct KdTreeTables {
  /// First the points in the order of the leaves. Then the nodes, parents before children: of a
  /// leaf where its points begin and end, of any other its axis and its two children.
  std::vector<uint32_t> links;
  std::vector<float> splits;  ///< two of each node that is no leaf: where its children's spaces end
};

class KdTree {
 public:
  /// Coordinates must be finite.
  explicit KdTree(std::vector<Eigen::Vector3d> points = {});
  ~KdTree();
  KdTree(KdTree&&) noexcept;
  KdTree& operator=(KdTree&&) noexcept;

  const std::vector<Eigen::Vector3d>& points() const;
  size_t size() const { return points().size(); }

  /// Indices of the points at most radius_m away, nearest first, of equally near ones the lower.
  std::vector<uint32_t> WithinRadius(const Eigen::Vector3d& center, double radius_m) const;
  /// Of these the `max_count` nearest, in a time that does not grow with how many there are: of
  /// more that are equally near, or too near to being so, it is not said which come.
  std::vector<uint32_t> WithinRadius(const Eigen::Vector3d& center, double radius_m,
                                     size_t max_count) const;
  /// Indices of the `count` nearest points, or of all if there are fewer, in the same order.
  std::vector<uint32_t> Nearest(const Eigen::Vector3d& center, size_t count) const;

  /// For measuring what the tree would take in a file (§5.4).
  KdTreeTables Tables() const;

 private:
  struct Impl;
  std::unique_ptr<const Impl> impl_;
};

}  // namespace carmap
