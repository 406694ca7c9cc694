#include "carmap/format/tile_codec.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include "carmap/base/byte_io.h"
#include "carmap/base/status_macros.h"
#include "carmap/format/columns.h"
#include "carmap/format/id_bytes.h"
#include "carmap/format/lean_sections.h"

namespace carmap {
namespace {

void AppendTileId(const TileId& tile, std::string& out) {
  AppendUint(tile.component, out);
  AppendUint(tile.cell, out);
}

TileId ReadTileId(ByteReader& reader) {
  const auto component = reader.Uint<uint32_t>();
  return {component, reader.Uint<uint64_t>()};
}

template <typename Id>
void AppendIds(const std::vector<Id>& ids, std::string& out) {
  AppendUint(static_cast<uint32_t>(ids.size()), out);
  for (const Id& id : ids) AppendId(id, out);
}

/// Ascending ids, as many as there are bytes for at most.
template <typename Id>
absl::StatusOr<std::vector<Id>> ReadIds(ByteReader& reader) {
  const size_t count = reader.Uint<uint32_t>();
  if (count > reader.remaining() / kIdBytes) return absl::DataLossError("ids are missing");
  std::vector<Id> ids;
  ids.reserve(count);
  for (size_t i = 0; i < count; ++i) {
    ids.push_back(ReadId<Id>(reader));
    if (i > 0 && ids[i] <= ids[i - 1]) return absl::DataLossError("ids do not ascend");
  }
  return ids;
}

absl::Status CheckEnd(const ByteReader& reader) {
  if (reader.ok() && reader.remaining() == 0) return absl::OkStatus();
  return absl::DataLossError("wrong length");
}

absl::Status Malformed(const char* section, const absl::Status& status, const std::string& name) {
  return absl::DataLossError(fmt::format("{}: section '{}' is malformed ({}); fetch it again", name,
                                         section, std::string(status.message())));
}

absl::Status ReadPatchSection(std::string_view bytes, Patch& patch) {
  ByteReader reader(bytes);
  patch.tile = ReadTileId(reader);
  patch.from_version = reader.Uint<uint64_t>();
  patch.to_version = reader.Uint<uint64_t>();
  patch.hash = reader.Uint<uint64_t>();
  CARMAP_ASSIGN_OR_RETURN(patch.removed_keyframes, ReadIds<KeyframeId>(reader));
  CARMAP_ASSIGN_OR_RETURN(patch.removed_landmarks, ReadIds<LandmarkId>(reader));
  return CheckEnd(reader);
}

constexpr size_t kSightingsPerByte = 4, kSightingBits = 2;
/// Of sightings, by the bytes of their column: so memory is linear in the bytes of a file.
constexpr size_t kMaxSightingsPerByte = 64;

size_t SightingBytes(size_t sightings) {
  return (sightings + kSightingsPerByte - 1) / kSightingsPerByte;
}

void AppendSightings(const std::vector<TileSightings>& sightings, int zstd_level,
                     std::string& out) {
  AppendUint(static_cast<uint32_t>(sightings.size()), out);
  std::vector<Sighting> all;
  for (const TileSightings& tile : sightings) {
    AppendTileId(tile.tile, out);
    AppendUint(tile.version, out);
    AppendUint(static_cast<uint32_t>(tile.of_landmarks.size()), out);
    all.insert(all.end(), tile.of_landmarks.begin(), tile.of_landmarks.end());
  }
  std::string packed(SightingBytes(all.size()), '\0');
  for (size_t i = 0; i < all.size(); ++i) {
    char& byte = packed[i / kSightingsPerByte];
    const size_t shift = kSightingBits * (i % kSightingsPerByte);
    byte = static_cast<char>(static_cast<uint8_t>(byte) | static_cast<size_t>(all[i]) << shift);
  }
  std::string column;
  AppendByteColumn(packed, zstd_level, column);
  if (column.size() * kMaxSightingsPerByte < all.size()) {
    column.clear();
    AppendByteColumn(packed, /*zstd_level=*/0, column);
  }
  out += column;
}

absl::Status ReadSightings(ByteReader& reader, std::vector<TileSightings>& sightings) {
  constexpr size_t kTileBytes = 24;
  const size_t tiles = reader.Uint<uint32_t>();
  if (tiles > reader.remaining() / kTileBytes) return absl::DataLossError("tiles are missing");
  std::vector<size_t> counts;
  size_t total = 0;
  for (size_t i = 0; i < tiles; ++i) {
    TileSightings& tile = sightings.emplace_back();
    tile.tile = ReadTileId(reader);
    tile.version = reader.Uint<uint64_t>();
    counts.push_back(reader.Uint<uint32_t>());
    total += counts.back();
  }
  if (total > reader.remaining() * kMaxSightingsPerByte) {
    return absl::DataLossError("sightings are missing");
  }
  CARMAP_ASSIGN_OR_RETURN(const std::string packed, ReadByteColumn(reader, SightingBytes(total)));
  const auto at = [&](size_t i) {
    const unsigned byte = static_cast<uint8_t>(packed[i / kSightingsPerByte]);
    return byte >> (kSightingBits * (i % kSightingsPerByte)) & 3;
  };
  size_t place = 0;
  for (size_t i = 0; i < tiles; ++i) {
    for (size_t k = 0; k < counts[i]; ++k) {
      sightings[i].of_landmarks.push_back(static_cast<Sighting>(at(place++)));
    }
  }
  for (; place < packed.size() * kSightingsPerByte; ++place) {
    if (at(place) != 0) return absl::DataLossError("sightings of no landmark");
  }
  return absl::OkStatus();
}

absl::Status ReadDiffSection(std::string_view bytes, MapDiff& diff) {
  ByteReader reader(bytes);
  diff.part = reader.Uint<uint32_t>();
  diff.frame = ReadTileId(reader);
  const size_t count = reader.Uint<uint32_t>();
  if (count > reader.remaining() / (2 * kIdBytes)) return absl::DataLossError("ids are missing");
  diff.seen_again.reserve(count);
  for (size_t i = 0; i < count; ++i) {
    const auto in_base = ReadId<LandmarkId>(reader);
    diff.seen_again.push_back({in_base, ReadId<LandmarkId>(reader)});
  }
  CARMAP_RETURN_IF_ERROR(ReadSightings(reader, diff.sightings));
  CARMAP_RETURN_IF_ERROR(CheckOrder(diff));
  return CheckEnd(reader);
}

Section Added(AddedSection id, std::string content) {
  return {static_cast<uint16_t>(id), true, std::move(content)};
}

}  // namespace

absl::StatusOr<std::string> EncodeTile(const Tile& tile, const LeanEncodeOptions& options) {
  std::string content;
  AppendTileId(tile.id, content);
  AppendUint(tile.version, content);
  return EncodeWithSection(tile.map, Added(AddedSection::kTile, std::move(content)), options);
}

absl::StatusOr<Tile> DecodeTile(std::string_view bytes, const std::string& name) {
  CARMAP_ASSIGN_OR_RETURN(DecodedSections decoded,
                          DecodeWithSection(bytes, AddedSection::kTile, name));
  ByteReader reader(decoded.added);
  Tile tile;
  tile.id = ReadTileId(reader);
  tile.version = reader.Uint<uint64_t>();
  tile.map = std::move(decoded.map);
  if (const absl::Status status = CheckEnd(reader); !status.ok()) {
    return Malformed("tile", status, name);
  }
  return tile;
}

absl::StatusOr<std::string> EncodePatch(const Patch& patch, const LeanEncodeOptions& options) {
  std::string content;
  AppendTileId(patch.tile, content);
  for (const uint64_t number : {patch.from_version, patch.to_version, patch.hash}) {
    AppendUint(number, content);
  }
  AppendIds(patch.removed_keyframes, content);
  AppendIds(patch.removed_landmarks, content);
  return EncodeWithSection(patch.put, Added(AddedSection::kPatch, std::move(content)), options);
}

absl::StatusOr<Patch> DecodePatch(std::string_view bytes, const std::string& name) {
  CARMAP_ASSIGN_OR_RETURN(DecodedSections decoded,
                          DecodeWithSection(bytes, AddedSection::kPatch, name));
  Patch patch;
  if (const absl::Status status = ReadPatchSection(decoded.added, patch); !status.ok()) {
    return Malformed("patch", status, name);
  }
  patch.put = std::move(decoded.map);
  return patch;
}

bool IsDiff(std::string_view bytes) {
  const auto sections = ReadContainer(bytes, "");
  return sections.ok() && std::any_of(sections->begin(), sections->end(), [](const auto& section) {
           return section.id == static_cast<uint16_t>(AddedSection::kDiff);
         });
}

absl::StatusOr<std::string> EncodeDiff(const MapDiff& diff, const LeanEncodeOptions& options) {
  CARMAP_RETURN_IF_ERROR(CheckOrder(diff));
  std::string content;
  AppendUint(diff.part, content);
  AppendTileId(diff.frame, content);
  AppendUint(static_cast<uint32_t>(diff.seen_again.size()), content);
  for (const SameLandmark& same : diff.seen_again) {
    AppendId(same.in_base, content);
    AppendId(same.in_drive, content);
  }
  AppendSightings(diff.sightings, options.zstd_level, content);
  return EncodeWithSection(diff.drive, Added(AddedSection::kDiff, std::move(content)), options);
}

absl::StatusOr<MapDiff> DecodeDiff(std::string_view bytes, const std::string& name) {
  CARMAP_ASSIGN_OR_RETURN(DecodedSections decoded,
                          DecodeWithSection(bytes, AddedSection::kDiff, name));
  MapDiff diff;
  if (const absl::Status status = ReadDiffSection(decoded.added, diff); !status.ok()) {
    return Malformed("diff", status, name);
  }
  diff.drive = std::move(decoded.map);
  return diff;
}

Patch MakePatch(const Tile& from, const Tile& to) {
  Patch patch = DifferenceOf(from, to);
  patch.hash = HashOf(to.map);
  return patch;
}

absl::StatusOr<Tile> AppliedAndVerified(const Patch& patch, const Tile& tile) {
  CARMAP_ASSIGN_OR_RETURN(Tile next, Applied(patch, tile));
  if (HashOf(next.map) == patch.hash) return next;
  return absl::DataLossError(fmt::format(
      "the patch to version {} leaves another tile than it should: the tile before it, or the "
      "patch, is damaged; fetch the tile",
      patch.to_version));
}

}  // namespace carmap
