// The name of a run over a recorded drive: the same run has the same one on every machine.
#pragma once

#include <absl/status/statusor.h>

#include <string>
#include <vector>

#include "carmap/base/ids.h"

namespace carmap {

/// The input's, and a hash of all else that changes the result: this version of the program, the
/// range of frames (`drive.options`), `options`, and what is in `files` (folders are the drive's
/// own, and are left out). Errors: those of reading a file.
absl::StatusOr<DriveId> IdOfRun(const DriveId& drive, const std::string& options,
                                const std::vector<std::string>& files);

}  // namespace carmap
