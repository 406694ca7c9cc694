// A base map from above: its landmarks, keyframes and tiles, and what was added.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/index/map_view.h"
#include "carmap/ingest/base_map.h"

namespace carmap {

/// All tiles of a component. Takes time and memory in proportion to it.
absl::StatusOr<MapView> WholeComponent(const BaseMap& base, const Component& component);

/// Draws a component, or the one that the first of these drives is in, or else the largest; with
/// the keyframes of these drives by themselves. Errors: NotFound (no such component), those of
/// reading and writing.
absl::Status WriteBasePicture(const std::string& path, const BaseMap& base,
                              std::optional<uint32_t> component,
                              const std::vector<DriveId>& drives);

}  // namespace carmap
