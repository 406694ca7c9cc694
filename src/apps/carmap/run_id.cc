#include "apps/carmap/run_id.h"

#include <fmt/format.h>
#include <xxhash.h>

#include <cstdint>
#include <filesystem>
#include <system_error>

#include "carmap/base/file.h"
#include "carmap/base/status_macros.h"

namespace carmap {

absl::StatusOr<DriveId> IdOfRun(const DriveId& drive, const std::string& options,
                                const std::vector<std::string>& files) {
  constexpr uint64_t kMaxFileBytes = uint64_t{1} << 30;
  std::string hashed = fmt::format("carmap " CARMAP_VERSION " {:016x} {}", drive.options, options);
  for (const std::string& file : files) {
    std::error_code is_folder;
    if (!std::filesystem::is_regular_file(file, is_folder)) continue;
    CARMAP_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(file, kMaxFileBytes));
    hashed += bytes;
  }
  return DriveId{drive.input, XXH3_64bits(hashed.data(), hashed.size())};
}

}  // namespace carmap
