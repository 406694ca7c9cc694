#include "carmap/format/tile_codec.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <utility>
#include <vector>

#include "carmap/base/byte_io.h"
#include "carmap/base/status_macros.h"
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
    if (i > 0 && diff.seen_again[i] <= diff.seen_again[i - 1]) {
      return absl::DataLossError("ids do not ascend");
    }
  }
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

absl::StatusOr<std::string> EncodeDiff(const MapDiff& diff, const LeanEncodeOptions& options) {
  std::string content;
  AppendUint(diff.part, content);
  AppendTileId(diff.frame, content);
  AppendUint(static_cast<uint32_t>(diff.seen_again.size()), content);
  for (const SameLandmark& same : diff.seen_again) {
    AppendId(same.in_base, content);
    AppendId(same.in_drive, content);
  }
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
