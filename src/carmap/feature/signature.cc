#include "carmap/feature/signature.h"

namespace carmap {

const std::array<SignatureTest, kSignatureBits> kSignatureTests = {{
#include "carmap/feature/signature_tests.inc"
}};

SignatureSampler::SignatureSampler(const cv::Mat& smooth) : smooth_(smooth) {
  const auto stride = static_cast<ptrdiff_t>(smooth.step[0]);
  for (size_t i = 0; i < offsets_.size(); ++i) {
    const SignatureTest& test = kSignatureTests[i];
    offsets_[i] = {test.a_x + test.a_y * stride, test.b_x + test.b_y * stride};
  }
}

Descriptor SignatureSampler::At(int x, int y) const {
  const uint8_t* const center = smooth_.ptr<uint8_t>(y, x);
  Descriptor descriptor;
  for (size_t word = 0; word < descriptor.words.size(); ++word) {
    uint64_t bits = 0;
    for (size_t bit = 0; bit < 64; ++bit) {
      const auto& [a, b] = offsets_[64 * word + bit];
      bits |= static_cast<uint64_t>(center[a] < center[b]) << bit;
    }
    descriptor.words[word] = bits;
  }
  return descriptor;
}

}  // namespace carmap
