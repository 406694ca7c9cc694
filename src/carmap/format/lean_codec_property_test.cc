// Properties of the codec over random maps.
#include <gtest/gtest.h>
#include <rapidcheck.h>

#include "carmap/format/columns.h"
#include "carmap/format/lean_codec.h"
#include "carmap/format/lean_map_testing.h"

namespace carmap {
namespace {

LeanMap ArbitraryMap() {
  RandomMapOptions options;
  options.drives = *rc::gen::inRange<uint32_t>(0, 4);
  options.keyframes_per_drive = *rc::gen::inRange<uint32_t>(0, 12);
  options.landmarks_per_keyframe = *rc::gen::inRange<uint32_t>(0, 6);
  LeanMap map = RandomStreet(*rc::gen::arbitrary<uint64_t>(), options);
  for (LeanKeyframe& keyframe : map.keyframes) {
    if (*rc::gen::inRange(0, 10) != 0) continue;
    keyframe.timestamp.ns =
        *rc::gen::inRange<int64_t>(-3'000'000'000'000'000'000, 3'000'000'000'000'000'001);
    const double turn = *rc::gen::element(0.0, M_PI, -M_PI, M_PI - 1e-7, 2.0);
    keyframe.map_from_camera.rotation = RotationExp({turn * 0.6, 0, turn * 0.8});
  }
  return map;
}

TEST(LeanCodecProperty, DecodeOfEncodeIsQuantize) {
  EXPECT_TRUE(rc::check([] {
    const LeanMap map = ArbitraryMap();
    const LeanEncodeOptions options{*rc::gen::inRange(1, 20)};
    const auto bytes = EncodeLeanMap(map, options);
    RC_ASSERT(bytes.ok());
    const auto decoded = DecodeLeanMap(*bytes, "bytes");
    RC_ASSERT(decoded.ok());
    RC_ASSERT(AreIdentical(*decoded, Quantize(map)));
    RC_ASSERT(AreIdentical(Quantize(*decoded), *decoded));
    RC_ASSERT(*EncodeLeanMap(*decoded, options) == *bytes);
  }));
}

TEST(LeanCodecProperty, DamageNeverGoesUnnoticed) {
  EXPECT_TRUE(rc::check([] {
    std::string bytes = *EncodeLeanMap(ArbitraryMap());
    const size_t position = *rc::gen::inRange<size_t>(0, bytes.size());
    const char old = bytes[position];
    bytes[position] = static_cast<char>(*rc::gen::arbitrary<char>());
    RC_PRE(bytes[position] != old);
    RC_ASSERT(!DecodeLeanMap(bytes, "bytes").ok());
  }));
}

TEST(ColumnProperty, ReadOfAppendIsIdentity) {
  EXPECT_TRUE(rc::check([](const std::vector<uint64_t>& values) {
    std::string bytes;
    AppendIntColumn(values, *rc::gen::inRange(0, 20), bytes);
    ByteReader reader(bytes);
    RC_ASSERT(*ReadIntColumn(reader, values.size()) == values);
    RC_ASSERT(reader.remaining() == 0u);
  }));
}

}  // namespace
}  // namespace carmap
