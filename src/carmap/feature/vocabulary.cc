#include "carmap/feature/vocabulary.h"

#include <absl/status/status.h>
#include <fmt/format.h>

#include <span>
#include <utility>

#include "carmap/base/status_macros.h"
#include "carmap/feature/k_medians.h"

namespace carmap {
namespace {

absl::Status CheckShape(const VocabularyTables& tables) {
  const size_t nodes = tables.centers.size() + 1;
  if (tables.child_counts.empty() || tables.child_counts.back() == 0) {
    return absl::InvalidArgumentError("the list of inner nodes does not end with one");
  }
  if (nodes > kMaxVocabularyNodes || tables.child_counts.size() >= nodes) {
    return absl::InvalidArgumentError(
        fmt::format("{} nodes of which {} may be inner ones", nodes, tables.child_counts.size()));
  }
  size_t children = 0, inner = 0;
  for (size_t i = 0; i < tables.child_counts.size(); ++i) {
    if (tables.child_counts[i] == 0) continue;
    if (i > children) return absl::InvalidArgumentError(fmt::format("node {} has no parent", i));
    if (tables.child_counts[i] == 1) {
      return absl::InvalidArgumentError(fmt::format("node {} has one child", i));
    }
    children += tables.child_counts[i];
    ++inner;
  }
  if (children != nodes - 1 || tables.weights.size() != nodes - inner) {
    return absl::InvalidArgumentError(
        fmt::format("{} inner nodes with {} children, but {} centres and {} weights", inner,
                    children, tables.centers.size(), tables.weights.size()));
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<Vocabulary> Vocabulary::Create(VocabularyTables tables) {
  CARMAP_RETURN_IF_ERROR(CheckShape(tables));
  Vocabulary vocabulary;
  vocabulary.nodes_.resize(tables.centers.size() + 1);
  std::vector<uint8_t> depths(vocabulary.nodes_.size(), 0);
  uint32_t next_child = 1, next_word = 0;
  for (size_t i = 0; i < vocabulary.nodes_.size(); ++i) {
    Node& node = vocabulary.nodes_[i];
    node.child_count = i < tables.child_counts.size() ? tables.child_counts[i] : 0;
    if (node.child_count == 0) {
      node.first = next_word++;
      continue;
    }
    if (depths[i] == kMaxVocabularyDepth) {
      return absl::InvalidArgumentError(
          fmt::format("more than {} levels of nodes", kMaxVocabularyDepth));
    }
    node.first = next_child;
    for (uint32_t child = 0; child < node.child_count; ++child) {
      depths[next_child++] = static_cast<uint8_t>(depths[i] + 1);
    }
  }
  vocabulary.depth_ = depths.back();
  vocabulary.tables_ = std::move(tables);
  return vocabulary;
}

uint32_t Vocabulary::WordOf(const Descriptor& descriptor) const {
  const std::span<const Descriptor> centers = tables_.centers;
  const Node* node = nodes_.data();
  while (node->child_count > 0) {
    const auto of_children = centers.subspan(node->first - 1, node->child_count);
    node = &nodes_[node->first + NearestCenter(of_children, descriptor)];
  }
  return node->first;
}

}  // namespace carmap
