// Messages for people, on standard error.
#pragma once

#include <string_view>

namespace carmap {

/// Writes the text as it is. That nobody can read it is no error: no work is given up for a
/// message.
void WriteToStandardError(std::string_view text);

}  // namespace carmap
