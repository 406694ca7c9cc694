#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <mutex>

#include "carmap/base/status_macros.h"
#include "carmap/store/commit_check.h"
#include "carmap/store/map_store.h"
#include "carmap/store/snapshot_reads.h"

namespace carmap {
namespace {

constexpr std::string_view kName = "map store in memory";

using Text = std::shared_ptr<const std::string>;

Text Share(std::string text) { return std::make_shared<const std::string>(std::move(text)); }

struct TileState {
  uint64_t version = 0;
  Text bytes, words;                                        ///< null where the tile is removed
  std::vector<std::shared_ptr<const StoredPatch>> patches;  ///< ascending up to `version`
};

/// Copies share what the values hold.
struct State {
  Text header;
  std::map<TileId, TileState> tiles;
  std::map<uint32_t, Text> components;
  std::map<std::string, Text, std::less<>> contributions;
  std::vector<Text> journal;  ///< of sequence 1, 2, ...
};

class MemorySnapshot final : public MapReader {
 public:
  /// `mutex` guards how many share the state.
  MemorySnapshot(std::shared_ptr<const State> state, std::mutex& mutex)
      : state_(std::move(state)), mutex_(mutex) {}
  ~MemorySnapshot() override {
    const std::lock_guard lock(mutex_);
    state_.reset();
  }
  MemorySnapshot(const MemorySnapshot&) = delete;
  MemorySnapshot& operator=(const MemorySnapshot&) = delete;

  absl::StatusOr<std::string> Header() const override { return *state_->header; }

  absl::StatusOr<std::optional<StoredTile>> ReadTile(TileId tile) const override {
    const auto found = state_->tiles.find(tile);
    if (found == state_->tiles.end() || !found->second.bytes) return std::nullopt;
    return StoredTile{found->second.version, *found->second.bytes};
  }

  absl::StatusOr<uint64_t> VersionOf(TileId tile) const override {
    const auto found = state_->tiles.find(tile);
    return found == state_->tiles.end() ? 0 : found->second.version;
  }

  absl::StatusOr<std::vector<TileVersion>> ListTiles() const override {
    std::vector<TileVersion> tiles;
    tiles.reserve(state_->tiles.size());
    for (const auto& [tile, state] : state_->tiles) {
      tiles.push_back({tile, state.version, state.bytes == nullptr});
    }
    return tiles;
  }

  absl::Status VisitWords(
      const std::function<void(TileId, std::string_view)>& visit) const override {
    for (const auto& [tile, state] : state_->tiles) {
      if (state.words) visit(tile, *state.words);
    }
    return absl::OkStatus();
  }

  absl::StatusOr<std::vector<StoredPatch>> ReadPatches(TileId tile,
                                                       uint64_t after_version) const override {
    std::vector<StoredPatch> patches;
    const auto found = state_->tiles.find(tile);
    if (found == state_->tiles.end() || after_version >= found->second.version) return patches;
    const auto& kept = found->second.patches;
    const uint64_t count = found->second.version - after_version;
    if (count > kept.size()) return PatchesDropped(std::string(kName), tile, after_version);
    for (size_t i = kept.size() - count; i < kept.size(); ++i) patches.push_back(*kept[i]);
    return patches;
  }

  absl::StatusOr<std::vector<std::pair<uint32_t, std::string>>> ReadComponents() const override {
    std::vector<std::pair<uint32_t, std::string>> components;
    for (const auto& [component, text] : state_->components) {
      components.emplace_back(component, *text);
    }
    return components;
  }

  absl::StatusOr<std::optional<std::string>> ReadContribution(std::string_view key) const override {
    const auto found = state_->contributions.find(key);
    if (found == state_->contributions.end()) return std::nullopt;
    return *found->second;
  }

  absl::Status VisitContributions(
      std::string_view prefix,
      const std::function<absl::Status(std::string_view, std::string_view)>& visit) const override {
    for (auto it = state_->contributions.lower_bound(prefix);
         it != state_->contributions.end() && it->first.starts_with(prefix); ++it) {
      CARMAP_RETURN_IF_ERROR(visit(it->first, *it->second));
    }
    return absl::OkStatus();
  }

  absl::StatusOr<uint64_t> Sequence() const override { return state_->journal.size(); }
  absl::StatusOr<std::vector<JournalEntry>> ReadJournal(uint64_t first_sequence,
                                                        size_t max_count) const override {
    std::vector<JournalEntry> entries;
    for (uint64_t sequence = std::max<uint64_t>(first_sequence, 1);
         sequence <= state_->journal.size() && entries.size() < max_count; ++sequence) {
      entries.push_back({sequence, *state_->journal[sequence - 1]});
    }
    return entries;
  }

 private:
  std::shared_ptr<const State> state_;
  std::mutex& mutex_;
};

void ApplyTo(State& state, const TileChange& change) {
  TileState& tile = state.tiles[change.tile];
  ++tile.version;
  tile.bytes = change.bytes ? Share(*change.bytes) : nullptr;
  tile.words = change.bytes ? Share(change.words) : nullptr;
  tile.patches.push_back(
      std::make_shared<const StoredPatch>(StoredPatch{tile.version, change.patch, change.inverse}));
}

void ApplyTo(State& state, const Commit& commit) {
  for (const TileChange& change : commit.tiles) ApplyTo(state, change);
  for (const auto& [component, text] : commit.components) {
    if (text.empty()) {
      state.components.erase(component);
    } else {
      state.components[component] = Share(text);
    }
  }
  for (const auto& [key, value] : commit.contributions) state.contributions[key] = Share(value);
  for (const std::string& key : commit.withdrawn) state.contributions.erase(key);
  state.journal.push_back(Share(commit.journal_text));
}

class MemoryStore final : public SnapshotReads {
 public:
  explicit MemoryStore(std::string header) { state_->header = Share(std::move(header)); }

  absl::StatusOr<uint64_t> Apply(const Commit& commit) override {
    const std::lock_guard lock(mutex_);
    CARMAP_RETURN_IF_ERROR(CheckCommit(commit, Contents()));
    ApplyTo(OwnState(), commit);
    return state_->journal.size();
  }

  std::unique_ptr<const MapReader> Snapshot() const override {
    const std::lock_guard lock(mutex_);
    return std::make_unique<MemorySnapshot>(state_, mutex_);
  }

  absl::Status DropPatches(size_t kept) override {
    const std::lock_guard lock(mutex_);
    for (auto& [tile, state] : OwnState().tiles) {
      const size_t dropped = state.patches.size() - std::min(kept, state.patches.size());
      state.patches.erase(state.patches.begin(),
                          state.patches.begin() + static_cast<ptrdiff_t>(dropped));
    }
    return absl::OkStatus();
  }

  absl::Status DropPatchesOf(TileId tile) override {
    const std::lock_guard lock(mutex_);
    State& state = OwnState();
    if (const auto found = state.tiles.find(tile); found != state.tiles.end()) {
      found->second.patches.clear();
    }
    return absl::OkStatus();
  }

  absl::Status VerifyFiles() const override { return absl::OkStatus(); }

 private:
  StoreContents Contents() const {
    return {std::string(kName),
            [this](TileId tile) -> absl::StatusOr<TileVersion> {
              const auto found = state_->tiles.find(tile);
              if (found == state_->tiles.end()) return TileVersion{tile};
              return TileVersion{tile, found->second.version, found->second.bytes == nullptr};
            },
            [this](std::string_view key) -> absl::StatusOr<bool> {
              return state_->contributions.contains(key);
            }};
  }

  /// The state to write: a copy if a snapshot shares it.
  State& OwnState() {
    if (state_.use_count() > 1) state_ = std::make_shared<State>(*state_);
    return *state_;
  }

  mutable std::mutex mutex_;  ///< of state_ and of how many share it
  std::shared_ptr<State> state_ = std::make_shared<State>();
};

}  // namespace

std::unique_ptr<MapStore> MakeMemoryStore(std::string header) {
  return std::make_unique<MemoryStore>(std::move(header));
}

}  // namespace carmap
