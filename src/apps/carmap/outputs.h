// Where commands write: checked before the work begins, written whole or not at all.
#pragma once

#include <absl/status/status.h>

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace carmap {

/// A message on standard error, "carmap: …", of one line whatever is in it.
void PrintProblem(const std::string& message);

/// The status with "name: " before its message.
absl::Status WithName(const std::string& name, const absl::Status& status);

/// The files of a drive that an output must not overwrite.
std::vector<std::string> FilesOfDrive(const std::string& folder);

/// Outputs that are not wanted are empty. Errors: an output cannot be written, two are the same
/// file, or one would overwrite an input.
absl::Status CheckOutputs(const std::vector<std::string>& outputs,
                          const std::vector<std::string>& inputs);

/// Does nothing if the path is empty. Errors: as WriteFileAtomically.
absl::Status WriteReport(const std::string& path, const nlohmann::ordered_json& report);

/// As text for a file or for standard output, ending with a new line.
std::string JsonText(const nlohmann::ordered_json& json);

}  // namespace carmap
