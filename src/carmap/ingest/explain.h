// The history of a landmark or of a place in the base, in words.
#pragma once

#include <absl/status/statusor.h>

#include <string>
#include <vector>

#include "carmap/ingest/base_map.h"

namespace carmap {

/// `what` is a landmark, "DRIVE:INDEX" (the drive's hexadecimal id, or its first digits), or a
/// place on the Earth, "LATITUDE,LONGITUDE" in degrees. Lines for people. Errors: InvalidArgument
/// (neither), NotFound (nothing is there), those of the store.
absl::StatusOr<std::vector<std::string>> Explain(const std::string& what, const BaseMap& base);

}  // namespace carmap
