// Numbers that look random and follow from their keys alone, the same on every machine.
#pragma once

#include <cmath>
#include <cstdint>

namespace carmap {

/// Mixes all bits of both (the finalizer of MurmurHash3, Appleby, public domain).
inline uint64_t HashKeys(uint64_t a, uint64_t b) {
  uint64_t h = a * 0x9e3779b97f4a7c15u + b + 0x632be59bd9b4e019u;
  h = (h ^ (h >> 33)) * 0xff51afd7ed558ccdu;
  h = (h ^ (h >> 33)) * 0xc4ceb9fe1a85ec53u;
  return h ^ (h >> 33);
}

/// In [0, 1).
inline double UnitHash(uint64_t a, uint64_t b) {
  return static_cast<double>(HashKeys(a, b) >> 11) * 0x1p-53;
}

/// A sequence of such numbers.
class HashSequence {
 public:
  explicit HashSequence(uint64_t seed) : seed_(seed) {}
  HashSequence(uint64_t seed, uint64_t stream) : seed_(HashKeys(seed, stream)) {}

  uint64_t Next() { return HashKeys(seed_, count_++); }
  double Unit() { return static_cast<double>(Next() >> 11) * 0x1p-53; }  ///< in [0, 1)
  double Between(double low, double high) { return low + (high - low) * Unit(); }
  /// In [0, count).
  uint32_t Below(uint32_t count) { return static_cast<uint32_t>(Unit() * count); }
  bool Chance(double probability) { return Unit() < probability; }
  /// Of mean 0 and standard deviation 1 (Box and Muller, 1958).
  double Normal() {
    const double radius = std::sqrt(-2 * std::log(1 - Unit()));
    return radius * std::cos(2 * M_PI * Unit());
  }

 private:
  uint64_t seed_, count_ = 0;
};

}  // namespace carmap
