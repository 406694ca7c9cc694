#include "carmap/feature/vocabulary_trainer.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>
#include <utility>

#include "carmap/base/status_macros.h"
#include "carmap/feature/k_medians.h"

namespace carmap {
namespace {

using Images = std::vector<std::vector<Descriptor>>;

std::vector<Descriptor> AllDescriptors(const Images& images) {
  std::vector<Descriptor> all;
  size_t count = 0;
  for (const auto& image : images) count += image.size();
  all.reserve(count);
  for (const auto& image : images) all.insert(all.end(), image.begin(), image.end());
  return all;
}

/// The clusters of each node of a level, by the descriptors that came to it. No clusters: a leaf.
std::vector<std::vector<Cluster>> DivideLevel(std::span<const std::span<Descriptor>> nodes,
                                              size_t first_node, const VocabularyOptions& options) {
  std::vector<std::vector<Cluster>> clusters(nodes.size());
  tbb::parallel_for(size_t{0}, nodes.size(), [&](size_t i) {
    KMediansOptions k_medians{.cluster_count = options.branching};
    k_medians.seed = options.seed + (first_node + i) * 0x9e3779b97f4a7c15;  // one for each node
    clusters[i] = SortIntoClusters(k_medians, nodes[i]);
    if (clusters[i].size() < 2) clusters[i].clear();
  });
  return clusters;
}

/// Appends the next level to the tables; gives the descriptors of each of its nodes.
std::vector<std::span<Descriptor>> GrowLevel(std::span<const std::span<Descriptor>> nodes,
                                             const VocabularyOptions& options,
                                             VocabularyTables& tables) {
  const auto clusters_of = DivideLevel(nodes, tables.child_counts.size(), options);
  std::vector<std::span<Descriptor>> children;
  for (size_t i = 0; i < nodes.size(); ++i) {
    tables.child_counts.push_back(static_cast<uint8_t>(clusters_of[i].size()));
    std::span<Descriptor> left = nodes[i];
    for (const Cluster& cluster : clusters_of[i]) {
      tables.centers.push_back(cluster.center);
      children.push_back(left.first(cluster.size));
      left = left.subspan(cluster.size);
    }
  }
  return children;
}

VocabularyTables GrowTree(const Images& images, const VocabularyOptions& options,
                          const std::function<void()>& level_done) {
  VocabularyTables tables;
  std::vector<Descriptor> descriptors = AllDescriptors(images);
  std::vector<std::span<Descriptor>> level = {descriptors};
  for (size_t depth = 0; depth < options.depth; ++depth) {
    level = GrowLevel(level, options, tables);
    level_done();
  }
  while (!tables.child_counts.empty() && tables.child_counts.back() == 0) {
    tables.child_counts.pop_back();
  }
  const auto leaves = std::count(tables.child_counts.begin(), tables.child_counts.end(), 0);
  tables.weights.resize(tables.centers.size() + 1 - tables.child_counts.size() +
                        static_cast<size_t>(leaves));
  return tables;
}

/// In how many of the images each word occurs.
std::vector<uint32_t> ImagesOfWords(const Vocabulary& vocabulary, const Images& images) {
  std::vector<std::vector<uint32_t>> words_of(images.size());
  tbb::parallel_for(size_t{0}, images.size(), [&](size_t i) {
    std::vector<uint32_t>& words = words_of[i];
    for (const Descriptor& descriptor : images[i]) words.push_back(vocabulary.WordOf(descriptor));
    std::sort(words.begin(), words.end());
    words.erase(std::unique(words.begin(), words.end()), words.end());
  });
  std::vector<uint32_t> counts(vocabulary.word_count(), 0);
  for (const auto& words : words_of) {
    for (const uint32_t word : words) ++counts[word];
  }
  return counts;
}

/// A word that no image shows, since its descriptors have nearer ones elsewhere in the tree, weighs
/// as if one did.
uint16_t Weight(uint32_t images, uint32_t images_with_word) {
  const double ratio = static_cast<double>(images) / std::max(1u, images_with_word);
  const long weight = std::lround(Vocabulary::kWeightUnits * std::log(ratio));
  return static_cast<uint16_t>(std::min<long>(weight, std::numeric_limits<uint16_t>::max()));
}

}  // namespace

absl::Status VocabularyOptions::Validate() const {
  if (branching < 2 || branching > kMaxBranching) {
    return absl::InvalidArgumentError(
        fmt::format("branching {}; choose 2 to {}", branching, kMaxBranching));
  }
  if (depth < 1 || depth > kMaxVocabularyDepth) {
    return absl::InvalidArgumentError(
        fmt::format("depth {}; choose 1 to {}", depth, kMaxVocabularyDepth));
  }
  size_t nodes = 1, of_level = 1;
  for (size_t level = 0; level < depth && nodes <= kMaxVocabularyNodes; ++level) {
    of_level *= branching;
    nodes += of_level;
  }
  if (nodes > kMaxVocabularyNodes) {
    return absl::InvalidArgumentError(
        fmt::format("branching {} and depth {} make more than {} nodes; choose a smaller one",
                    branching, depth, kMaxVocabularyNodes));
  }
  return absl::OkStatus();
}

absl::StatusOr<Vocabulary> TrainVocabulary(const Images& images, const VocabularyOptions& options,
                                           const TrainingProgress& progress) {
  CARMAP_RETURN_IF_ERROR(options.Validate());
  if (images.size() < 2) {
    return absl::FailedPreconditionError(
        fmt::format("{} of at least two images to train with; take more", images.size()));
  }
  size_t done = 0;
  const auto step_done = [&] {
    if (progress) progress(++done, options.depth + 1);
  };
  VocabularyTables tables = GrowTree(images, options, step_done);
  if (tables.centers.empty()) {
    return absl::FailedPreconditionError(
        "the images do not show two different features; take others");
  }
  tables.training_images = static_cast<uint32_t>(images.size());
  CARMAP_ASSIGN_OR_RETURN(const Vocabulary unweighted, Vocabulary::Create(tables));
  const std::vector<uint32_t> counts = ImagesOfWords(unweighted, images);
  for (size_t word = 0; word < counts.size(); ++word) {
    tables.weights[word] = Weight(tables.training_images, counts[word]);
  }
  step_done();
  return Vocabulary::Create(std::move(tables));
}

}  // namespace carmap
