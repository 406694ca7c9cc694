#include "carmap/geometry/cell_grid.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace carmap {
namespace {

constexpr CellGrid kEarth{.is_on_earth = true}, kLocal{.is_on_earth = false};
const GpsFix kKarlsruhe{49.0123, 8.4321, 115};

Eigen::Vector3d Somewhere(const CellGrid& grid) {
  return grid.is_on_earth ? EcefFromEnu(kKarlsruhe).translation : Eigen::Vector3d(-731, 2, 1044);
}

class CellGridTest : public ::testing::TestWithParam<CellGrid> {};

TEST_P(CellGridTest, PutsAPlaceNearTheOriginOfItsTile) {
  const Eigen::Vector3d p = Somewhere(GetParam());
  const uint64_t cell = CellAt(GetParam(), p);
  EXPECT_TRUE(IsCell(GetParam(), cell));
  EXPECT_LT((RootFromTile(GetParam(), cell).Inverse() * p).norm(), 190);
  EXPECT_LT((RootFromView(GetParam(), cell).Inverse() * p).norm(), 190);
  EXPECT_EQ(CellAt(GetParam(), RootFromTile(GetParam(), cell).translation), cell);
}

TEST_P(CellGridTest, FindsAllCellsAround) {
  const Eigen::Vector3d p = Somewhere(GetParam());
  const Rigid3 root_from_view = RootFromView(GetParam(), CellAt(GetParam(), p));
  const Eigen::Vector3d p_in_view = root_from_view.Inverse() * p;
  const std::vector<uint64_t> cells = CellsNear(GetParam(), p, 300);
  EXPECT_TRUE(std::is_sorted(cells.begin(), cells.end()));
  EXPECT_LT(cells.size(), 60u);
  for (double angle = 0; angle < 6.3; angle += 0.1) {
    for (const double radius_m : {1.0, 150.0, 299.0}) {
      const Eigen::Vector3d there =
          p_in_view + radius_m * Eigen::Vector3d(std::cos(angle), 0, std::sin(angle));
      const uint64_t cell = CellAt(GetParam(), root_from_view * there);
      EXPECT_TRUE(std::binary_search(cells.begin(), cells.end(), cell));
    }
  }
}

TEST_P(CellGridTest, HasItsCornersAround) {
  const uint64_t cell = CellAt(GetParam(), Somewhere(GetParam()));
  const auto corners = CornersOf(GetParam(), cell);
  ASSERT_EQ(corners.size(), 4u);
  for (const Eigen::Vector3d& corner : corners) {
    const double distance_m = (RootFromTile(GetParam(), cell).Inverse() * corner).norm();
    EXPECT_GT(distance_m, 60);
    EXPECT_LT(distance_m, 190);
  }
}

INSTANTIATE_TEST_SUITE_P(EarthAndLocal, CellGridTest, ::testing::Values(kEarth, kLocal));

TEST(CellGrid, HasFramesThatPointEastNorthUp) {
  const uint64_t cell = CellAt(kEarth, Somewhere(kEarth));
  const GpsFix center = GpsOfEcef(RootFromTile(kEarth, cell).translation);
  EXPECT_NEAR(center.altitude_m, 0, 1e-6);
  const GpsFix moved = GpsOfEcef(RootFromTile(kEarth, cell) * Eigen::Vector3d(0, 100, 7));
  EXPECT_NEAR(moved.latitude_deg, center.latitude_deg + 100 / 111'200.0, 1e-6);
  EXPECT_NEAR(moved.longitude_deg, center.longitude_deg, 1e-9);
  EXPECT_NEAR(moved.altitude_m, 7, 0.01);
  const GpsFix in_view = GpsOfEcef(RootFromView(kEarth, cell) * Eigen::Vector3d(0, -7, 100));
  EXPECT_NEAR(in_view.latitude_deg, moved.latitude_deg, 1e-9);
  EXPECT_NEAR(in_view.altitude_m, moved.altitude_m, 1e-4);
}

TEST(CellGrid, AgreesWithTheLocalPlane) {
  const LocalEnu plane(kKarlsruhe);
  const Eigen::Vector3d p(120, -340, 15);
  EXPECT_LT((EcefFromEnu(kKarlsruhe) * p - EcefFromEnu(plane.ToGps(p)).translation).norm(), 1e-6);
}

TEST(CellGrid, KnowsWhatIsNoCell) {
  EXPECT_FALSE(IsCell(kEarth, 0));
  EXPECT_FALSE(IsCell({.level = 15}, CellAt(kEarth, Somewhere(kEarth))));
}

}  // namespace
}  // namespace carmap
