#include "carmap/dataset/world_frame.h"

#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <string>
#include <system_error>

#include "carmap/base/file.h"
#include "carmap/base/status_macros.h"

namespace carmap {
namespace {

using Json = nlohmann::json;

constexpr uint64_t kMaxWorldBytes = uint64_t{1} << 24;

double NumberAt(const Json& object, const char* key) {
  const auto it = object.find(key);
  if (it == object.end() || !it->is_number()) return std::numeric_limits<double>::quiet_NaN();
  return it->get<double>();
}

}  // namespace

absl::StatusOr<std::optional<GpsFix>> ReadWorldOrigin(const std::filesystem::path& drive) {
  const std::filesystem::path path = drive / "world.json";
  std::error_code error;
  if (!std::filesystem::exists(path, error)) return std::nullopt;
  CARMAP_ASSIGN_OR_RETURN(const std::string text, ReadFile(path, kMaxWorldBytes));
  const Json world = Json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (!world.is_object()) {
    return absl::InvalidArgumentError(fmt::format(
        "{}: is not a JSON object; simulate the drive again, or remove the file", path.string()));
  }
  const auto frame = world.find("frame");
  if (frame == world.end() || !frame->is_object()) return std::nullopt;
  const auto name = frame->find("name");
  if (name == frame->end() || *name != "enu") return std::nullopt;
  const GpsFix origin{NumberAt(*frame, "origin_latitude_deg"),
                      NumberAt(*frame, "origin_longitude_deg"),
                      NumberAt(*frame, "origin_altitude_m")};
  if (!IsValid(origin)) {
    return absl::InvalidArgumentError(fmt::format(
        "{}: the frame's origin is not a place on the globe; correct it", path.string()));
  }
  return origin;
}

}  // namespace carmap
