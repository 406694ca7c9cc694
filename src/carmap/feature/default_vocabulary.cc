#include "carmap/feature/default_vocabulary.h"

#include <cstddef>

#include "carmap/feature/vocabulary_file.h"

// The file's bytes, as they are.
asm(R"(
  .pushsection .rodata
  .balign 8
  carmap_default_vocabulary_begin:
  .incbin ")" CARMAP_DEFAULT_VOCABULARY R"("
  carmap_default_vocabulary_end:
  .popsection
)");
extern const char file_begin[] asm("carmap_default_vocabulary_begin");
extern const char file_end[] asm("carmap_default_vocabulary_end");

namespace carmap {

const Vocabulary& DefaultVocabulary() {
  static const Vocabulary vocabulary =
      DecodeVocabulary({file_begin, static_cast<size_t>(file_end - file_begin)},
                       CARMAP_DEFAULT_VOCABULARY)
          .value();
  return vocabulary;
}

}  // namespace carmap
