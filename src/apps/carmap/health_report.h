// How a drive's verdict on itself is told.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "carmap/slam/drive_health.h"

namespace carmap {

nlohmann::ordered_json ToJson(const DriveHealth& health);
/// [{fault first_index last_index finding remedy}]
nlohmann::ordered_json ToJson(const std::vector<Suspicion>& suspicions);

/// {down_deg turn_deg}
nlohmann::ordered_json ToJson(const RowMisalignment& undone);

/// What was wrong with the right images and was undone; nothing of sound ones.
void PrintUndone(const RowMisalignment& undone);

/// The line "health  …" on standard output.
void PrintHealth(const DriveHealth& health);

/// Whether nothing is suspect; if not, says on standard error what, and what to do.
bool CheckSound(const std::vector<Suspicion>& suspicions, const std::string& drive);

}  // namespace carmap
