#include "carmap/feature/stereo_matcher.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "carmap/feature/orb_extractor.h"
#include "carmap/feature/test_images.h"

namespace carmap {
namespace {

StereoRig RigOfSize(int width, int height) {
  return {{500, 500, width / 2.0, height / 2.0, width, height}, 0.5};
}

std::vector<Feature> Match(const cv::Mat& left, const cv::Mat& right,
                           const StereoOptions& options = {}) {
  const ImagePyramid left_pyramid = BuildPyramid(left), right_pyramid = BuildPyramid(right);
  std::vector<Feature> features = OrbExtractor().Extract(left_pyramid);
  MatchStereo(left_pyramid, right_pyramid, RigOfSize(left.cols, left.rows), options, features);
  return features;
}

/// Features whose patch is inside the right image too.
template <typename Visit>
void VisitVisible(const std::vector<Feature>& features, double disparity_px, Visit&& visit) {
  for (const Feature& feature : features) {
    const double scale = ScaleOfLevel(feature.level);
    if (feature.x_px - disparity_px > 12 * scale) visit(feature, scale);
  }
}

struct Accuracy {
  double median_error_px, p95_error_px, matched_ratio;
};

/// Errors in pixels of the feature's level.
Accuracy AccuracyOf(const std::vector<Feature>& features, double disparity_px) {
  std::vector<double> errors;
  size_t visible = 0;
  VisitVisible(features, disparity_px, [&](const Feature& feature, double scale) {
    ++visible;
    if (feature.has_disparity())
      errors.push_back(std::abs(feature.disparity_px - disparity_px) / scale);
  });
  std::sort(errors.begin(), errors.end());
  return {errors.at(errors.size() / 2), errors.at(errors.size() * 95 / 100),
          static_cast<double>(errors.size()) / static_cast<double>(visible)};
}

size_t CountMatched(const std::vector<Feature>& features) {
  return std::count_if(features.begin(), features.end(),
                       [](const Feature& feature) { return feature.has_disparity(); });
}

TEST(MatchStereo, MeasuresDisparitiesToAFractionOfAPixel) {
  const Wall wall(640, 240, 1);
  for (const int fifths : {3, 16, 87, 304, 552}) {
    const Accuracy accuracy = AccuracyOf(Match(wall.Moved(0), wall.Moved(fifths)), fifths / 5.0);
    EXPECT_LT(accuracy.median_error_px, 0.025) << fifths;
    EXPECT_LT(accuracy.p95_error_px, 0.06) << fifths;
    EXPECT_GT(accuracy.matched_ratio, 0.95) << fifths;
  }
}

TEST(MatchStereo, BearsNoiseBrightnessAndRowsThatAreApart) {
  const Wall wall(640, 240, 2);
  const cv::Mat left = WithNoise(wall.Moved(0), 2, 3);
  for (const int fifths : {22, 188}) {
    for (const int fifths_down : {-2, 2}) {
      const cv::Mat right = wall.Moved(fifths, fifths_down) + cv::Scalar(8);
      const Accuracy accuracy = AccuracyOf(Match(left, WithNoise(right, 2, 4)), fifths / 5.0);
      EXPECT_LT(accuracy.median_error_px, 0.05) << fifths;
      EXPECT_LT(accuracy.p95_error_px, 0.15) << fifths;
      EXPECT_GT(accuracy.matched_ratio, 0.9) << fifths;
    }
  }
}

// Interpolation draws disparities a little towards half pixels; how far is bounded here.
TEST(MatchStereo, IsHardlyBiasedAtAnyFractionOfAPixel) {
  const Wall wall(640, 240, 3);
  for (const int fifths : {100, 101, 102, 103, 104}) {
    double sum = 0, count = 0;
    for (const Feature& feature : Match(wall.Moved(0), wall.Moved(fifths))) {
      const double error = feature.disparity_px - fifths / 5.0;
      if (feature.level > 0 || !feature.has_disparity() || std::abs(error) > 0.5) continue;
      sum += error;
      ++count;
    }
    EXPECT_GT(count, 200);
    EXPECT_NEAR(sum / count, 0, 0.015) << fifths;
  }
}

/// Posts in front of a wall, every 40 px from x = 60 on.
struct Posts {
  static constexpr int kWidthPx = 8, kWallPx = 20;  ///< the latter is the wall's disparity
  explicit Posts(int disparity_px) {
    const Wall wall(640, 240, 5), post(640, 240, 6);
    left = wall.Moved(0);
    right = wall.Moved(5 * kWallPx);
    for (int x = 60; x < 600; x += 40) {
      const cv::Rect in_left(x, 0, kWidthPx, left.rows);
      const cv::Rect in_right = in_left - cv::Point(disparity_px, 0);
      post.Moved(0)(in_left).copyTo(left(in_left));
      post.Moved(5 * disparity_px)(in_right).copyTo(right(in_right));
    }
  }
  /// Of a column, from the left side of the post before, or of the first.
  static int FromPost(float x_px) { return (static_cast<int>(x_px) + 20) % 40; }
  cv::Mat left, right;
};

TEST(MatchStereo, WhatLiesBehindHardlyDrawsTheDisparity) {
  constexpr int kNearPx = 21;
  const Posts posts(kNearPx);
  double sum = 0, count = 0;
  for (const Feature& feature : Match(posts.left, posts.right)) {
    const int from_post = Posts::FromPost(feature.x_px);
    if (feature.level > 0 || !feature.has_disparity() || from_post < 2 ||
        from_post >= Posts::kWidthPx - 2)
      continue;
    sum += feature.disparity_px - kNearPx;
    ++count;
  }
  EXPECT_GT(count, 30);
  EXPECT_NEAR(sum / count, 0, 0.1) << "posts narrower than the patch";
}

TEST(MatchStereo, GivesNoDepthAtTheEdgesOfThings) {
  const Posts posts(30);
  size_t beside = 0, beside_with_depth = 0, clear = 0, clear_with_depth = 0;
  for (const Feature& feature : Match(posts.left, posts.right)) {
    if (feature.level > 0 || feature.x_px < 60 || feature.x_px > 600) continue;
    const int from_post = Posts::FromPost(feature.x_px);
    if (from_post < Posts::kWidthPx + 3) {
      ++beside;
      beside_with_depth += feature.has_disparity();
    } else if (from_post > Posts::kWidthPx + 12 && from_post < 40 - 12) {
      ++clear;
      clear_with_depth += feature.has_disparity();
    }
  }
  EXPECT_GT(beside, 50);
  EXPECT_LT(beside_with_depth, beside * 3 / 5);
  EXPECT_GT(clear, 40);
  EXPECT_GT(clear_with_depth, clear * 9 / 10);
}

TEST(MatchStereo, RefusesRowsThatAreTooFarApart) {
  const cv::Mat left = Texture(640, 240, 4, 45);
  cv::Mat right(left.size(), CV_8UC1, cv::Scalar(128));
  left(cv::Rect(12, 0, 628, 236)).copyTo(right(cv::Rect(0, 4, 628, 236)));
  size_t matched = 0, total = 0;
  for (const Feature& feature : Match(left, right)) {
    if (ScaleOfLevel(feature.level) * 1.2 > 3) continue;  // so far apart is allowed there
    ++total;
    matched += feature.has_disparity();
  }
  EXPECT_GT(total, 500u);
  EXPECT_LT(matched, total / 20);
}

TEST(MatchStereo, FindsNothingWithoutTexture) {
  const cv::Mat flat(240, 640, CV_8UC1, cv::Scalar(128));
  const ImagePyramid left = BuildPyramid(flat), right = BuildPyramid(flat);
  std::vector<Feature> features(1, {.x_px = 320, .y_px = 120});
  MatchStereo(left, right, RigOfSize(640, 240), {}, features);
  EXPECT_FALSE(features[0].has_disparity());

  const cv::Mat textured = Texture(640, 240, 5, 45);
  EXPECT_EQ(CountMatched(Match(textured, flat)), 0u);
}

TEST(MatchStereo, FindsAlmostNothingInAnotherImage) {
  const auto features = Match(Texture(640, 240, 6, 45), Texture(640, 240, 7, 45));
  ASSERT_GT(features.size(), 1000u);
  EXPECT_LT(CountMatched(features), features.size() / 20);
}

TEST(MatchStereo, RefusesPatternsThatRepeat) {
  for (const double noise : {0.0, 2.0}) {
    cv::Mat stripes(240, 640, CV_8UC1);
    for (int x = 0; x < stripes.cols; ++x) stripes.col(x).setTo(x % 16 < 8 ? 90 : 160);
    const auto left = BuildPyramid(WithNoise(stripes, noise, 8));
    const auto right = BuildPyramid(WithNoise(stripes, noise, 9));
    std::vector<Feature> features;
    for (float x = 200; x < 600; x += 7) features.push_back({.x_px = x, .y_px = 120});
    MatchStereo(left, right, RigOfSize(640, 240), {}, features);
    // Noise alone makes one of the places look a fifth better now and then.
    EXPECT_LE(CountMatched(features), noise > 0 ? features.size() / 20 : 0) << "noise " << noise;
  }
}

TEST(MatchStereo, IgnoresPointsTooNearAndTooFar) {
  const Wall wall(640, 240, 10);
  const StereoOptions options{.min_depth_m = 5, .min_disparity_px = 3};  // 50 pixels at most
  const auto matched_ratio = [&](int fifths) {
    size_t matched = 0, visible = 0;
    VisitVisible(Match(wall.Moved(0), wall.Moved(fifths), options), fifths / 5.0,
                 [&](const Feature& feature, double) {
                   ++visible;
                   matched += feature.has_disparity();
                 });
    return static_cast<double>(matched) / static_cast<double>(visible);
  };
  EXPECT_LT(matched_ratio(350), 0.05);
  EXPECT_GT(matched_ratio(200), 0.9);
  EXPECT_LT(matched_ratio(7), 0.05);
}

TEST(MatchStereo, IsDeterministic) {
  const Wall wall(640, 240, 11);
  const cv::Mat left = wall.Moved(0), right = WithNoise(wall.Moved(47, 1), 3, 1);
  const auto first = Match(left, right), second = Match(left, right);
  ASSERT_EQ(first.size(), second.size());
  for (size_t i = 0; i < first.size(); ++i) {
    EXPECT_EQ(first[i].disparity_px, second[i].disparity_px);
    EXPECT_EQ(first[i].descriptor, second[i].descriptor);
  }
}

// What the address sanitizer would see: each pixel of small images at every level.
TEST(MatchStereo, StaysInsideTheImages) {
  for (const auto& [width, height] : {std::array{1, 1}, {64, 32}, {33, 47}, {80, 60}}) {
    const auto left = BuildPyramid(RandomPixels(width, height, 1));
    const auto right = BuildPyramid(RandomPixels(width, height, 1));
    std::vector<Feature> features;
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        features.push_back({.x_px = static_cast<float>(x),
                            .y_px = static_cast<float>(y),
                            .level = static_cast<uint8_t>((x + y) % kLevelCount)});
      }
    }
    MatchStereo(left, right, RigOfSize(width, height), {.min_depth_m = 0.1, .min_disparity_px = 0},
                features);
    for (const Feature& feature : features) {
      EXPECT_LT(feature.disparity_px, width);
    }
  }
}

TEST(MatchStereo, WorksOnSmallImages) {
  const Wall wall(397, 120, 12);
  const Accuracy accuracy = AccuracyOf(Match(wall.Moved(0), wall.Moved(32)), 6.4);
  EXPECT_LT(accuracy.median_error_px, 0.025);
  EXPECT_GT(accuracy.matched_ratio, 0.9);
}

}  // namespace
}  // namespace carmap
