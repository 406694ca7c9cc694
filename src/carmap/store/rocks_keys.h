// Keys of a base map in RocksDB, big-endian, so that their order is that of the ids; and what is
// kept with the values. Stateless, thread-safe.
#pragma once

#include <bit>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "carmap/base/byte_io.h"
#include "carmap/base/ids.h"
#include "carmap/store/map_store.h"

namespace carmap {

inline constexpr uint32_t kStoreFormat = 1;

// In Family::kMeta.
inline constexpr std::string_view kFormatKey = "F";
inline constexpr std::string_view kHeaderKey = "H";
inline constexpr std::string_view kSequenceKey = "S";
inline constexpr char kComponentPrefix = 'c';
inline constexpr char kVersionPrefix = 't';

template <std::unsigned_integral T>
void AppendBigEndian(T value, std::string& out) {
  for (size_t shift = 8 * sizeof(T); shift > 0; shift -= 8) {
    out.push_back(static_cast<char>(static_cast<uint8_t>(value >> (shift - 8))));
  }
}

/// 0 of bytes that are too few.
template <std::unsigned_integral T>
T ReadBigEndian(std::string_view bytes) {
  if (bytes.size() < sizeof(T)) return 0;
  T value = 0;
  for (size_t i = 0; i < sizeof(T); ++i) {
    value = static_cast<T>(value << 8 | static_cast<uint8_t>(bytes[i]));
  }
  return value;
}

/// A key in every family that is no other's: longer than one of a contribution may be.
inline std::string FamilyMarker() { return std::string(kMaxKeySize + 1, '\xff'); }

inline std::string SequenceKey(uint64_t sequence) {
  std::string key;
  AppendBigEndian(sequence, key);
  return key;
}

inline std::string TileKey(TileId tile) {
  std::string key;
  AppendBigEndian(tile.component, key);
  AppendBigEndian(tile.cell, key);
  return key;
}

inline std::string VersionKey(TileId tile) { return kVersionPrefix + TileKey(tile); }

inline std::string PatchKey(TileId tile, uint64_t to_version) {
  return TileKey(tile) + SequenceKey(to_version);
}

inline std::string ComponentKey(uint32_t component) {
  std::string key(1, kComponentPrefix);
  AppendBigEndian(component, key);
  return key;
}

/// The tile of a TileKey, or of what begins with one.
inline TileId TileOfKey(std::string_view key) {
  return {ReadBigEndian<uint32_t>(key), ReadBigEndian<uint64_t>(key.substr(4))};
}
inline TileId TileOfVersionKey(std::string_view key) { return TileOfKey(key.substr(1)); }
inline constexpr size_t kVersionKeySize = 13;

inline std::string EncodeVersion(uint64_t version, bool is_removed) {
  std::string bytes;
  AppendUint(version, bytes);
  AppendUint(static_cast<uint8_t>(is_removed), bytes);
  return bytes;
}

/// Nothing if the bytes are no version.
inline std::optional<TileVersion> DecodeVersion(TileId tile, std::string_view bytes) {
  ByteReader reader(bytes);
  const uint64_t version = reader.Uint<uint64_t>();
  const uint8_t is_removed = reader.Uint<uint8_t>();
  if (!reader.ok() || reader.remaining() != 0 || version == 0 || is_removed > 1) return {};
  return TileVersion{tile, version, is_removed == 1};
}

/// A tile's bytes or words with the version that they are of.
inline std::string EncodeVersioned(uint64_t version, std::string_view bytes) {
  std::string out;
  out.reserve(sizeof(version) + bytes.size());
  AppendUint(version, out);
  out += bytes;
  return out;
}

inline std::string EncodePatch(std::string_view patch, std::string_view inverse) {
  std::string out;
  AppendUint(static_cast<uint64_t>(patch.size()), out);
  out += patch;
  out += inverse;
  return out;
}

inline std::optional<StoredPatch> DecodePatch(uint64_t to_version, std::string_view bytes) {
  ByteReader reader(bytes);
  const std::string_view patch = reader.Bytes(reader.Uint<uint64_t>());
  const std::string_view inverse = reader.Bytes(reader.remaining());
  if (!reader.ok()) return {};
  return StoredPatch{to_version, std::string(patch), std::string(inverse)};
}

}  // namespace carmap
