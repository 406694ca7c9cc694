#include "carmap/feature/vocabulary_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <tbb/global_control.h>
#include <xxhash.h>

#include <filesystem>

#include "carmap/base/byte_io.h"
#include "carmap/base/file.h"
#include "carmap/feature/test_descriptors.h"
#include "carmap/feature/vocabulary_trainer.h"

namespace carmap {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

Vocabulary SmallVocabulary(uint64_t seed = 1) {
  return TrainVocabulary(DescriptorsOfImages(6, 60, seed), {.branching = 5, .depth = 3}).value();
}

/// Seals bytes that were changed.
std::string Sealed(std::string bytes) {
  bytes.resize(bytes.size() - 8);
  AppendUint(uint64_t{XXH3_64bits(bytes.data(), bytes.size())}, bytes);
  return bytes;
}

void ExpectRefused(const std::string& bytes, absl::StatusCode code, const std::string& what) {
  const auto vocabulary = DecodeVocabulary(bytes, "v.cmvoc");
  ASSERT_FALSE(vocabulary.ok()) << what;
  EXPECT_EQ(vocabulary.status().code(), code) << vocabulary.status();
  EXPECT_THAT(std::string(vocabulary.status().message()),
              AllOf(HasSubstr("v.cmvoc: "), HasSubstr(what), HasSubstr("; ")));
}

TEST(VocabularyFile, ThereAndBack) {
  const Vocabulary vocabulary = SmallVocabulary();
  const std::string bytes = EncodeVocabulary(vocabulary);
  const auto& tables = vocabulary.tables();
  EXPECT_EQ(bytes.size(), 36 + tables.child_counts.size() +
                              sizeof(Descriptor) * tables.centers.size() +
                              2 * tables.weights.size());
  const auto back = DecodeVocabulary(bytes, "v.cmvoc");
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->tables(), tables);
  EXPECT_EQ(back->depth(), vocabulary.depth());
  EXPECT_EQ(EncodeVocabulary(*back), bytes);
}

TEST(VocabularyFile, HasTheBytesThatTheSpecificationSays) {
  const Descriptor a{{0x0807060504030201, 0x1f}}, b{{~uint64_t{0}, 2}};
  const std::string bytes =
      EncodeVocabulary(Vocabulary::Create({7, {2}, {a, b}, {258, 5}}).value());
  ASSERT_EQ(bytes.size(), 73u);
  EXPECT_EQ(bytes.substr(0, 28), std::string("\x89"
                                             "CMV\r\n\x1a\n"
                                             "\2\0\0\0"
                                             "\7\0\0\0"
                                             "\1\0\0\0"
                                             "\2\0\0\0"
                                             "\2\0\0\0",
                                             28));
  EXPECT_EQ(bytes.substr(28, 9), std::string("\2"
                                             "\1\2\3\4\5\6\7\10",
                                             9));
  EXPECT_EQ(bytes.substr(61, 4), std::string("\2\1\5\0", 4));
  EXPECT_EQ(Sealed(bytes), bytes);
}

TEST(VocabularyFile, IsTheSameWithAnyNumberOfThreads) {
  const auto images = DescriptorsOfImages(40, 400, 9);
  const VocabularyOptions options{.branching = 8, .depth = 3, .seed = 3};
  const std::string bytes = EncodeVocabulary(TrainVocabulary(images, options).value());
  {
    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    EXPECT_EQ(EncodeVocabulary(TrainVocabulary(images, options).value()), bytes);
  }
  EXPECT_NE(
      EncodeVocabulary(TrainVocabulary(images, {.branching = 8, .depth = 3, .seed = 4}).value()),
      bytes);
}

TEST(VocabularyFile, IsReadFromDisk) {
  const auto path = std::filesystem::path(testing::TempDir()) / "carmap_vocabulary_test.cmvoc";
  const Vocabulary vocabulary = SmallVocabulary(2);
  ASSERT_TRUE(WriteFileAtomically(path, EncodeVocabulary(vocabulary)).ok());
  const auto back = ReadVocabulary(path);
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->tables(), vocabulary.tables());
  std::filesystem::remove(path);
  EXPECT_EQ(ReadVocabulary(path).status().code(), absl::StatusCode::kNotFound);
}

TEST(VocabularyFile, RefusesWhatIsNone) {
  const std::string bytes = EncodeVocabulary(SmallVocabulary());
  ExpectRefused("P0: 1 0 0 0 this is no vocabulary", absl::StatusCode::kInvalidArgument,
                "not a carmap vocabulary");
  for (const size_t size : {size_t{0}, size_t{5}, size_t{27}, size_t{28}, size_t{36},
                            bytes.size() / 2, bytes.size() - 1}) {
    ExpectRefused(bytes.substr(0, size), absl::StatusCode::kDataLoss, "cut short");
  }
  ExpectRefused(bytes + "x", absl::StatusCode::kDataLoss, "1 bytes follow");
  std::string changed = bytes;
  changed[100] = static_cast<char>(changed[100] ^ 4);
  ExpectRefused(changed, absl::StatusCode::kDataLoss, "checksum");
  changed = bytes;
  changed[8] = 3;
  ExpectRefused(Sealed(changed), absl::StatusCode::kUnimplemented, "upgrade");
  changed[8] = 1;
  ExpectRefused(Sealed(changed), absl::StatusCode::kUnimplemented, "train it again");
  changed = bytes;
  changed[28] = 1;
  ExpectRefused(Sealed(changed), absl::StatusCode::kDataLoss, "one child");
  changed = bytes;
  changed.replace(16, 12, 12, '\xff');  // claims tables of gigabytes
  ExpectRefused(Sealed(changed), absl::StatusCode::kDataLoss, "cut short");
}

TEST(VocabularyFileProperty, DamageNeverGoesUnnoticed) {
  const std::string bytes = EncodeVocabulary(SmallVocabulary());
  EXPECT_TRUE(rc::check([&] {
    std::string damaged = bytes;
    const size_t position = *rc::gen::inRange<size_t>(0, bytes.size());
    damaged[position] = static_cast<char>(*rc::gen::arbitrary<char>());
    RC_PRE(damaged[position] != bytes[position]);
    RC_ASSERT(!DecodeVocabulary(damaged, "v").ok());
  }));
}

TEST(VocabularyFileProperty, HostileBytesGiveAnErrorOrASoundVocabulary) {
  const std::string bytes = EncodeVocabulary(SmallVocabulary());
  const size_t counts_end = 28 + SmallVocabulary().tables().child_counts.size();
  EXPECT_TRUE(rc::check([&] {
    std::string hostile = bytes;
    for (int changes = *rc::gen::inRange(1, 6); changes > 0; --changes) {
      const size_t position = *rc::gen::inRange<size_t>(12, counts_end + 8);
      hostile[position] = static_cast<char>(*rc::gen::inRange(0, 7));
    }
    hostile = Sealed(hostile);
    const auto vocabulary = DecodeVocabulary(hostile, "v");
    RC_CLASSIFY(vocabulary.ok());
    if (!vocabulary.ok()) return;
    RC_ASSERT(EncodeVocabulary(*vocabulary) == hostile);
    std::mt19937_64 random(*rc::gen::arbitrary<uint64_t>());
    RC_ASSERT(vocabulary->WordOf(RandomDescriptor(random)) < vocabulary->word_count());
  }));
}

}  // namespace
}  // namespace carmap
