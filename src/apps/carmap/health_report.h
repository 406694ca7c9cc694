// How a drive's verdict on itself is told.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "carmap/dataset/gps_use.h"
#include "carmap/slam/drive_health.h"

namespace carmap {

/// With `gps` of a drive that has any.
nlohmann::ordered_json ToJson(const DriveHealth& health, const std::optional<GpsUse>& gps);
/// [{fault first_index last_index finding remedy}]
nlohmann::ordered_json ToJson(const std::vector<Suspicion>& suspicions);

/// {down_deg turn_deg}
nlohmann::ordered_json ToJson(const RowMisalignment& undone);

/// What was wrong with the right images and was undone; nothing of sound ones.
void PrintUndone(const RowMisalignment& undone);

/// The lines "health  …" and "gps  …" on standard output.
void PrintHealth(const DriveHealth& health, const std::optional<GpsUse>& gps);

/// Whether nothing is suspect; if not, says on standard error what, and what to do.
bool CheckSound(const std::vector<Suspicion>& suspicions, const std::string& drive);

/// Whether the drive's GPS agrees with it, or there is none; if not, says why on standard error.
bool CheckGps(const std::optional<GpsUse>& gps, const std::string& drive);

}  // namespace carmap
