#include "carmap/dataset/kitti_drive.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "carmap/base/file.h"
#include "carmap/dataset/image_file.h"

namespace carmap {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

constexpr int kWidth = 96, kHeight = 64, kFrames = 4;

fs::path DataFolder() {
  const char* const from_environment = std::getenv("CARMAP_DATA");
  return from_environment != nullptr ? from_environment : CARMAP_DATA_DIR;
}

std::string Projection(double fx, double tx, double cx = 48) {
  return fmt::format("{} 0 {} {} 0 101 32 0 0 0 1 0\n", fx, cx, tx);
}

cv::Mat Noise(uint64_t seed, int width = kWidth, int height = kHeight) {
  cv::Mat image(height, width, CV_8UC1);
  cv::RNG(seed).fill(image, cv::RNG::UNIFORM, 0, 256);
  return image;
}

/// A small drive with everything in it, for tests to break.
class KittiDriveTest : public testing::Test {
 protected:
  KittiDriveTest() : drive_(fs::path(testing::TempDir()) / "carmap_drive_test") {
    fs::remove_all(drive_);
    for (const int side : {0, 1}) {
      fs::create_directories(ImagePath(side, 0).parent_path());
      for (int i = 0; i < kFrames; ++i) cv::imwrite(ImagePath(side, i), Noise(2 * i + side));
    }
    Write("calib.txt", "P0: " + Projection(100, 0) + "P1: " + Projection(100, -50) + "Tr: 1 2 3\n");
    Write("times.txt", "0\n0.1\n2e-1\n0.3\n");
  }
  fs::path ImagePath(int side, int frame) const {
    return drive_ / fmt::format("image_{}", side) / fmt::format("{:06}.png", frame);
  }
  void Write(const std::string& name, const std::string& text) const {
    std::ofstream(drive_ / name, std::ios::binary) << text;
  }
  void Truncate(const fs::path& path, uint64_t bytes) const { fs::resize_file(path, bytes); }
  std::string OpenError(const FrameRange& range = {}) const {
    return std::string(KittiDrive::Open(drive_, range).status().message());
  }
  /// Why the first frame cannot be read; the others can.
  std::string FirstFrameError() const {
    const auto drive = KittiDrive::Open(drive_);
    EXPECT_TRUE(drive.ok()) << drive.status();
    return drive.ok() ? std::string((*drive)->Next()->status.message()) : std::string();
  }
  DriveId IdOf(const FrameRange& range = {}) const {
    const auto drive = KittiDrive::Open(drive_, range);
    EXPECT_TRUE(drive.ok()) << drive.status();
    return drive.ok() ? (*drive)->id() : DriveId{};
  }
  const fs::path drive_;
};

/// One line that names the file and, after a semicolon, says what to do.
MATCHER_P2(IsClear, file, cause, "") {
  return ExplainMatchResult(AllOf(HasSubstr(file), HasSubstr(cause), Not(HasSubstr("\n"))), arg,
                            result_listener);
}

TEST_F(KittiDriveTest, GivesEveryFrame) {
  const auto drive = KittiDrive::Open(drive_);
  ASSERT_TRUE(drive.ok()) << drive.status();
  const StereoRig expected{{100, 101, 48, 32, kWidth, kHeight}, 0.5};
  EXPECT_EQ((*drive)->rig(), expected);
  EXPECT_EQ((*drive)->frame_count(), size_t{kFrames});
  EXPECT_EQ((*drive)->size(), size_t{kFrames});
  EXPECT_TRUE((*drive)->truth().empty());
  for (uint32_t i = 0; i < kFrames; ++i) {
    const auto frame = (*drive)->Next();
    ASSERT_TRUE(frame && frame->status.ok());
    EXPECT_EQ(frame->index, i);
    EXPECT_EQ(frame->timestamp, Timestamp{i * 100'000'000LL});
    EXPECT_EQ(cv::norm(frame->left, Noise(2 * i), cv::NORM_INF), 0);
    EXPECT_EQ(cv::norm(frame->right, Noise(2 * i + 1), cv::NORM_INF), 0);
    EXPECT_FALSE(frame->gps);
  }
  EXPECT_FALSE((*drive)->Next());
  EXPECT_FALSE((*drive)->Next());
}

TEST_F(KittiDriveTest, GivesARange) {
  Write("poses.txt",
        "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 1 0 1 0 0 0 0 1 0\n"
        "1 0 0 2 0 1 0 0 0 0 1 0\n1 0 0 3 0 1 0 0 0 0 1 0\n");
  const auto drive = KittiDrive::Open(drive_, {.first = 1, .last = 2});
  ASSERT_TRUE(drive.ok()) << drive.status();
  EXPECT_EQ((*drive)->frame_count(), 2u);
  ASSERT_EQ((*drive)->truth().size(), 2u);
  EXPECT_EQ((*drive)->truth()[0].world_from_camera->translation.x(), 1);
  EXPECT_EQ((*drive)->truth()[0].timestamp, Timestamp{100'000'000});
  EXPECT_EQ((*drive)->Next()->index, 1u);
  EXPECT_EQ((*drive)->Next()->index, 2u);
  EXPECT_FALSE((*drive)->Next());
}

TEST_F(KittiDriveTest, IdentifiesItsInput) {
  const DriveId id = IdOf();
  EXPECT_EQ(IdOf({.first = 0, .last = kFrames - 1}), id);
  EXPECT_NE(IdOf({.first = 0, .last = 2}), id);
  EXPECT_EQ(IdOf({.first = 0, .last = 2}).input, id.input);
  EXPECT_NE(IdOf({.first = 1}).input, id.input);
  Write("times.txt", "0.01\n0.1\n0.2\n0.3\n");
  EXPECT_NE(IdOf().input, id.input);
  Write("times.txt", "0\n0.1\n0.2\n0.3\n");
  EXPECT_EQ(IdOf(), id);
  cv::imwrite(ImagePath(1, 0), Noise(99));
  EXPECT_NE(IdOf(), id);
}

TEST_F(KittiDriveTest, KnowsTheIdsOfItsRanges) {
  const auto drive = KittiDrive::Open(drive_).value();
  const DriveId range = IdOf({.first = 1, .last = 2});
  EXPECT_TRUE(drive->HasInput(drive->id(), 0));
  EXPECT_TRUE(drive->HasInput(drive->id(), 2)) << "its first frames were not mapped";
  EXPECT_TRUE(drive->HasInput(range, 1));
  EXPECT_TRUE(drive->HasInput({range.input, 5}, 1)) << "made with other options";
  EXPECT_FALSE(drive->HasInput(range, 0));
  EXPECT_FALSE(drive->HasInput(range, 7));
  EXPECT_FALSE(drive->HasInput({range.input + 1}, 1));
}

TEST_F(KittiDriveTest, KnowsUnixTime) {
  EXPECT_FALSE(KittiDrive::Open(drive_).value()->unix_start());
  Write("times.txt", "1700000000\n1700000000.1\n1700000000.2\n1700000000.3\n");
  EXPECT_EQ(KittiDrive::Open(drive_).value()->unix_start(), Timestamp{0});
}

TEST_F(KittiDriveTest, ReadsColourSixteenBitJpegAndPgm) {
  cv::Mat colour, deep;
  cv::merge(std::vector<cv::Mat>(3, Noise(0)), colour);
  Noise(0).convertTo(deep, CV_16U, 257);
  cv::imwrite(drive_ / "colour.png", colour);
  cv::imwrite(drive_ / "deep.png", deep);
  cv::imwrite(drive_ / "grey.pgm", Noise(0));
  cv::imwrite(drive_ / "grey.jpg", Noise(0), {cv::IMWRITE_JPEG_QUALITY, 100});
  for (const char* name : {"colour.png", "deep.png", "grey.pgm", "grey.jpg"}) {
    const auto image = ReadGreyImage(drive_ / name);
    ASSERT_TRUE(image.ok()) << image.status();
    EXPECT_EQ(image->type(), CV_8UC1);
    EXPECT_LE(cv::norm(*image, Noise(0), cv::NORM_INF), 4) << name;
  }
}

TEST_F(KittiDriveTest, ReadsIndexImagesAsTheyAreOrNotAtAll) {
  cv::Mat colour, deep;
  cv::merge(std::vector<cv::Mat>(3, Noise(0)), colour);
  Noise(0).convertTo(deep, CV_16U);
  cv::imwrite(drive_ / "index.png", Noise(0));
  cv::imwrite(drive_ / "colour.png", colour);
  cv::imwrite(drive_ / "deep.png", deep);
  const auto index = ReadIndexImage(drive_ / "index.png");
  ASSERT_TRUE(index.ok()) << index.status();
  EXPECT_TRUE(HaveSamePixels(*index, Noise(0)));
  for (const char* name : {"colour.png", "deep.png"}) {
    EXPECT_THAT(std::string(ReadIndexImage(drive_ / name).status().message()),
                AllOf(HasSubstr(name), HasSubstr("is not 8-bit grey; ")));
  }
}

TEST_F(KittiDriveTest, OrdersNamesWithoutLeadingZeros) {
  for (const int side : {0, 1}) {
    const fs::path folder = ImagePath(side, 0).parent_path();
    fs::rename(ImagePath(side, 1), folder / "9.png");
    fs::rename(ImagePath(side, 2), folder / "10.png");
    fs::rename(ImagePath(side, 3), folder / "11.png");
    fs::rename(ImagePath(side, 0), folder / "8.png");
    std::ofstream(folder / "._8.png") << "left by another system";
  }
  const auto drive = KittiDrive::Open(drive_);
  ASSERT_TRUE(drive.ok()) << drive.status();
  for (int i = 0; i < kFrames; ++i) {
    EXPECT_EQ(cv::norm((*drive)->Next()->left, Noise(2 * i), cv::NORM_INF), 0);
  }
}

TEST_F(KittiDriveTest, GoesOnAfterAnUnreadableFrame) {
  Truncate(ImagePath(1, 1), fs::file_size(ImagePath(1, 1)) / 2);
  cv::imwrite(ImagePath(0, 2), cv::Mat(kHeight, kWidth, CV_8UC1, cv::Scalar(0)));
  const auto drive = KittiDrive::Open(drive_);
  ASSERT_TRUE(drive.ok()) << drive.status();
  EXPECT_TRUE((*drive)->Next()->status.ok());
  EXPECT_THAT(std::string((*drive)->Next()->status.message()),
              IsClear("image_1/000001.png", "truncated or damaged; "));
  const auto black = (*drive)->Next();
  ASSERT_TRUE(black->status.ok()) << black->status;
  EXPECT_EQ(black->index, 2u);
  EXPECT_TRUE((*drive)->Next()->status.ok());
  EXPECT_FALSE((*drive)->Next());
}

TEST_F(KittiDriveTest, RefusesAnImageCutAnywhere) {
  const std::string whole = *ReadFile(ImagePath(0, 0), 1 << 20);
  for (size_t size = 0; size < whole.size(); size += 1 + size / 16) {
    std::ofstream(ImagePath(0, 0), std::ios::binary) << whole.substr(0, size);
    EXPECT_THAT(FirstFrameError(), IsClear("image_0/000000.png", "; copy")) << size;
  }
  std::ofstream(ImagePath(0, 0), std::ios::binary) << whole.substr(0, whole.size() - 1);
  EXPECT_THAT(FirstFrameError(), HasSubstr("truncated"));
}

TEST_F(KittiDriveTest, RefusesAnImageWithAnyBitFlipped) {
  const std::string whole = *ReadFile(ImagePath(0, 0), 1 << 20);
  for (size_t byte = 0; byte < whole.size(); byte += 1 + byte / 16) {
    std::string damaged = whole;
    damaged[byte] ^= 4;
    std::ofstream(ImagePath(0, 0), std::ios::binary) << damaged;
    EXPECT_THAT(FirstFrameError(), HasSubstr("image_0/000000.png")) << byte;
  }
}

TEST_F(KittiDriveTest, RefusesAnImageThatIsNone) {
  Write("image_0/000000.png", "GIF89a, say");
  EXPECT_THAT(FirstFrameError(), IsClear("image_0/000000.png", "is not a PNG"));
  cv::imwrite(ImagePath(0, 0), Noise(0, 32, 32));
  EXPECT_THAT(FirstFrameError(), IsClear("image_0/000000.png", "32x32 px; sizes"));
  Write("image_0/000000.png", "P5 60000 60000 255\nxyz");
  EXPECT_THAT(FirstFrameError(), HasSubstr("truncated"));
  // A PNG whose (rightly summed) header claims 2^30 × 2^30 pixels.
  std::string huge = "\x89PNG\r\n\x1a\n";
  huge += std::string("\0\0\0\x0dIHDR\x40\0\0\0\x40\0\0\0\x08\0\0\0\0\x7d\xff\xb1\x62", 25);
  huge += std::string("\0\0\0\0IEND\xae\x42\x60\x82", 12);
  Write("image_0/000000.png", huge);
  EXPECT_THAT(FirstFrameError(), IsClear("image_0/000000.png", "1073741824x1073741824 px; sizes"));
}

TEST_F(KittiDriveTest, RefusesImagesOfOtherSize) {
  cv::imwrite(ImagePath(1, 0), Noise(0, kWidth, kHeight + 1));
  EXPECT_THAT(FirstFrameError(),
              IsClear("image_1/000000.png", "96x65 px but the drive's first is 96x64"));
  cv::imwrite(ImagePath(1, 0), Noise(0));
  cv::imwrite(ImagePath(0, 1), Noise(0, kWidth - 1, kHeight));
  const auto drive = KittiDrive::Open(drive_);
  ASSERT_TRUE(drive.ok()) << drive.status();
  EXPECT_TRUE((*drive)->Next()->status.ok());
  EXPECT_THAT(std::string((*drive)->Next()->status.message()),
              IsClear("image_0/000001.png", "95x64 px but"));
}

TEST_F(KittiDriveTest, RefusesMissingParts) {
  EXPECT_THAT(std::string(KittiDrive::Open(drive_ / "absent").status().message()),
              IsClear("absent", "no such folder; "));
  for (const char* name : {"calib.txt", "times.txt", "image_1"}) {
    fs::rename(drive_ / name, drive_ / "away");
    EXPECT_THAT(OpenError(), IsClear(name, "; ")) << name;
    fs::rename(drive_ / "away", drive_ / name);
  }
  EXPECT_EQ(OpenError(), "");
}

TEST_F(KittiDriveTest, LosesAFrameThatLacksAnImage) {
  for (const int side : {0, 1}) {
    for (const int lost : {0, 2, kFrames - 1}) {
      fs::rename(ImagePath(side, lost), drive_ / "away.png");
      const auto drive = KittiDrive::Open(drive_);
      ASSERT_TRUE(drive.ok()) << drive.status();
      for (int i = 0; i < kFrames; ++i) {
        const auto frame = (*drive)->Next();
        EXPECT_EQ(frame->timestamp, Timestamp{i * 100'000'000LL});
        EXPECT_EQ(frame->status.ok(), i != lost) << side << lost << i;
        if (i != lost) continue;
        EXPECT_THAT(std::string(frame->status.message()),
                    IsClear(ImagePath(side, lost).string(), "no such file; "));
      }
      EXPECT_EQ((*drive)->rig().camera.width, kWidth);
      fs::rename(drive_ / "away.png", ImagePath(side, lost));
    }
  }
}

TEST_F(KittiDriveTest, RefusesUnequalImages) {
  fs::rename(ImagePath(1, 3), ImagePath(1, 7));
  EXPECT_THAT(OpenError(), IsClear("times.txt", "4 times but the drive has 5 frames; "));
  for (int i = 0; i < 3; ++i) fs::rename(ImagePath(1, i), ImagePath(1, i + 10));
  EXPECT_THAT(OpenError(),
              IsClear("carmap_drive_test", "4 in image_1 only 0 have the same name; "));
  for (const auto& image : fs::directory_iterator(drive_ / "image_1")) fs::remove(image);
  EXPECT_THAT(OpenError(), IsClear("image_1", "empty; "));
}

TEST_F(KittiDriveTest, LosesAFrameWithTheTimeOfTheOneBefore) {
  Write("times.txt", "0\n0.1\n0.1\n0.1\n");
  const auto drive = KittiDrive::Open(drive_);
  ASSERT_TRUE(drive.ok()) << drive.status();
  for (const int64_t ns : {0, 100'000'000, 100'000'001, 100'000'002}) {
    const auto frame = (*drive)->Next();
    EXPECT_EQ(frame->timestamp, Timestamp{ns});
    EXPECT_EQ(frame->status.ok(), ns <= 100'000'000);
    if (frame->status.ok()) continue;
    EXPECT_THAT(std::string(frame->status.message()),
                IsClear("times.txt", "0.100000 s is that of the frame before; "));
  }
}

TEST_F(KittiDriveTest, TimesAscendAlsoWhereOneComesOnlyANanosecondAfterEqualOnes) {
  Write("times.txt", "0\n0.1\n0.1\n0.100000001\n");
  const auto drive = KittiDrive::Open(drive_);
  ASSERT_TRUE(drive.ok()) << drive.status();
  int64_t before = -1;
  while (const auto frame = (*drive)->Next()) {
    EXPECT_GT(frame->timestamp.ns, before);
    before = frame->timestamp.ns;
  }
  EXPECT_EQ(before, 100'000'002);
}

TEST_F(KittiDriveTest, ReadsTheColourPairWhereThereIsNoGreyOne) {
  const DriveId id = IdOf();
  fs::rename(drive_ / "image_0", drive_ / "image_2");
  fs::rename(drive_ / "image_1", drive_ / "image_3");
  EXPECT_THAT(OpenError(), IsClear("calib.txt", "'P2:' is missing; "));
  Write("calib.txt",
        "P0: " + Projection(50, 0) + "P2: " + Projection(100, 20) + "P3: " + Projection(100, -30));
  EXPECT_EQ(IdOf(), id);
}

TEST_F(KittiDriveTest, ReadsTextsWithAByteOrderMark) {
  Write("poses.txt",
        "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 1 0 1 0 0 0 0 1 0\n"
        "1 0 0 2 0 1 0 0 0 0 1 0\n1 0 0 3 0 1 0 0 0 0 1 0\n");
  Write("gps.txt", "0 49 8 0\n0.3 49 8 0\n");
  const DriveId id = IdOf();
  for (const char* name : {"calib.txt", "times.txt", "poses.txt", "gps.txt"}) {
    Write(name, "\xef\xbb\xbf" + *ReadFile(drive_ / name, 1 << 20));
  }
  EXPECT_EQ(IdOf(), id);
  const auto drive = KittiDrive::Open(drive_);
  ASSERT_TRUE(drive.ok()) << drive.status();
  EXPECT_EQ((*drive)->truth().size(), size_t{kFrames});
  EXPECT_TRUE((*drive)->Next()->gps);
}

TEST_F(KittiDriveTest, ScalesDeepImagesOfADriveAlike) {
  const auto deep = [](int seed, double scale) {
    cv::Mat image;
    Noise(seed).convertTo(image, CV_16U, scale);
    return image;
  };
  // Twelve bits, the first frame darker by half.
  for (const int side : {0, 1}) {
    for (int i = 0; i < kFrames; ++i) cv::imwrite(ImagePath(side, i), deep(i, i == 0 ? 8 : 16));
  }
  const auto drive = KittiDrive::Open(drive_);
  ASSERT_TRUE(drive.ok()) << drive.status();
  EXPECT_LE(cv::norm((*drive)->Next()->left * 2, Noise(0), cv::NORM_INF), 2);
  EXPECT_LE(cv::norm((*drive)->Next()->right, Noise(1), cv::NORM_INF), 1);
}

TEST_F(KittiDriveTest, RefusesAnEmptyDrive) {
  for (int i = 0; i < kFrames; ++i) {
    fs::remove(ImagePath(0, i));
    fs::remove(ImagePath(1, i));
  }
  Write("times.txt", "");
  EXPECT_THAT(OpenError(), IsClear("image_0", "empty; "));
}

TEST_F(KittiDriveTest, RefusesBadTimes) {
  const auto error_with = [&](const std::string& text) {
    Write("times.txt", text);
    return OpenError();
  };
  EXPECT_THAT(error_with("0\n0.1\n0.05\n0.3\n"), IsClear("times.txt", "line 3: the time 0.05"));
  EXPECT_THAT(error_with("0\n0.1\nnan\n0.3\n"), IsClear("times.txt", "line 3"));
  EXPECT_THAT(error_with("0\n0.1\nsoon\n0.3\n"), HasSubstr("line 3"));
  EXPECT_THAT(error_with("0\n0.1 0.2\n0.3\n"), HasSubstr("line 2"));
  EXPECT_THAT(error_with("-9.1e9\n0.1\n0.2\n0.3\n"), HasSubstr("times.txt: line 1"));
  EXPECT_THAT(error_with("0\n0.1\n0.2\n9.19e9\n"), HasSubstr("count the times from"));
  EXPECT_THAT(error_with("0\n0.1\n0.2\n"), IsClear("times.txt", "3 times but the drive has 4"));
  EXPECT_THAT(error_with(""), IsClear("times.txt", "0 times"));
}

TEST_F(KittiDriveTest, RefusesBadCalibration) {
  const auto error_with = [&](const std::string& left, const std::string& right) {
    Write("calib.txt", left + right);
    return OpenError();
  };
  const std::string p0 = "P0: " + Projection(100, 0), p1 = "P1: " + Projection(100, -50);
  EXPECT_EQ(error_with(p0, p1), "");
  EXPECT_THAT(error_with(p0, ""), IsClear("calib.txt", "'P1:' is missing; "));
  EXPECT_THAT(error_with("", p1), IsClear("calib.txt", "'P0:' is missing; "));
  EXPECT_THAT(error_with("P0: 1 2 3\n", p1), IsClear("calib.txt", "12 numbers; "));
  EXPECT_THAT(error_with(p0 + p0, p1), IsClear("calib.txt", "twice; "));
  EXPECT_THAT(error_with("P0: nan 0 48 0 0 101 32 0 0 0 1 0\n", p1),
              IsClear("calib.txt", "nan or inf; "));
  EXPECT_THAT(error_with(p0, "P1: " + Projection(100, 50)), IsClear("calib.txt", "baseline"));
  EXPECT_THAT(error_with(p0, "P1: " + Projection(100, 0)), IsClear("calib.txt", "baseline"));
  EXPECT_THAT(error_with(p0, "P1: " + Projection(100.1, -50)), IsClear("calib.txt", "differ"));
  EXPECT_THAT(error_with("P0: " + Projection(-100, 0), "P1: " + Projection(-100, 50)),
              IsClear("calib.txt", "focal"));
  EXPECT_THAT(error_with("P0: " + Projection(100, 0, 480), "P1: " + Projection(100, -50, 480)),
              IsClear("calib.txt", "principal point (480, 32) is outside of the 96x64"));
  EXPECT_THAT(error_with("P0: 100 3 48 0 0 101 32 0 0 0 1 0\n", p1), HasSubstr("rectif"));
}

TEST_F(KittiDriveTest, RefusesARangeOutsideTheDrive) {
  EXPECT_THAT(OpenError({.first = 0, .last = 4}), IsClear("carmap_drive_test", "frames 0 to 3; "));
  EXPECT_THAT(OpenError({.first = 3, .last = 2}), HasSubstr("frames 3 to 2"));
  EXPECT_THAT(OpenError({.first = 9}), HasSubstr("frames 0 to 3"));
}

TEST_F(KittiDriveTest, RefusesBadTruth) {
  Write("poses.txt", "1 0 0 0 0 1 0 0 0 0 1 0\n");
  EXPECT_THAT(OpenError(), IsClear("poses.txt", "1 poses but the drive has 4 frames; "));
  Write("poses.txt", "0 0 0 0 0 0 0 1\n");
  EXPECT_THAT(OpenError(), IsClear("poses.txt", "TUM"));
  Write("poses.txt", "rubbish\n");
  EXPECT_THAT(OpenError(), IsClear("poses.txt", "line 1"));
}

TEST_F(KittiDriveTest, GivesFramesTheirFixes) {
  const auto fixes_with = [&](const std::string& text) {
    Write("gps.txt", text);
    const auto drive = KittiDrive::Open(drive_);
    EXPECT_TRUE(drive.ok()) << drive.status();
    std::vector<std::optional<GpsFix>> fixes;
    for (int i = 0; i < kFrames; ++i) fixes.push_back((*drive)->Next()->gps);
    return fixes;
  };
  // On the drive's clock: interpolated, then near the last row, then too far from it.
  auto fixes = fixes_with("# t lat lon alt\n-0.1 40 8 0 7 7\n0.1 42 9 10 7 7\n");
  EXPECT_EQ(fixes[0], (GpsFix{41, 8.5, 5}));
  EXPECT_EQ(fixes[1], (GpsFix{42, 9, 10}));
  EXPECT_EQ(fixes[2], (GpsFix{42, 9, 10}));
  EXPECT_FALSE(fixes[3]);
  // On a clock of its own: counted from the first row, which stands at the first frame.
  fixes = fixes_with("1317042145.964 40 8 0\n1317042146.164 42 9 10\n");
  EXPECT_EQ(fixes[0], (GpsFix{40, 8, 0}));
  EXPECT_NEAR(fixes[1]->latitude_deg, 41, 1e-9);
  EXPECT_EQ(fixes[2], (GpsFix{42, 9, 10}));
  // Rows out of turn, and moments without a fix.
  fixes = fixes_with("0.3 43 9 0\n0.1 41 9 0\n0.2 nan nan nan\n");
  EXPECT_NEAR(fixes[2]->latitude_deg, 42, 1e-9);
  // Nothing in it, and the date line.
  EXPECT_FALSE(fixes_with("# no fix\n")[0]);
  EXPECT_EQ(fixes_with("-0.01 40 179.9 0\n0.1 40 -179.9 0\n")[0], (GpsFix{40, 179.9, 0}));
}

TEST_F(KittiDriveTest, RefusesBadFixes) {
  Write("gps.txt", "0 49 8 0\n1 49 8\n");
  EXPECT_THAT(OpenError(), IsClear("gps.txt", "line 2"));
}

struct RealDrive {
  const char* name;
  size_t frames;
  StereoRig rig;
  bool has_gps;
};

class RealDriveTest : public testing::TestWithParam<RealDrive> {};

TEST_P(RealDriveTest, Opens) {
  const fs::path folder = DataFolder() / GetParam().name;
  if (!fs::exists(folder)) GTEST_SKIP() << folder << " is not there; set CARMAP_DATA";
  const auto drive = KittiDrive::Open(folder);
  ASSERT_TRUE(drive.ok()) << drive.status();
  EXPECT_EQ((*drive)->frame_count(), GetParam().frames);
  EXPECT_EQ((*drive)->truth().size(), GetParam().frames);
  EXPECT_EQ((*drive)->rig().camera.width, GetParam().rig.camera.width);
  EXPECT_EQ((*drive)->rig().camera.height, GetParam().rig.camera.height);
  EXPECT_NEAR((*drive)->rig().baseline_m, GetParam().rig.baseline_m, 1e-4);
  size_t frames = 0, fixes = 0;
  while (const auto frame = (*drive)->Next()) {
    ASSERT_TRUE(frame->status.ok()) << frame->status;
    EXPECT_EQ(frame->left.size(), frame->right.size());
    ++frames;
    if (frame->gps) ++fixes;
  }
  EXPECT_EQ(frames, GetParam().frames);
  EXPECT_EQ(fixes, GetParam().has_gps ? frames : 0);
}

INSTANTIATE_TEST_SUITE_P(
    Kitti, RealDriveTest,
    testing::Values(
        RealDrive{"kitti06_000-050", 51, {{.width = 1226, .height = 370}, 0.53715}, false},
        RealDrive{"kitti_raw_2011_09_26_0001", 108, {{.width = 397, .height = 120}, 0.53715}, true},
        RealDrive{"kitti_raw_2011_09_26_1405_000-199",
                  200,
                  {{.width = 1242, .height = 375}, 0.53715},
                  false}));

}  // namespace
}  // namespace carmap
