// Chooses the comparisons that make a signature, by measurement (docs/decisions/0019).
//
// Pure function; runs on all cores, and the result does not depend on how many there are.
#pragma once

#include <absl/functional/function_ref.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "carmap/feature/signature.h"

namespace carmap {

/// The smoothed pixels around a corner that a comparison may take, row by row.
using SignaturePatch = std::array<uint8_t, (2 * kSignatureRadius + 1) * (2 * kSignatureRadius + 1)>;

/// A corner, the same corner in another image, and another corner that is easily taken for it.
struct PatchTriple {
  SignaturePatch corner, same, other;
};

struct SelectionOptions {
  size_t candidates = 8000;       ///< drawn, to choose from
  size_t tests = kSignatureBits;  ///< to choose, fewer than candidates
  uint64_t seed = 1;              ///< of the draw
};

/// One after the other the candidate that, with those before it, sets the distances of `same` from
/// `corner` and those of `other` furthest apart: the difference of their means over their standard
/// deviations. Tests that tell what others told already do not help, as they widen both. `triples`
/// is not empty. `progress` is told how many are chosen.
std::vector<SignatureTest> SelectTests(const std::vector<PatchTriple>& triples,
                                       const SelectionOptions& options,
                                       absl::FunctionRef<void(size_t chosen)> progress);

}  // namespace carmap
