#include "carmap/solve/block_system.h"

#include <Eigen/Cholesky>
#include <Eigen/OrderingMethods>
#include <Eigen/SparseCore>
#include <algorithm>
#include <limits>
#include <numeric>
#include <utility>

namespace carmap {
namespace {

constexpr uint32_t kNone = std::numeric_limits<uint32_t>::max();

/// Block that is eliminated n-th. Minimum degree; of a dense system the order does not matter.
std::vector<uint32_t> EliminationOrder(const BlockPattern& pattern) {
  const uint32_t count = pattern.block_count();
  std::vector<Eigen::Triplet<int>> links;
  for (uint32_t row = 0; row < count; ++row) {
    for (uint32_t column = 0; column <= row; ++column) {
      if (row == column || pattern.Has(row, column)) {
        links.emplace_back(static_cast<int>(row), static_cast<int>(column), 1);
      }
    }
  }
  std::vector<uint32_t> order(count);
  std::iota(order.begin(), order.end(), 0u);
  if (links.size() == static_cast<size_t>(count) * (count + 1) / 2) return order;
  Eigen::SparseMatrix<int> graph(count, count);
  graph.setFromTriplets(links.begin(), links.end());
  Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int> permutation;
  Eigen::AMDOrdering<int>()(graph.selfadjointView<Eigen::Lower>(), permutation);
  for (uint32_t n = 0; n < count; ++n) order[n] = permutation.indices()[n];
  return order;
}

/// target -= a * b^T, a column at a time in registers.
void SubtractProduct(const Matrix6d& a, const Matrix6d& b, Matrix6d& target) {
  for (int c = 0; c < 6; ++c) {
    Vector6d sum = target.col(c);
    for (int k = 0; k < 6; ++k) sum -= a.col(k) * b(c, k);
    target.col(c) = sum;
  }
}

}  // namespace

BlockPattern::BlockPattern(uint32_t block_count)
    : block_count_(block_count), is_set_(static_cast<size_t>(block_count) * block_count, false) {}

void BlockPattern::Add(uint32_t row, uint32_t column) {
  if (row < column) std::swap(row, column);
  is_set_[static_cast<size_t>(row) * block_count_ + column] = true;
}

BlockSystem::BlockSystem(const BlockPattern& pattern) : order_(EliminationOrder(pattern)) {
  const uint32_t count = pattern.block_count();
  std::vector<uint32_t> place_of(count);  // in the order
  for (uint32_t n = 0; n < count; ++n) place_of[order_[n]] = n;
  entries_of_.resize(count);
  uint32_t slot_count = 0;
  for (uint32_t row = 0; row < count; ++row) {
    uint32_t first = 0;
    while (first < row && !pattern.Has(row, first)) ++first;
    row_first_.push_back(first);
    row_begin_.push_back(slots_.size());
    for (uint32_t column = first; column <= row; ++column) {
      const bool is_present = column == row || pattern.Has(row, column);
      slots_.push_back(is_present ? slot_count++ : kNone);
      if (!is_present) continue;
      const uint32_t a = place_of[row], b = place_of[column];
      entries_of_[std::min(a, b)].push_back({std::max(a, b), slots_.back(), a < b});
    }
  }
  blocks_.resize(slot_count);
  SetZero();
  Analyze();
}

void BlockSystem::SetZero() { std::fill(blocks_.begin(), blocks_.end(), Matrix6d::Zero()); }

/// Rows of a column of the factor: those of the matrix and those of the columns that it is the
/// first to take over from.
void BlockSystem::Analyze() {
  const uint32_t count = block_count();
  std::vector<std::vector<uint32_t>> children(count);
  std::vector<uint32_t> seen_by(count, kNone);
  factor_begin_.assign(1, 0);
  factor_rows_.clear();
  for (uint32_t column = 0; column < count; ++column) {
    const auto add = [&](uint32_t row) {
      if (row < column || seen_by[row] == column) return;
      seen_by[row] = column;
      factor_rows_.push_back(row);
    };
    for (const Entry& entry : entries_of_[column]) add(entry.row);
    for (const uint32_t child : children[column]) {
      for (size_t i = factor_begin_[child]; i < factor_begin_[child + 1]; ++i) add(factor_rows_[i]);
    }
    const auto begin = factor_rows_.begin() + static_cast<std::ptrdiff_t>(factor_begin_[column]);
    std::sort(begin, factor_rows_.end());
    if (factor_rows_.end() - begin > 1) children[*(begin + 1)].push_back(column);
    factor_begin_.push_back(factor_rows_.size());
  }
  factor_.resize(factor_rows_.size());
}

/// The matrix's column into `work`, which is by row; zero where only the factor has a block.
void BlockSystem::LoadColumn(uint32_t column, std::vector<Matrix6d>& work) const {
  for (size_t i = factor_begin_[column]; i < factor_begin_[column + 1]; ++i) {
    work[factor_rows_[i]].setZero();
  }
  for (const auto& [row, slot, is_transposed] : entries_of_[column]) {
    if (is_transposed) {
      work[row] = blocks_[slot].transpose();
    } else {
      work[row] = blocks_[slot];
    }
  }
}

/// Left-looking: each column is updated by all earlier ones that reach it, then divided by its
/// diagonal.
bool BlockSystem::Factorize() {
  const uint32_t count = block_count();
  std::vector<Matrix6d> work(count);
  // Columns whose next row is this one, as linked lists, and where in these columns that row is.
  std::vector<uint32_t> first_at(count, kNone), next_at_same(count, kNone);
  std::vector<size_t> next_of(count, 0);
  const auto hand_on = [&](uint32_t column, size_t i) {
    if (i == factor_begin_[column + 1]) return;
    next_of[column] = i;
    next_at_same[column] = first_at[factor_rows_[i]];
    first_at[factor_rows_[i]] = column;
  };
  for (uint32_t column = 0; column < count; ++column) {
    LoadColumn(column, work);
    for (uint32_t k = first_at[column]; k != kNone;) {
      const uint32_t following = next_at_same[k];
      const size_t begin = next_of[k];
      for (size_t i = begin; i < factor_begin_[k + 1]; ++i) {
        SubtractProduct(factor_[i], factor_[begin], work[factor_rows_[i]]);
      }
      hand_on(k, begin + 1);
      k = following;
    }
    const Eigen::LLT<Matrix6d> cholesky(work[column]);
    if (cholesky.info() != Eigen::Success) return false;
    const Matrix6d lower = cholesky.matrixL();
    const Matrix6d inverse_transposed =
        lower.triangularView<Eigen::Lower>().solve(Matrix6d::Identity()).transpose();
    const size_t diagonal = factor_begin_[column];
    factor_[diagonal] = lower;
    for (size_t i = diagonal + 1; i < factor_begin_[column + 1]; ++i) {
      factor_[i] = work[factor_rows_[i]].lazyProduct(inverse_transposed);
    }
    hand_on(column, diagonal + 1);
  }
  return true;
}

bool BlockSystem::Solve(Eigen::VectorXd& x) {
  if (!Factorize()) return false;
  const uint32_t count = block_count();
  std::vector<Vector6d> y(count);
  for (uint32_t n = 0; n < count; ++n)
    y[n] = x.segment<6>(6 * static_cast<Eigen::Index>(order_[n]));
  for (uint32_t column = 0; column < count; ++column) {
    const size_t diagonal = factor_begin_[column];
    factor_[diagonal].triangularView<Eigen::Lower>().solveInPlace(y[column]);
    for (size_t i = diagonal + 1; i < factor_begin_[column + 1]; ++i) {
      y[factor_rows_[i]] -= factor_[i].lazyProduct(y[column]);
    }
  }
  for (uint32_t column = count; column-- > 0;) {
    const size_t diagonal = factor_begin_[column];
    for (size_t i = diagonal + 1; i < factor_begin_[column + 1]; ++i) {
      y[column] -= factor_[i].transpose().lazyProduct(y[factor_rows_[i]]);
    }
    factor_[diagonal].transpose().triangularView<Eigen::Upper>().solveInPlace(y[column]);
  }
  for (uint32_t n = 0; n < count; ++n)
    x.segment<6>(6 * static_cast<Eigen::Index>(order_[n])) = y[n];
  return x.allFinite();
}

}  // namespace carmap
