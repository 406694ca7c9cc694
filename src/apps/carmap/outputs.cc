#include "apps/carmap/outputs.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <system_error>

#include "carmap/base/exceptions.h"
#include "carmap/base/file.h"
#include "carmap/base/standard_error.h"
#include "carmap/base/status_macros.h"

namespace carmap {
namespace {

namespace fs = std::filesystem;

/// The input that writing the output would change: a file, or a folder that would get one more.
std::optional<std::string> ChangedInput(const std::string& output, const std::string& input) {
  std::error_code error;
  if (!fs::is_directory(input, error)) {
    return IsSameFile(output, input) ? std::optional(input) : std::nullopt;
  }
  if (IsInFolder(output, input)) return input;
  if (!fs::exists(output, error)) return std::nullopt;
  for (fs::directory_iterator file(input, error), end; !error && file != end;
       file.increment(error)) {
    if (IsSameFile(output, file->path())) return file->path().string();
  }
  return std::nullopt;
}

}  // namespace

std::string OneLine(std::string text) {
  std::replace_if(
      text.begin(), text.end(), [](unsigned char c) { return c < ' ' || c == 0x7f; }, ' ');
  return text;
}

void PrintProblem(const std::string& message) {
  std::fflush(stdout);  // so that both streams in one file keep their order
  WriteToStandardError(fmt::format("carmap: {}\n", OneLine(message)));
}

absl::Status WithName(const std::string& name, const absl::Status& status) {
  if (status.ok()) return status;
  return {status.code(), fmt::format("{}: {}", name, std::string(status.message()))};
}

std::vector<std::string> FilesOfDrive(const std::string& folder) {
  std::vector<std::string> files;
  for (const char* name : {"image_0", "image_1", "image_2", "image_3", "calib.txt", "times.txt",
                           "poses.txt", "gps.txt", "world.json"}) {
    files.push_back((fs::path(folder) / name).string());
  }
  return files;
}

std::vector<std::string> FoldersOfBase(const std::string& folder) {
  std::vector<std::string> folders = {folder};
  std::error_code error;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder, error)) {
    if (entry.is_directory(error)) folders.push_back(entry.path().string());
  }
  return folders;
}

void AddFiles(const std::vector<std::string>& files, std::vector<std::string>& inputs) {
  inputs.insert(inputs.end(), files.begin(), files.end());
}

absl::Status CheckKeepsInputs(const std::string& output, const std::vector<std::string>& inputs) {
  for (const std::string& input : inputs) {
    if (const auto changed = ChangedInput(output, input)) {
      return absl::InvalidArgumentError(fmt::format(
          "{}: would change {}, which this command reads; choose another name", output, *changed));
    }
  }
  return absl::OkStatus();
}

absl::Status CheckOutputs(const std::vector<std::string>& outputs,
                          const std::vector<std::string>& inputs) {
  std::vector<std::string> others;
  for (const std::string& output : outputs) {
    if (output.empty()) continue;
    CARMAP_RETURN_IF_ERROR(CheckWritable(output));
    CARMAP_RETURN_IF_ERROR(CheckKeepsInputs(output, inputs));
    for (const std::string& other : others) {
      if (!IsSameFile(output, other)) continue;
      return absl::InvalidArgumentError(fmt::format(
          "{}: is the same file as {}, which is written too; choose another name", output, other));
    }
    others.push_back(output);
  }
  return absl::OkStatus();
}

absl::Status WriteReport(const std::string& path, const nlohmann::ordered_json& report) {
  return WriteFileAtomically(path, JsonText(report));
}

bool OutputFiles::Write(const std::string& path, const std::function<absl::Status()>& write) {
  if (path.empty()) return true;
  absl::Status status;
  if (const absl::Status made = CatchExceptions([&] { status = write(); }); !made.ok()) {
    status = WithName(path, made);
  }
  if (!status.ok()) PrintProblem(std::string(status.message()));
  (status.ok() ? written_ : failed_).push_back(path);
  return status.ok();
}

bool OutputFiles::Finish() const {
  if (failed_.empty()) return true;
  PrintProblem(
      fmt::format("not written: {}; written: {}", fmt::join(failed_, ", "),
                  written_.empty() ? "nothing" : fmt::format("{}", fmt::join(written_, ", "))));
  return false;
}

std::string JsonText(const nlohmann::ordered_json& json) {
  constexpr int kIndent = 2;
  // Names of files may hold any bytes.
  return json.dump(kIndent, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

}  // namespace carmap
