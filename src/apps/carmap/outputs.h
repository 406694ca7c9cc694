// Where commands write: checked before the work begins, written whole or not at all, and each file
// whatever becomes of the others.
#pragma once

#include <absl/status/status.h>

#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace carmap {

/// Without anything that would begin a new line or steer a terminal.
std::string OneLine(std::string text);

/// A message on standard error, "carmap: …", of one line whatever is in it. That it cannot be
/// written is no error.
void PrintProblem(const std::string& message);

/// The status with "name: " before its message.
absl::Status WithName(const std::string& name, const absl::Status& status);

/// The files and folders of a drive that an output must not change.
std::vector<std::string> FilesOfDrive(const std::string& folder);

/// The folders of a base map that no output may lie in.
std::vector<std::string> FoldersOfBase(const std::string& folder);

/// Appends the files to the inputs.
void AddFiles(const std::vector<std::string>& files, std::vector<std::string>& inputs);

/// InvalidArgument if writing the output would change an input, through links too. An input that is
/// a folder stands for what is directly in it.
absl::Status CheckKeepsInputs(const std::string& output, const std::vector<std::string>& inputs);

/// Outputs that are not wanted are empty. Errors: an output cannot be written, or is the same file
/// as another; as CheckKeepsInputs.
absl::Status CheckOutputs(const std::vector<std::string>& outputs,
                          const std::vector<std::string>& inputs);

/// Errors: as WriteFileAtomically.
absl::Status WriteReport(const std::string& path, const nlohmann::ordered_json& report);

/// Writes what a command made, file by file: one that cannot be written costs none of the others.
class OutputFiles {
 public:
  /// Calls `write`, unless the path is empty. If it fails or throws, says so on standard error and
  /// returns false.
  bool Write(const std::string& path, const std::function<absl::Status()>& write);

  /// To be called last: whether all were written. If not, says on standard error which were.
  bool Finish() const;

 private:
  std::vector<std::string> written_, failed_;
};

/// As text for a file or for standard output, ending with a new line.
std::string JsonText(const nlohmann::ordered_json& json);

}  // namespace carmap
