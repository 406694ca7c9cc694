#include "carmap/dataset/world_frame.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>

namespace carmap {
namespace {

namespace fs = std::filesystem;

class WorldFrameTest : public testing::Test {
 protected:
  WorldFrameTest() : drive_(fs::path(testing::TempDir()) / "carmap_world_frame_test") {
    fs::remove_all(drive_);
    fs::create_directories(drive_);
  }
  auto Origin(const std::string& world) const {
    std::ofstream(drive_ / "world.json") << world;
    return ReadWorldOrigin(drive_);
  }
  const fs::path drive_;
};

TEST_F(WorldFrameTest, TellsTheOrigin) {
  const auto origin = Origin(
      R"({"frame": {"name": "enu", "origin_latitude_deg": 49.5, "origin_longitude_deg": 8,
          "origin_altitude_m": 115}})");
  ASSERT_TRUE(origin.ok()) << origin.status();
  EXPECT_EQ(*origin, (GpsFix{49.5, 8, 115}));
}

TEST_F(WorldFrameTest, IsNotToldOfOtherDrives) {
  const auto of_no_file = ReadWorldOrigin(drive_);
  ASSERT_TRUE(of_no_file.ok()) << of_no_file.status();
  EXPECT_FALSE(*of_no_file);
  for (const char* world : {"{}", R"({"frame": 3})", R"({"frame": {"name": "other"}})"}) {
    const auto origin = Origin(world);
    ASSERT_TRUE(origin.ok()) << world << ": " << origin.status();
    EXPECT_FALSE(*origin) << world;
  }
}

TEST_F(WorldFrameTest, RefusesWhatIsNotAPlace) {
  for (const char* world :
       {"", "[1]", "{", R"({"frame": {"name": "enu"}})",
        R"({"frame": {"name": "enu", "origin_latitude_deg": 91, "origin_longitude_deg": 8,
            "origin_altitude_m": 115}})",
        R"({"frame": {"name": "enu", "origin_latitude_deg": "49", "origin_longitude_deg": 8,
            "origin_altitude_m": 115}})"}) {
    const auto origin = Origin(world);
    EXPECT_EQ(origin.status().code(), absl::StatusCode::kInvalidArgument) << world;
    EXPECT_THAT(std::string(origin.status().message()), testing::HasSubstr("world.json: "));
  }
}

}  // namespace
}  // namespace carmap
