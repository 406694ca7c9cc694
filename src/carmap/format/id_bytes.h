// Ids of keyframes and landmarks as bytes: the drive's two halves, then the index.
//
// Stateless, thread-safe.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "carmap/base/byte_io.h"

namespace carmap {

inline constexpr size_t kIdBytes = 2 * sizeof(uint64_t) + sizeof(uint32_t);

template <typename Id>
void AppendId(const Id& id, std::string& out) {
  AppendUint(id.drive.input, out);
  AppendUint(id.drive.options, out);
  AppendUint(id.index, out);
}

template <typename Id>
Id ReadId(ByteReader& reader) {
  const auto input = reader.Uint<uint64_t>();
  const auto options = reader.Uint<uint64_t>();
  return {{input, options}, reader.Uint<uint32_t>()};
}

}  // namespace carmap
