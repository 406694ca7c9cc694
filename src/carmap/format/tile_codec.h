// Tiles, patches and diffs as bytes: what stores keep and messages carry.
//
// Lean maps with one section more (docs/format.md). Bytes from outside are trusted in nothing, as
// by the lean map's own codec. Thread-safe.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <string>
#include <string_view>

#include "carmap/format/lean_codec.h"
#include "carmap/map/map_diff.h"
#include "carmap/map/tile.h"

namespace carmap {

/// Tiles are written often: 3 takes a part of the time of 19, and 2 % more bytes.
inline constexpr LeanEncodeOptions kTileEncoding{.zstd_level = 3};

/// Errors of all: as EncodeLeanMap and DecodeLeanMap.
absl::StatusOr<std::string> EncodeTile(const Tile& tile,
                                       const LeanEncodeOptions& options = kTileEncoding);
absl::StatusOr<Tile> DecodeTile(std::string_view bytes, const std::string& name);

absl::StatusOr<std::string> EncodePatch(const Patch& patch,
                                        const LeanEncodeOptions& options = kTileEncoding);
absl::StatusOr<Patch> DecodePatch(std::string_view bytes, const std::string& name);

/// Whether the bytes are a sound container of a diff.
bool IsDiff(std::string_view bytes);
absl::StatusOr<std::string> EncodeDiff(const MapDiff& diff,
                                       const LeanEncodeOptions& options = kTileEncoding);
absl::StatusOr<MapDiff> DecodeDiff(std::string_view bytes, const std::string& name);

/// The patch from one version of a tile to the next, whose maps are as they come back from their
/// bytes (Quantize).
Patch MakePatch(const Tile& from, const Tile& to);

/// The tile as the patch leaves it, its hash compared. Errors: those of Applied; DataLoss (another
/// hash: the tile or the patch is not what it was; fetch the tile).
absl::StatusOr<Tile> AppliedAndVerified(const Patch& patch, const Tile& tile);

}  // namespace carmap
