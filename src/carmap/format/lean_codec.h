// Lean maps as bytes and files (paper §3.1): what a vehicle sends and a disk keeps.
//
// No index, no keyframe feature, no pointer, no padding. docs/format.md specifies every byte. The
// same map gives the same bytes (with the same zstd library). Bytes from outside are trusted in
// nothing: a file cut, damaged, newer or made to exhaust memory is refused with one line.
// Thread-safe.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

#include "carmap/map/lean_map.h"

namespace carmap {

struct LeanEncodeOptions {
  int zstd_level = 19;  ///< 1 (fast) to 19 (small)

  absl::Status Validate() const;
};

/// Largest file that ReadLeanMap takes.
inline constexpr uint64_t kMaxLeanFileBytes = uint64_t{1} << 34;

/// Positions and poses are rounded as Quantize does. Errors: InvalidArgument for a map that is not
/// consistent, reaches beyond kMaxCoordinateM of lean_grid.h, or is larger than the format's
/// limits.
absl::StatusOr<std::string> EncodeLeanMap(const LeanMap& map,
                                          const LeanEncodeOptions& options = {});

/// XXH3 of the map's whole numbers: of the contents of all sections with no column compressed
/// (docs/format.md). The same on every machine, for maps that EncodeLeanMap takes.
uint64_t HashOf(const LeanMap& map);

/// The map is consistent in the sense of CheckConsistency. Errors, each one line with `name`, cause
/// and remedy: InvalidArgument (not a map file), Unimplemented (newer version), DataLoss (cut,
/// damaged), ResourceExhausted (counts beyond the limits, or far beyond what the file's size can
/// hold).
absl::StatusOr<LeanMap> DecodeLeanMap(std::string_view bytes, const std::string& name);

/// The map as it comes back from its bytes: Quantize(m) = decode(encode(m)), exactly, and
/// Quantize(Quantize(m)) = Quantize(m). For maps that EncodeLeanMap takes.
LeanMap Quantize(const LeanMap& map);

/// Errors: as ReadFile and DecodeLeanMap.
absl::StatusOr<LeanMap> ReadLeanMap(const std::filesystem::path& path);
/// Errors: as EncodeLeanMap and WriteFileAtomically.
absl::Status WriteLeanMap(const std::filesystem::path& path, const LeanMap& map,
                          const LeanEncodeOptions& options = {});

}  // namespace carmap
