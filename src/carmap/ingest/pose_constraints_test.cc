#include "carmap/ingest/pose_constraints.h"

#include <string>

#include "carmap/ingest/test_base.h"

namespace carmap {
namespace {

using ::testing::HasSubstr;

PoseConstraints Some() {
  LeanMap map = MapOf(MakeStreet(2, 160), {.id = 3});
  PoseConstraints constraints = ConstraintsOf(map, {{0, 1, false}, {1, 2, true}, {0, 30, false}});
  const LeanMap base = MapOf(MakeStreet(2, 160), {.id = 4});
  AddAnchors(
      base, map,
      {{5, base.keyframes[7].map_from_camera * Rigid3{RotationExp({0, 0.1, 0}), {0.2, 0, 0.1}}, 0.1,
        0.02, 1}},
      constraints);
  return constraints;
}

TEST(PoseConstraints, ComeBackFromTheirBytes) {
  const PoseConstraints some = Some();
  const auto decoded = DecodeConstraints(EncodeConstraints(some).value(), "c");
  ASSERT_TRUE(decoded.ok()) << decoded.status();
  ASSERT_EQ(decoded->drive.keyframes.size(), some.drive.keyframes.size());
  for (size_t i = 0; i < some.drive.keyframes.size(); ++i) {
    EXPECT_LT((decoded->drive.keyframes[i].map_from_camera.translation -
               some.drive.keyframes[i].map_from_camera.translation)
                  .norm(),
              0.002);
  }
  ASSERT_EQ(decoded->steps.size(), 3u);
  EXPECT_EQ(decoded->steps[1].to_idx, 2u);
  EXPECT_TRUE(decoded->steps[1].is_lost);
  ASSERT_EQ(decoded->anchors.size(), 1u);
  EXPECT_EQ(decoded->anchors[0].keyframe, some.drive.keyframes[5].id);
  EXPECT_EQ(decoded->anchors[0].reference.index, 21u);
  EXPECT_EQ(decoded->anchors[0].reference_from_keyframe.translation,
            some.anchors[0].reference_from_keyframe.translation);
  EXPECT_EQ(decoded->anchors[0].sigma_rad, 0.02);
}

TEST(PoseConstraints, DamagedBytesAreRefused) {
  const std::string bytes = EncodeConstraints(Some()).value();
  for (size_t length = 0; length < bytes.size(); length += 7) {
    EXPECT_FALSE(DecodeConstraints(bytes.substr(0, length), "c").ok()) << length;
  }
  EXPECT_FALSE(DecodeConstraints(bytes + "x", "c").ok());
  PoseConstraints wrong = Some();
  wrong.steps.push_back({3, 100'000, false});
  EXPECT_THAT(DecodeConstraints(EncodeConstraints(wrong).value(), "c").status().message(),
              HasSubstr("c: what it measured of poses is damaged"));
  wrong = Some();
  wrong.anchors[0].sigma_m = std::nan("");
  EXPECT_FALSE(DecodeConstraints(EncodeConstraints(wrong).value(), "c").ok());
  wrong = Some();
  wrong.anchors[0].reference_from_keyframe.rotation.coeffs() *= 2;
  EXPECT_FALSE(DecodeConstraints(EncodeConstraints(wrong).value(), "c").ok());
}

}  // namespace
}  // namespace carmap
