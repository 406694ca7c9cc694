// Patches as files in a folder: what `carmap base add` leaves for vehicles that drive meanwhile.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "carmap/map/tile.h"
#include "carmap/store/map_store.h"

namespace carmap {

/// The patches that led to these versions, a file each, named by tile and version. Errors: those of
/// the store and of writing.
absl::Status WritePatches(const MapReader& reader, const std::vector<TileVersion>& versions,
                          const std::filesystem::path& folder);

/// Looks for patches that others write.
class PatchFolder {
 public:
  explicit PatchFolder(std::filesystem::path folder) : folder_(std::move(folder)) {}

  /// Those that came since the last call, by name; a folder that is not there is empty. A file that
  /// is no patch is looked at again: it may be half written.
  std::vector<Patch> New();

  /// Files that were no patches when they were looked at last, a line each.
  std::vector<std::string> Faults() const;

 private:
  const std::filesystem::path folder_;
  std::set<std::filesystem::path> known_;  ///< patches that were returned
  std::map<std::filesystem::path, std::string> faults_;
};

}  // namespace carmap
