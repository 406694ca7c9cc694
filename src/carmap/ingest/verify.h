// Whether a base is sound: each tile readable, consistent and what its patches made it.
#pragma once

#include <absl/status/statusor.h>

#include <cstddef>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "carmap/ingest/base_map.h"

namespace carmap {

/// Restores a base of which more than tiles is damaged (RepairRocksStore). Then Verify is to be
/// called. Errors: those of RepairRocksStore.
absl::StatusOr<StoreRepair> RepairStore(const std::filesystem::path& folder);

struct Verification {
  size_t tiles = 0, keyframes = 0, landmarks = 0, patches = 0, journal_entries = 0;
  std::vector<std::string> problems;  ///< a line each
  size_t repaired = 0;                ///< tiles made anew from their patches
  size_t histories_cut = 0;           ///< tiles whose patches were forgotten
  size_t short_histories = 0;         ///< tiles whose first patches are not kept
  size_t discarded = 0;               ///< tiles that were removed
  size_t lost_journal_entries = 0;    ///< of the entries
  size_t relisted_components = 0;     ///< of which tiles told
  size_t relisted_drives = 0;         ///< contributions of which the journal told
  size_t evidence_dropped = 0;        ///< tiles of which it is forgotten what passes saw
};

/// Called after each tile with how many were looked at.
using VerifyProgress = std::function<void(size_t done)>;

enum class Mending {
  kNone,
  /// Tiles that are damaged are made anew from their patches where these are whole, patches that
  /// lead nowhere are forgotten, and components and contributions that are not listed any more are
  /// listed; evidence that cannot be read is forgotten.
  kRepair,
  kDiscard  ///< also what cannot be made anew is removed, so that its road can be mapped again
};

/// Errors: those of the store that are not about a tile.
absl::StatusOr<Verification> Verify(BaseMap& base, Mending mending,
                                    const VerifyProgress& progress = {});

}  // namespace carmap
