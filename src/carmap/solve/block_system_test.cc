#include "carmap/solve/block_system.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <utility>

#include "carmap/solve/test_scene.h"

namespace carmap {
namespace {

/// A system whose blocks are random within the pattern, and the same as one dense matrix.
struct RandomSystem {
  RandomSystem(const BlockPattern& pattern, TestRandom& random) : system(pattern) {
    const uint32_t count = pattern.block_count();
    dense.setZero(6 * count, 6 * count);
    rhs.resize(6 * count);
    for (Eigen::Index i = 0; i < rhs.size(); ++i) rhs[i] = random.Uniform(-1, 1);
    for (uint32_t row = 0; row < count; ++row) {
      for (uint32_t column = 0; column <= row; ++column) {
        if (row != column && !pattern.Has(row, column)) continue;
        Matrix6d& block = system.Block(row, column);
        for (int i = 0; i < 36; ++i) block.data()[i] = random.Uniform(-1, 1);
        if (row == column) {
          block = (block + block.transpose()).eval();
          block.diagonal().array() += 6.0 * count;
        }
        dense.block<6, 6>(6 * row, 6 * column) = block;
        dense.block<6, 6>(6 * column, 6 * row) = block.transpose();
      }
    }
  }

  double Error() {
    Eigen::VectorXd x = rhs;
    EXPECT_TRUE(system.Solve(x));
    return (x - dense.llt().solve(rhs)).norm();
  }

  BlockSystem system;
  Eigen::MatrixXd dense;
  Eigen::VectorXd rhs;
};

TEST(BlockSystemTest, SolvesLikeADenseSolver) {
  TestRandom random(1);
  for (const double share : {0.0, 0.05, 0.2, 1.0}) {
    for (const uint32_t count : {1u, 2u, 7u, 40u}) {
      BlockPattern pattern(count);
      for (uint32_t row = 0; row < count; ++row) {
        for (uint32_t column = 0; column < row; ++column) {
          if (random.Uniform(0, 1) < share) pattern.Add(column, row);
        }
      }
      EXPECT_LT(RandomSystem(pattern, random).Error(), 1e-12) << share << " " << count;
    }
  }
}

TEST(BlockSystemTest, SolvesAChainWithLoopsAndADenseRow) {
  TestRandom random(2);
  BlockPattern pattern(120);
  for (uint32_t i = 1; i < 120; ++i) pattern.Add(i, i - 1);
  pattern.Add(3, 90);
  pattern.Add(40, 110);
  for (uint32_t i = 0; i < 119; ++i) pattern.Add(119, i);
  EXPECT_LT(RandomSystem(pattern, random).Error(), 1e-12);
}

TEST(BlockSystemTest, SolvesAgainWithOtherNumbers) {
  BlockPattern pattern(3);
  pattern.Add(2, 0);
  BlockSystem system(pattern);
  for (const double scale : {2.0, 5.0}) {
    system.SetZero();
    for (uint32_t i = 0; i < 3; ++i) system.Block(i, i) = scale * Matrix6d::Identity();
    Eigen::VectorXd x = Eigen::VectorXd::Ones(18);
    ASSERT_TRUE(system.Solve(x));
    EXPECT_LT((x - Eigen::VectorXd::Constant(18, 1 / scale)).norm(), 1e-14);
  }
}

TEST(BlockSystemTest, OfDiagonalBlocksTheLowerTriangleCounts) {
  TestRandom random(3);
  BlockPattern pattern(5);
  for (uint32_t i = 1; i < 5; ++i) pattern.Add(i, i - 1);
  RandomSystem made(pattern, random);
  for (uint32_t i = 0; i < 5; ++i) {
    made.system.Block(i, i).triangularView<Eigen::StrictlyUpper>().setConstant(77);
  }
  EXPECT_LT(made.Error(), 1e-12);
}

TEST(BlockSystemTest, RefusesWhatIsNotPositiveDefinite) {
  BlockPattern pattern(2);
  pattern.Add(1, 0);
  BlockSystem system(pattern);
  Eigen::VectorXd x = Eigen::VectorXd::Ones(12);
  EXPECT_FALSE(system.Solve(x)) << "zero";
  system.Block(0, 0) = system.Block(1, 1) = Matrix6d::Identity();
  system.Block(1, 0) = 2 * Matrix6d::Identity();
  EXPECT_FALSE(system.Solve(x)) << "indefinite";
}

TEST(BlockSystemTest, NothingToSolve) {
  Eigen::VectorXd x;
  EXPECT_TRUE(BlockSystem().Solve(x));
}

}  // namespace
}  // namespace carmap
