#include "apps/carmap/outputs.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <system_error>

#include "carmap/base/file.h"
#include "carmap/base/status_macros.h"

namespace carmap {
namespace {

namespace fs = std::filesystem;

/// Equal for two names of one file, whether it is there yet or not.
std::string Identity(const std::string& path) {
  std::error_code error;
  const fs::path canonical = fs::weakly_canonical(fs::absolute(path, error), error);
  return error ? path : canonical.string();
}

}  // namespace

void PrintProblem(const std::string& message) {
  std::string line = message;
  std::replace_if(
      line.begin(), line.end(), [](unsigned char c) { return c < ' ' || c == 0x7f; }, ' ');
  std::fflush(stdout);  // so that both streams in one file keep their order
  fmt::print(stderr, "carmap: {}\n", line);
}

absl::Status WithName(const std::string& name, const absl::Status& status) {
  if (status.ok()) return status;
  return {status.code(), fmt::format("{}: {}", name, std::string(status.message()))};
}

std::vector<std::string> FilesOfDrive(const std::string& folder) {
  std::vector<std::string> files;
  for (const char* name : {"calib.txt", "times.txt", "poses.txt", "gps.txt", "world.json"}) {
    files.push_back((fs::path(folder) / name).string());
  }
  return files;
}

absl::Status CheckOutputs(const std::vector<std::string>& outputs,
                          const std::vector<std::string>& inputs) {
  std::vector<std::string> taken;
  for (const std::string& input : inputs) taken.push_back(Identity(input));
  for (const std::string& output : outputs) {
    if (output.empty()) continue;
    CARMAP_RETURN_IF_ERROR(CheckWritable(output));
    const auto same = std::find(taken.begin(), taken.end(), Identity(output));
    if (same != taken.end()) {
      const bool is_input = static_cast<size_t>(same - taken.begin()) < inputs.size();
      return absl::InvalidArgumentError(
          fmt::format("{}: {}; choose another name", output,
                      is_input ? "is read by this command and would be overwritten"
                               : "is named twice for output"));
    }
    taken.push_back(Identity(output));
  }
  return absl::OkStatus();
}

absl::Status WriteReport(const std::string& path, const nlohmann::ordered_json& report) {
  return path.empty() ? absl::OkStatus() : WriteFileAtomically(path, JsonText(report));
}

std::string JsonText(const nlohmann::ordered_json& json) {
  constexpr int kIndent = 2;
  // Names of files may hold any bytes.
  return json.dump(kIndent, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

}  // namespace carmap
