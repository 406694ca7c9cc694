#include "apps/carmap/program_runner.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdlib>
#include <sstream>

#include "carmap/base/file.h"

namespace carmap {

std::vector<std::string> Result::problems() const {
  std::vector<std::string> lines;
  std::istringstream stream(err);
  for (std::string line; std::getline(stream, line);) {
    if (line.rfind("carmap: ", 0) == 0) lines.push_back(line);
  }
  return lines;
}

Result RunProgram(const std::filesystem::path& folder, const std::vector<std::string>& arguments,
                  const std::filesystem::path& scratch, const std::string& redirection,
                  const std::string& preparation) {
  std::string command =
      fmt::format("cd '{}' &&\n{}\n'{}'", folder.string(), preparation, CARMAP_PROGRAM);
  for (const std::string& argument : arguments) command += " '" + argument + "'";
  const std::filesystem::path out = scratch / "stdout", err = scratch / "stderr";
  command += fmt::format(" >'{}' 2>'{}' {}", out.string(), err.string(), redirection);
  const int status = std::system(command.c_str());
  return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, Read(out), Read(err)};
}

std::string Read(const std::filesystem::path& path) {
  const auto bytes = ReadFile(path, uint64_t{1} << 30);
  EXPECT_TRUE(bytes.ok()) << bytes.status();
  return bytes.ok() ? *bytes : std::string();
}

}  // namespace carmap
