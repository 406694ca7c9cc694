#include "carmap/format/columns.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>

namespace carmap {
namespace {

std::string Column(const std::vector<uint64_t>& values, int level) {
  std::string out;
  AppendIntColumn(values, level, out);
  return out;
}

TEST(Varint, KeepsValuesAndRefusesMoreThan64Bits) {
  for (const uint64_t value : {uint64_t{0}, uint64_t{127}, uint64_t{128}, UINT64_MAX}) {
    std::string out;
    AppendVarint(value, out);
    ByteReader reader(out);
    EXPECT_EQ(reader.Varint(), value);
    EXPECT_TRUE(reader.ok());
    EXPECT_EQ(reader.remaining(), 0u);
  }
  ByteReader too_long(std::string_view("\xff\xff\xff\xff\xff\xff\xff\xff\xff\x02", 10));
  too_long.Varint();
  EXPECT_FALSE(too_long.ok());
}

TEST(ByteReader, GivesZeroPastTheEndAndRemembers) {
  ByteReader reader(std::string_view("\x01\x02\x03", 3));
  EXPECT_EQ(reader.Uint<uint16_t>(), 0x0201);
  EXPECT_EQ(reader.Uint<uint16_t>(), 0);
  EXPECT_FALSE(reader.ok());
  EXPECT_EQ(reader.Uint<uint8_t>(), 0);
}

TEST(ZigZag, MapsMagnitudeToMagnitude) {
  EXPECT_EQ(ZigZag(0), 0u);
  EXPECT_EQ(ZigZag(-1), 1u);
  EXPECT_EQ(ZigZag(1), 2u);
  for (const int64_t value : {INT64_MIN, int64_t{-77}, int64_t{0}, int64_t{5}, INT64_MAX}) {
    EXPECT_EQ(UnZigZag(ZigZag(value)), value);
  }
}

TEST(IntColumn, KeepsEveryMagnitude) {
  std::vector<uint64_t> values = {0, UINT64_MAX};
  for (int bit = 0; bit < 64; ++bit) {
    const uint64_t power = uint64_t{1} << bit;
    for (const uint64_t value : {power - 1, power, power + 1, power | (power >> 1)}) {
      values.push_back(value);
    }
  }
  for (const int level : {0, 1, 19}) {
    const std::string bytes = Column(values, level);
    ByteReader reader(bytes);
    const auto read = ReadIntColumn(reader, values.size());
    ASSERT_TRUE(read.ok()) << read.status();
    EXPECT_EQ(*read, values);
    EXPECT_EQ(reader.remaining(), 0u);
  }
}

TEST(IntColumn, RefusesEachCut) {
  std::vector<uint64_t> values;
  for (uint64_t i = 0; i < 200; ++i) values.push_back(i * i % 977);
  for (const int level : {0, 19}) {
    const std::string bytes = Column(values, level);
    for (size_t size = 0; size < bytes.size(); ++size) {
      ByteReader reader(std::string_view(bytes).substr(0, size));
      EXPECT_FALSE(ReadIntColumn(reader, values.size()).ok()) << size;
    }
  }
}

TEST(IntColumn, RefusesAnotherCountThanWasCompressed) {
  const std::string bytes = Column(std::vector<uint64_t>(1000, 3), 19);
  for (const size_t count : {size_t{0}, size_t{999}, size_t{1001}, size_t{100000}}) {
    ByteReader reader(bytes);
    EXPECT_FALSE(ReadIntColumn(reader, count).ok()) << count;
  }
}

TEST(IntColumn, RefusesTokensThatStandForNothing) {
  for (const int token : {252, 255}) {
    const std::string bytes{'\0', static_cast<char>(token)};
    ByteReader reader(bytes);
    EXPECT_FALSE(ReadIntColumn(reader, 1).ok());
  }
}

TEST(IntColumn, CostsLittleForEqualSmallValues) {
  EXPECT_LT(Column(std::vector<uint64_t>(10000, 0), 19).size(), 30u);
}

TEST(ByteColumn, IsNeverMuchLongerThanItsBytes) {
  std::string bytes, out;
  for (int i = 0; i < 256; ++i) bytes.push_back(static_cast<char>(i * 167));
  AppendByteColumn(bytes, 19, out);
  EXPECT_EQ(out.size(), bytes.size() + 1);
  ByteReader reader(out);
  EXPECT_EQ(ReadByteColumn(reader, 256).value(), bytes);
}

}  // namespace
}  // namespace carmap
