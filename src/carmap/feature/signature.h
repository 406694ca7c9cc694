// The signature of a corner (paper §2): comparisons of the smoothed image around it (BRIEF,
// Calonder et al. 2010), upright (docs/decisions/0002-upright-descriptors.md).
//
// The comparisons were chosen by `make signature` for telling a corner from those around it, in
// another light (docs/decisions/0019-tests-chosen-by-measurement.md). Maps of all vehicles must
// agree on them, and on their order. Pure functions.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <opencv2/core/mat.hpp>

#include "carmap/feature/feature.h"

namespace carmap {

/// How far from the corner's pixel pixels are compared, on both axes.
inline constexpr int kSignatureRadius = 15;

/// Whether the pixel at (a_x, a_y) from the corner is darker than the one at (b_x, b_y).
struct SignatureTest {
  int8_t a_x, a_y, b_x, b_y;
  auto operator<=>(const SignatureTest&) const = default;
};

/// Bit i of a descriptor is test i.
extern const std::array<SignatureTest, kSignatureBits> kSignatureTests;

/// For corners of one image.
class SignatureSampler {
 public:
  /// `smooth`: a level of the pyramid after SmoothImage.
  explicit SignatureSampler(const cv::Mat& smooth);

  /// The corner must lie kSignatureRadius inside the image.
  Descriptor At(int x, int y) const;

 private:
  const cv::Mat& smooth_;
  std::array<std::array<ptrdiff_t, 2>, kSignatureBits>
      offsets_;  ///< of the compared pixels from the corner's
};

}  // namespace carmap
