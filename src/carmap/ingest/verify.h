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

/// What a repair of the store brought back of a base that cannot be opened (RepairRocksStore). Then
/// Verify is to be called. Errors: those of RepairRocksStore.
absl::StatusOr<StoreRepair> RepairStore(const std::filesystem::path& folder);

struct Verification {
  size_t tiles = 0, keyframes = 0, landmarks = 0, patches = 0, journal_entries = 0;
  std::vector<std::string> problems;  ///< a line each
  size_t repaired = 0;                ///< tiles made anew from their patches
  size_t relisted_components = 0;     ///< of which tiles told
  size_t relisted_drives = 0;         ///< contributions of which the journal told
};

/// Called after each tile with how many were looked at.
using VerifyProgress = std::function<void(size_t done)>;

/// With `repair`, tiles that are damaged are made anew from their patches where these are whole,
/// and components and contributions that are not listed any more are listed. Errors: those of the
/// store that are not about a tile.
absl::StatusOr<Verification> Verify(BaseMap& base, bool repair,
                                    const VerifyProgress& progress = {});

}  // namespace carmap
