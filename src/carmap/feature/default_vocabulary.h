// The vocabulary that comes with the program, trained on simulated drives (`make vocabulary`).
#pragma once

#include "carmap/feature/vocabulary.h"

namespace carmap {

/// Part of the program, so always there; decoded when first asked for. Thread-safe.
const Vocabulary& DefaultVocabulary();

}  // namespace carmap
