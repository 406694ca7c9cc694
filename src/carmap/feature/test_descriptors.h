// Descriptors for tests: random ones, and ones that resemble a given one. The same on each machine.
#pragma once

#include <cstddef>
#include <cstdint>
#include <random>
#include <vector>

#include "carmap/feature/feature.h"

namespace carmap {

inline Descriptor RandomDescriptor(std::mt19937_64& random) {
  Descriptor descriptor;
  for (uint64_t& word : descriptor.words) word = random();
  return descriptor;
}

/// `flips` times a bit is turned; a bit may be turned back.
inline Descriptor WithFlippedBits(Descriptor descriptor, int flips, std::mt19937_64& random) {
  for (int i = 0; i < flips; ++i) {
    const uint64_t bit = random() % kSignatureBits;
    descriptor.words[bit / 64] ^= uint64_t{1} << (bit % 64);
  }
  return descriptor;
}

/// As if `places` different things were seen by `images` cameras, each of them some of the time.
inline std::vector<std::vector<Descriptor>> DescriptorsOfImages(size_t images, size_t places,
                                                                uint64_t seed) {
  std::mt19937_64 random(seed);
  std::vector<Descriptor> of_place(places);
  for (Descriptor& descriptor : of_place) descriptor = RandomDescriptor(random);
  std::vector<std::vector<Descriptor>> of_image(images);
  for (auto& descriptors : of_image) {
    for (const Descriptor& place : of_place) {
      if (random() % 2 == 0) descriptors.push_back(WithFlippedBits(place, 10, random));
    }
  }
  return of_image;
}

}  // namespace carmap
