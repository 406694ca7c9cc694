// Symmetric positive definite systems of 6 × 6 blocks of which most are zero: the normal equations
// of poses, as pose graphs and bundle adjustment solve them.
//
// Sparse Cholesky factorisation by blocks, columns in an order that keeps the factor sparse
// (minimum degree). Owned by one thread. Deterministic: sums run in an order that the pattern alone
// decides.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "carmap/solve/reprojection.h"

namespace carmap {

/// Which blocks of the lower triangle may differ from zero. The diagonal may.
class BlockPattern {
 public:
  explicit BlockPattern(uint32_t block_count);

  uint32_t block_count() const { return block_count_; }
  /// In either order.
  void Add(uint32_t row, uint32_t column);
  /// Needs row >= column.
  bool Has(uint32_t row, uint32_t column) const {
    return is_set_[static_cast<size_t>(row) * block_count_ + column];
  }

 private:
  uint32_t block_count_;
  std::vector<bool> is_set_;  ///< by row, then column; of the lower triangle
};

class BlockSystem {
 public:
  BlockSystem() : BlockSystem(BlockPattern(0)) {}
  explicit BlockSystem(const BlockPattern& pattern);

  uint32_t block_count() const { return static_cast<uint32_t>(row_first_.size()); }
  void SetZero();
  /// A block of the lower triangle that is in the pattern.
  Matrix6d& Block(uint32_t row, uint32_t column) {
    return blocks_[slots_[row_begin_[row] + column - row_first_[row]]];
  }

  /// Replaces the right side by the solution. False, and `x` undefined, unless the matrix is
  /// positive definite. Of diagonal blocks only the lower triangle counts.
  bool Solve(Eigen::VectorXd& x);

 private:
  void Analyze();
  bool Factorize();
  void LoadColumn(uint32_t column, std::vector<Matrix6d>& work) const;

  // Skyline of slots, so that Block() is one look-up: of each row from its first block on.
  std::vector<uint32_t> row_first_, slots_;
  std::vector<size_t> row_begin_;
  std::vector<Matrix6d> blocks_;

  /// A block of the matrix as the factorisation meets it; transposed if the order turns it over.
  struct Entry {
    uint32_t row, slot;
    bool is_transposed;
  };
  std::vector<uint32_t> order_;                 ///< block of the system that is eliminated n-th
  std::vector<std::vector<Entry>> entries_of_;  ///< by column of the factor
  // The factor, by columns: rows of column c are factor_rows_[factor_begin_[c] ..), ascending, the
  // diagonal first.
  std::vector<size_t> factor_begin_;
  std::vector<uint32_t> factor_rows_;
  std::vector<Matrix6d> factor_;
};

}  // namespace carmap
