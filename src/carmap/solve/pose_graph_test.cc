#include "carmap/solve/pose_graph.h"

#include <ceres/autodiff_cost_function.h>
#include <ceres/problem.h>
#include <ceres/rotation.h>
#include <ceres/solver.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "carmap/solve/test_scene.h"

namespace carmap {
namespace {

constexpr double kSigmaM = 0.02, kSigmaRad = 0.001;

/// A vehicle that drives rounds on a circle, 1 m between poses.
std::vector<Rigid3> DriveRounds(int pose_count, double circumference_m) {
  std::vector<Rigid3> camera_from_map;
  const double turn = 2 * std::numbers::pi / circumference_m;
  Rigid3 map_from_camera;
  for (int i = 0; i < pose_count; ++i) {
    camera_from_map.push_back(map_from_camera.Inverse());
    map_from_camera = map_from_camera * Rigid3{RotationExp({0, turn, 0}), {0, 0, 1}};
  }
  return camera_from_map;
}

PoseGraphEdge MeasureEdge(const std::vector<Rigid3>& camera_from_map, uint32_t from, uint32_t to,
                          double noise_sigmas, TestRandom& random) {
  const Rigid3 truth = camera_from_map[to] * camera_from_map[from].Inverse();
  return {from, to,
          Perturb(truth, random.Tangent(noise_sigmas * kSigmaM, noise_sigmas * kSigmaRad)), kSigmaM,
          kSigmaRad};
}

/// Edges from pose to pose, and poses as these add up: with all their drift.
PoseGraph Odometry(const std::vector<Rigid3>& truth, double noise_sigmas, TestRandom& random) {
  PoseGraph graph;
  graph.pose_is_fixed.assign(truth.size(), false);
  graph.pose_is_fixed[0] = true;
  graph.camera_from_map.push_back(truth[0]);
  for (uint32_t i = 1; i < truth.size(); ++i) {
    graph.edges.push_back(MeasureEdge(truth, i - 1, i, noise_sigmas, random));
    graph.camera_from_map.push_back(graph.edges.back().to_from_from * graph.camera_from_map.back());
  }
  return graph;
}

/// From the second round, every so many poses, back to the first.
void AddLoops(const std::vector<Rigid3>& truth, uint32_t poses_a_round, uint32_t step,
              double noise_sigmas, TestRandom& random, PoseGraph& graph) {
  for (uint32_t i = poses_a_round; i < truth.size(); i += step) {
    graph.edges.push_back(MeasureEdge(truth, i - poses_a_round, i, noise_sigmas, random));
    graph.edges.back().is_robust = true;
  }
}

double WorstDistance(const std::vector<Rigid3>& a, const std::vector<Rigid3>& b) {
  double worst = 0;
  for (size_t i = 0; i < a.size(); ++i) worst = std::max(worst, DistanceBetween(a[i], b[i]));
  return worst;
}

TEST(PoseGraphTest, JacobiansAgreeWithDifferences) {
  for (uint64_t seed = 1; seed <= 20; ++seed) {
    TestRandom random(seed);
    const Rigid3 from = random.Pose(20, 1), to = random.Pose(20, 1);
    // Also where pose and measurement differ by much.
    const PoseGraphEdge edge{0, 1, Perturb(to * from.Inverse(), random.Tangent(2, 0.8)), 1, 1};
    const EdgeError linear = LinearizeEdge(edge, from, to);
    for (int c = 0; c < 6; ++c) {
      const Vector6d step = 1e-6 * Vector6d::Unit(c);
      const Vector6d by_to = (LinearizeEdge(edge, from, Perturb(to, step)).error -
                              LinearizeEdge(edge, from, Perturb(to, -step)).error) /
                             2e-6;
      const Vector6d by_from = (LinearizeEdge(edge, Perturb(from, step), to).error -
                                LinearizeEdge(edge, Perturb(from, -step), to).error) /
                               2e-6;
      EXPECT_LT((linear.by_to.col(c) - by_to).norm(), 1e-7) << seed << " " << c;
      EXPECT_LT((linear.by_from.col(c) - by_from).norm(), 1e-7) << seed << " " << c;
    }
  }
}

TEST(PoseGraphTest, PriorAgreesWithDifferences) {
  TestRandom random(5);
  const Rigid3 pose = random.Pose(20, 1);
  PositionPrior prior{.pose_idx = 0, .position_in_map = {1, 2, 3}, .weight = 0.3};
  prior.sqrt_information << 2, 0.3, -1, 0, 0.5, 0.2, 0.1, 0, 0.25;
  Matrix6d hessian = Matrix6d::Zero();
  Vector6d gradient = Vector6d::Zero();
  AddPrior(prior, pose, 1, hessian, gradient);
  Eigen::Matrix<double, 3, 6> jacobian;
  for (int c = 0; c < 6; ++c) {
    const Vector6d step = 1e-6 * Vector6d::Unit(c);
    jacobian.col(c) =
        (PriorError(prior, Perturb(pose, step)) - PriorError(prior, Perturb(pose, -step))) / 2e-6;
  }
  EXPECT_LT((hessian - 0.3 * jacobian.transpose() * jacobian).norm(), 1e-6);
  EXPECT_LT((gradient - 0.3 * jacobian.transpose() * PriorError(prior, pose)).norm(), 1e-5);
}

TEST(PoseGraphTest, RecoversTheTruthExactlyWithoutNoise) {
  TestRandom random(1);
  const std::vector<Rigid3> truth = DriveRounds(150, 100);
  PoseGraph graph = Odometry(truth, 0, random);
  AddLoops(truth, 100, 10, 0, random, graph);
  for (size_t i = 1; i < truth.size(); ++i) {
    graph.camera_from_map[i] = Perturb(truth[i], random.Tangent(1, 0.05));
  }
  const PoseGraphSummary summary = SolvePoseGraph(graph, {.min_relative_decrease = 1e-12});
  EXPECT_LT(WorstDistance(graph.camera_from_map, truth), 1e-6);
  EXPECT_LT(summary.final_cost, 1e-9);
  EXPECT_GT(summary.initial_cost, 1000);
  EXPECT_TRUE(SameBits(graph.camera_from_map[0], truth[0])) << "fixed";
}

TEST(PoseGraphTest, ALoopTakesDriftAway) {
  double before = 0, after = 0;
  for (uint64_t seed = 1; seed <= 5; ++seed) {
    TestRandom random(seed);
    const std::vector<Rigid3> truth = DriveRounds(420, 400);
    PoseGraph graph = Odometry(truth, 1, random);
    before += WorstDistance(graph.camera_from_map, truth);
    AddLoops(truth, 400, 5, 1, random, graph);
    const PoseGraphSummary summary = SolvePoseGraph(graph);
    after += WorstDistance(graph.camera_from_map, truth);
    EXPECT_LT(DistanceBetween(graph.camera_from_map[400], truth[400]), 0.1) << seed;
    for (size_t i = graph.edges.size() - 4; i < graph.edges.size(); ++i) {
      EXPECT_GT(summary.edge_weights[i], 0.5);
    }
  }
  EXPECT_LT(after, before / 2);
}

TEST(PoseGraphTest, FalseLoopsLoseTheirWeight) {
  TestRandom random(3);
  const std::vector<Rigid3> truth = DriveRounds(220, 200);
  PoseGraph graph = Odometry(truth, 1, random), without = graph;
  const auto add_loop = [&](uint32_t from, uint32_t to, const Rigid3& error) {
    graph.edges.push_back(MeasureEdge(truth, from, to, 1, random));
    PoseGraphEdge& edge = graph.edges.back();
    edge.to_from_from = error * edge.to_from_from;
    edge.is_robust = true;
  };
  for (uint32_t i = 200; i < 220; i += 5) add_loop(i - 200, i, {});
  without.edges = graph.edges;
  add_loop(30, 150, {RotationExp({0, 1, 0}), {10, 0, 30}});
  add_loop(60, 190, {Eigen::Quaterniond::Identity(), {0, 0, 8}});
  const PoseGraphSummary summary = SolvePoseGraph(graph);
  SolvePoseGraph(without);
  const size_t count = graph.edges.size();
  EXPECT_LT(summary.edge_weights[count - 1], 1e-3);
  EXPECT_LT(summary.edge_weights[count - 2], 1e-3);
  EXPECT_GT(summary.edge_weights[count - 3], 0.2);
  EXPECT_LT(WorstDistance(graph.camera_from_map, without.camera_from_map), 0.02);
}

TEST(PoseGraphTest, FixesGiveThePlaceAndWrongOnesDoNotBendThePath) {
  for (uint64_t seed = 1; seed <= 5; ++seed) {
    TestRandom random(seed);
    const std::vector<Rigid3> truth = DriveRounds(1000, 1500);
    PoseGraph graph = Odometry(truth, 1, random);
    graph.pose_is_fixed[0] = false;
    const double before = WorstDistance(graph.camera_from_map, truth);
    for (uint32_t i = 0; i < truth.size(); i += 2) {
      PositionPrior prior{i, truth[i].Inverse().translation + random.Normal3(1)};
      // A tenth of the fixes is 50 m off, some seconds at a time.
      if (i % 200 < 20) prior.position_in_map += Eigen::Vector3d(30, 0, 40);
      graph.priors.push_back(prior);
    }
    const PoseGraphSummary summary = SolvePoseGraph(graph);
    EXPECT_GT(before, 2) << seed;
    EXPECT_LT(WorstDistance(graph.camera_from_map, truth), 0.7) << seed;
    for (size_t i = 0; i < graph.priors.size(); ++i) {
      if (graph.priors[i].pose_idx % 200 >= 20) continue;
      EXPECT_LT(summary.prior_weights[i], 0.01) << seed << " " << i;
    }
  }
}

// Written from the definition alone, derivatives by Ceres.
struct CeresEdge {
  PoseGraphEdge edge;

  template <typename T>
  bool operator()(const T* from_turn, const T* from_move, const T* to_turn, const T* to_move,
                  T* residual) const {
    const auto& measured = edge.to_from_from;
    const Eigen::AngleAxisd angle_axis(measured.rotation);
    const Eigen::Vector3d inverse_turn = -angle_axis.angle() * angle_axis.axis();
    T measured_turn[3], measured_q[4], from_q[4], to_q[4], inverse_from_q[4], relative_q[4], q[4];
    for (int i = 0; i < 3; ++i) measured_turn[i] = T(inverse_turn[i]);
    ceres::AngleAxisToQuaternion(measured_turn, measured_q);
    ceres::AngleAxisToQuaternion(from_turn, from_q);
    ceres::AngleAxisToQuaternion(to_turn, to_q);
    inverse_from_q[0] = from_q[0];
    for (int i = 1; i < 4; ++i) inverse_from_q[i] = -from_q[i];
    ceres::QuaternionProduct(to_q, inverse_from_q, relative_q);
    ceres::QuaternionProduct(relative_q, measured_q, q);
    T turn[3];
    ceres::QuaternionToAngleAxis(q, turn);
    // t = t_to - R_to R_from^-1 t_from - R t_measured.
    T measured_move[3], turned_from[3], turned_measured[3];
    for (int i = 0; i < 3; ++i) measured_move[i] = T(measured.translation[i]);
    ceres::QuaternionRotatePoint(relative_q, from_move, turned_from);
    ceres::QuaternionRotatePoint(q, measured_move, turned_measured);
    for (int i = 0; i < 3; ++i) {
      residual[i] = (to_move[i] - turned_from[i] - turned_measured[i]) / edge.sigma_m;
      residual[3 + i] = turn[i] / edge.sigma_rad;
    }
    return true;
  }
};

TEST(PoseGraphTest, ReachesTheOptimumThatCeresFinds) {
  TestRandom random(7);
  const std::vector<Rigid3> truth = DriveRounds(60, 50);
  PoseGraph graph = Odometry(truth, 1, random);
  for (uint32_t i = 50; i < 60; ++i)
    graph.edges.push_back(MeasureEdge(truth, i - 50, i, 1, random));

  std::vector<Eigen::Vector3d> turns, moves;
  for (const Rigid3& pose : graph.camera_from_map) {
    const Eigen::AngleAxisd angle_axis(pose.rotation);
    turns.push_back(angle_axis.angle() * angle_axis.axis());
    moves.push_back(pose.translation);
  }
  ceres::Problem problem;
  for (const PoseGraphEdge& edge : graph.edges) {
    problem.AddResidualBlock(
        new ceres::AutoDiffCostFunction<CeresEdge, 6, 3, 3, 3, 3>(new CeresEdge{edge}), nullptr,
        turns[edge.from_idx].data(), moves[edge.from_idx].data(), turns[edge.to_idx].data(),
        moves[edge.to_idx].data());
  }
  problem.SetParameterBlockConstant(turns[0].data());
  problem.SetParameterBlockConstant(moves[0].data());
  ceres::Solver::Options options;
  options.function_tolerance = 1e-14;
  options.max_num_iterations = 200;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary theirs;
  ceres::Solve(options, &problem, &theirs);

  const PoseGraphSummary ours = SolvePoseGraph(graph, {.min_relative_decrease = 1e-12});
  EXPECT_GT(theirs.final_cost, 1);
  EXPECT_NEAR(ours.final_cost, theirs.final_cost, 1e-6 * theirs.final_cost);
  for (size_t i = 0; i < truth.size(); ++i) {
    const Rigid3 pose{RotationExp(turns[i]), moves[i]};
    EXPECT_LT(DistanceBetween(graph.camera_from_map[i], pose), 1e-4) << i;
  }
}

TEST(PoseGraphTest, SameBitsTwiceAndOfTwoThousandPoses) {
  TestRandom random(11);
  const std::vector<Rigid3> truth = DriveRounds(2500, 2000);
  PoseGraph first = Odometry(truth, 1, random);
  AddLoops(truth, 2000, 20, 1, random, first);
  PoseGraph second = first;
  const double before = WorstDistance(first.camera_from_map, truth);
  SolvePoseGraph(first);
  SolvePoseGraph(second);
  EXPECT_LT(WorstDistance(first.camera_from_map, truth), before / 2);
  for (size_t i = 0; i < truth.size(); ++i) {
    EXPECT_TRUE(SameBits(first.camera_from_map[i], second.camera_from_map[i])) << i;
  }
}

TEST(PoseGraphTest, StopFlagAndEmptyGraphs) {
  PoseGraph empty;
  EXPECT_EQ(SolvePoseGraph(empty).final_cost, 0);
  TestRandom random(2);
  PoseGraph graph = Odometry(DriveRounds(10, 10), 1, random);
  graph.camera_from_map[5].translation.x() += 1;
  const PoseGraph before = graph;
  const std::atomic<bool> stop = true;
  EXPECT_EQ(SolvePoseGraph(graph, {.stop = &stop}).iterations, 0);
  for (size_t i = 0; i < 10; ++i) {
    EXPECT_TRUE(SameBits(graph.camera_from_map[i], before.camera_from_map[i]));
  }
}

TEST(PoseGraphTest, WrongIndicesAreABugOfTheCaller) {
  TestRandom random(2);
  const PoseGraph good = Odometry(DriveRounds(4, 10), 1, random);
  PoseGraph bad = good;
  bad.edges[0].to_idx = 4;
  EXPECT_THROW(SolvePoseGraph(bad), std::invalid_argument);
  bad = good;
  bad.edges[0].to_idx = bad.edges[0].from_idx;
  EXPECT_THROW(SolvePoseGraph(bad), std::invalid_argument);
  bad = good;
  bad.priors.push_back({.pose_idx = 4});
  EXPECT_THROW(SolvePoseGraph(bad), std::invalid_argument);
  bad = good;
  bad.pose_is_fixed.pop_back();
  EXPECT_THROW(SolvePoseGraph(bad), std::invalid_argument);
}

}  // namespace
}  // namespace carmap
