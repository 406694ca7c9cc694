#include "apps/carmap/patch_files.h"

#include <fmt/format.h>

#include <system_error>

#include "carmap/base/file.h"
#include "carmap/base/status_macros.h"
#include "carmap/format/tile_codec.h"

namespace carmap {
namespace {

constexpr const char* kPatchExtension = ".cmpatch";

}  // namespace

absl::Status WritePatches(const MapReader& reader, const std::vector<TileVersion>& versions,
                          const std::filesystem::path& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) {
    return absl::UnavailableError(
        fmt::format("{}: cannot be made ({})", folder.string(), error.message()));
  }
  for (const auto& [tile, version, is_removed] : versions) {
    CARMAP_ASSIGN_OR_RETURN(const auto patches, reader.ReadPatches(tile, version - 1));
    const std::string name =
        fmt::format("{:08x}-{:016x}-{:08}{}", tile.component, tile.cell, version, kPatchExtension);
    CARMAP_RETURN_IF_ERROR(WriteFileAtomically(folder / name, patches.front().patch));
  }
  return absl::OkStatus();
}

std::vector<Patch> PatchFolder::New() {
  std::set<std::filesystem::path> found;
  std::error_code error;
  for (std::filesystem::directory_iterator file(folder_, error), end; !error && file != end;
       file.increment(error)) {
    if (file->path().extension() == kPatchExtension && !known_.contains(file->path())) {
      found.insert(file->path());
    }
  }
  std::vector<Patch> patches;
  for (const std::filesystem::path& path : found) {
    const auto bytes = ReadFile(path, kMaxLeanFileBytes);
    auto patch =
        bytes.ok() ? DecodePatch(*bytes, path.string()) : absl::StatusOr<Patch>(bytes.status());
    if (!patch.ok()) {
      faults_[path] = std::string(patch.status().message());
      continue;
    }
    faults_.erase(path);
    known_.insert(path);
    patches.push_back(*std::move(patch));
  }
  return patches;
}

std::vector<std::string> PatchFolder::Faults() const {
  std::vector<std::string> faults;
  for (const auto& [path, fault] : faults_) faults.push_back(fault);
  return faults;
}

}  // namespace carmap
