// Runs the program `carmap` as its users do, for tests.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace carmap {

struct Result {
  int exit_code = -1;  ///< -1: killed by a signal
  std::string out, err;

  /// Lines that tell of a problem; the others tell of progress.
  std::vector<std::string> problems() const;
};

/// Runs in `folder`; what it prints goes through the files stdout and stderr of `scratch`, unless
/// `redirection` sends it elsewhere. Before it the shell does what `preparation` says.
Result RunProgram(const std::filesystem::path& folder, const std::vector<std::string>& arguments,
                  const std::filesystem::path& scratch, const std::string& redirection = "",
                  const std::string& preparation = "");

/// A whole file; a test failure if there is none.
std::string Read(const std::filesystem::path& path);

}  // namespace carmap
