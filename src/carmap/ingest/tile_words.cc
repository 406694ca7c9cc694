#include "carmap/ingest/tile_words.h"

#include <algorithm>

#include "carmap/base/byte_io.h"

namespace carmap {
namespace {

/// Of what has descriptors.
template <typename Described>
std::vector<uint32_t> DistinctWords(const Vocabulary& vocabulary,
                                    const std::vector<Described>& described) {
  std::vector<uint32_t> words;
  words.reserve(described.size());
  for (const Described& one : described) words.push_back(vocabulary.WordOf(one.descriptor));
  std::sort(words.begin(), words.end());
  words.erase(std::unique(words.begin(), words.end()), words.end());
  return words;
}

}  // namespace

std::vector<uint32_t> WordsOf(const Vocabulary& vocabulary, const LeanMap& map) {
  return DistinctWords(vocabulary, map.landmarks);
}

std::vector<uint32_t> WordsOf(const Vocabulary& vocabulary, const std::vector<Feature>& features) {
  return DistinctWords(vocabulary, features);
}

std::string EncodeWords(const std::vector<uint32_t>& words) {
  std::string bytes;
  uint32_t next = 0;
  for (const uint32_t word : words) {
    AppendVarint(word - next, bytes);
    next = word + 1;
  }
  return bytes;
}

absl::StatusOr<std::vector<uint32_t>> DecodeWords(std::string_view bytes) {
  std::vector<uint32_t> words;
  ByteReader reader(bytes);
  uint64_t next = 0;
  while (reader.remaining() > 0) {
    const uint64_t gap = reader.Varint();
    if (!reader.ok() || gap > UINT32_MAX - 1 || next + gap > UINT32_MAX - 1) {
      return absl::DataLossError("its words are damaged");
    }
    words.push_back(static_cast<uint32_t>(next + gap));
    next += gap + 1;
  }
  return words;
}

double ShareOfWords(const Vocabulary& vocabulary, const std::vector<uint32_t>& of_frame,
                    const std::vector<uint32_t>& of_tile) {
  double all = 0, shared = 0;
  auto word_of_tile = of_tile.begin();
  for (const uint32_t word : of_frame) {
    const double weight = word < vocabulary.word_count() ? vocabulary.WeightOf(word) : 0;
    word_of_tile = std::lower_bound(word_of_tile, of_tile.end(), word);
    all += weight;
    if (word_of_tile != of_tile.end() && *word_of_tile == word) shared += weight;
  }
  return all > 0 ? shared / all : 0;
}

}  // namespace carmap
