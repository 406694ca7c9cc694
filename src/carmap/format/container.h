// The container of a carmap file: magic, version, and checksummed sections.
//
// docs/format.md specifies it byte by byte. Reading trusts nothing: every length is checked against
// the bytes that are there before it is used, so memory stays within the file's own size.
// Thread-safe.
#pragma once

#include <absl/status/statusor.h>

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace carmap {

inline constexpr uint16_t kFormatMajor = 4;
inline constexpr uint16_t kFormatMinor = 0;

struct Section {
  uint16_t id = 0;
  /// A reader that does not know a mandatory section refuses the file; others it skips.
  bool is_mandatory = true;
  std::string content;
};

/// A section as it lies in the file's bytes, which must outlive it.
struct SectionView {
  uint16_t id = 0;
  bool is_mandatory = true;
  std::string_view content;
};

/// Sections by ascending id.
std::string WriteContainer(const std::vector<Section>& sections);

/// Checks the whole container: magic, version, checksums, nothing missing, nothing left over.
/// Errors, each one line with `name`, cause and remedy: InvalidArgument (not such a file),
/// Unimplemented (a newer version), DataLoss (cut short, damaged, followed by other bytes).
absl::StatusOr<std::vector<SectionView>> ReadContainer(std::string_view bytes,
                                                       const std::string& name);

}  // namespace carmap
