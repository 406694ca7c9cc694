#include "carmap/semantics/network_description.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <nlohmann/json.hpp>
#include <string_view>
#include <utility>

#include "carmap/base/file.h"
#include "carmap/base/status_macros.h"

namespace carmap {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr uint64_t kMaxBytes = 1'000'000;
constexpr int kMinSidePx = 16, kMaxSidePx = 8192;
constexpr size_t kMaxClasses = 256;
constexpr double kMaxNumber = 1e6;

/// Reads the fields of one file, and remembers the first thing that is wrong with it.
class Reader {
 public:
  explicit Reader(const fs::path& path) : path_(path) {}

  const absl::Status& status() const { return status_; }

  void Fail(std::string_view what) {
    if (!status_.ok()) return;
    status_ = absl::InvalidArgumentError(
        fmt::format("{}: {} (docs/segmenter_networks.md has the format)", path_.string(), what));
  }

  void AllowOnly(const Json& object, std::string_view where,
                 std::initializer_list<std::string_view> keys) {
    for (const auto& [key, value] : object.items()) {
      if (std::find(keys.begin(), keys.end(), key) != keys.end()) continue;
      Fail(fmt::format("{} has a field \"{}\", which is unknown; its fields are {}", where,
                       key.substr(0, 40), fmt::join(keys, ", ")));
    }
  }

  /// Null, having failed, where there is none.
  Json Object(const Json& object, const char* key) {
    const auto it = object.find(key);
    if (it != object.end() && it->is_object()) return *it;
    Fail(fmt::format("\"{}\" must be an object; add it", key));
    return Json::object();
  }

  std::string OptionalText(const Json& object, const char* key) {
    const auto it = object.find(key);
    if (it == object.end()) return {};
    if (it->is_string() && !it->get_ref<const std::string&>().empty()) return *it;
    Fail(fmt::format("\"{}\" must be a text that is not empty; correct it or leave it out", key));
    return {};
  }

  int Pixels(const Json& object, const char* key, int min) {
    const auto it = object.find(key);
    if (it != object.end() && it->is_number_integer()) {
      // As a number of any size: what does not fit an integer is out of range too.
      const auto value = it->get<double>();
      if (value >= min && value <= kMaxSidePx) return static_cast<int>(value);
    }
    Fail(fmt::format("\"{}\" must be a whole number of pixels from {} to {}; correct it", key, min,
                     kMaxSidePx));
    return min;
  }

  std::vector<double> Numbers(const Json& object, const char* key, size_t count) {
    const auto it = object.find(key);
    std::vector<double> numbers;
    if (it != object.end() && it->is_array()) {
      for (const Json& number : *it) {
        if (!number.is_number() || !(std::abs(number.get<double>()) <= kMaxNumber)) break;
        numbers.push_back(number);
      }
      if (numbers.size() == it->size() && numbers.size() == count) return numbers;
    }
    Fail(fmt::format("\"{}\" must be a list of {} finite number{}, one a channel; correct it", key,
                     count, count == 1 ? "" : "s"));
    return std::vector<double>(count);
  }

 private:
  const fs::path path_;
  absl::Status status_;
};

size_t ReadChannels(const Json& input, Reader& reader) {
  const std::string channels = reader.OptionalText(input, "channels");
  if (channels == "grey") return 1;
  if (channels != "rgb" && channels != "bgr") {
    reader.Fail(R"("channels" must be "grey", "rgb" or "bgr"; correct it)");
  }
  return 3;
}

void ReadSize(const Json& input, Reader& reader, NetworkDescription& description) {
  const bool is_fixed = input.contains("width") || input.contains("height");
  const bool has_multiples = input.contains("multiple_of") || input.contains("max_width");
  if (is_fixed == has_multiples) {
    return reader.Fail(
        R"("input" must have either "width" and "height", or "multiple_of" and "max_width"; correct it)");
  }
  if (is_fixed) {
    description.fixed_size = {reader.Pixels(input, "width", kMinSidePx),
                              reader.Pixels(input, "height", kMinSidePx)};
    return;
  }
  description.multiple_of = reader.Pixels(input, "multiple_of", 1);
  description.max_width = reader.Pixels(input, "max_width", kMinSidePx);
  if (description.multiple_of > description.max_width) {
    reader.Fail(R"("max_width" is less than "multiple_of"; make it a multiple)");
  }
}

void ReadInput(const Json& input, Reader& reader, NetworkDescription& description) {
  reader.AllowOnly(
      input, R"("input")",
      {"name", "channels", "mean", "scale", "width", "height", "multiple_of", "max_width"});
  description.input_name = reader.OptionalText(input, "name");
  const size_t channels = ReadChannels(input, reader);
  description.mean = reader.Numbers(input, "mean", channels);
  description.scale = reader.Numbers(input, "scale", channels);
  ReadSize(input, reader, description);
}

std::vector<Mobility> ReadClasses(const Json& json, Reader& reader) {
  const auto it = json.find("classes");
  if (it == json.end() || !it->is_array() || it->size() > kMaxClasses) {
    reader.Fail(fmt::format(
        R"("classes" must be a list of at most {} names, one a channel of the output; correct it)",
        kMaxClasses));
    return {};
  }
  std::vector<Mobility> of_class;
  for (const Json& name : *it) {
    const auto mobility =
        name.is_string() ? MobilityOfName(name.get_ref<const std::string&>()) : std::nullopt;
    if (!mobility) {
      reader.Fail(fmt::format(
          R"(its class {} is unknown; give Cityscapes names, "static", "non-static" or "unlabelled")",
          name.dump(-1, ' ', true, Json::error_handler_t::replace).substr(0, 40)));
      return {};
    }
    of_class.push_back(*mobility);
  }
  const auto has = [&](Mobility mobility) {
    return std::find(of_class.begin(), of_class.end(), mobility) != of_class.end();
  };
  if (!has(Mobility::kStatic) || !has(Mobility::kNonStatic)) {
    reader.Fail(fmt::format("none of its classes is {}, so it can tell nothing apart; correct them",
                            has(Mobility::kStatic) ? "non-static" : "static"));
  }
  return of_class;
}

absl::StatusOr<std::string> ReadText(const fs::path& path) {
  auto text = ReadFile(path, kMaxBytes);
  if (!absl::IsNotFound(text.status())) return text;
  return absl::NotFoundError(
      fmt::format("{}: no such file; write what the network takes and gives, as "
                  "docs/segmenter_networks.md says",
                  path.string()));
}

/// Sides of a size in multiples keep at least one.
int ToMultiple(double side_px, int multiple) {
  return std::max(1, static_cast<int>(std::lround(side_px / multiple))) * multiple;
}

}  // namespace

absl::StatusOr<NetworkDescription> ReadNetworkDescription(const fs::path& path) {
  const fs::path json_path = fs::path(path).replace_extension(".json");
  CARMAP_ASSIGN_OR_RETURN(const std::string text, ReadText(json_path));
  CARMAP_ASSIGN_OR_RETURN(NetworkDescription description, ParseNetworkDescription(text, json_path));
  if (path != json_path) description.network = path;
  return description;
}

absl::StatusOr<NetworkDescription> ParseNetworkDescription(std::string_view text,
                                                           const fs::path& json_path) {
  const Json json = Json::parse(text, nullptr, /*allow_exceptions=*/false);
  Reader reader(json_path);
  if (!json.is_object()) {
    reader.Fail("is not a JSON object; correct it");
    return reader.status();
  }
  NetworkDescription description;
  reader.AllowOnly(json, "it", {"model", "input", "classes"});
  const std::string network = reader.OptionalText(json, "model");
  description.network = network.empty() ? fs::path(json_path).replace_extension(".onnx")
                                        : json_path.parent_path() / network;
  ReadInput(reader.Object(json, "input"), reader, description);
  description.of_class = ReadClasses(json, reader);
  if (!reader.status().ok()) return reader.status();
  return description;
}

cv::Size NetworkInputSize(const NetworkDescription& description, cv::Size image) {
  if (!description.fixed_size.empty()) return description.fixed_size;
  const int multiple = description.multiple_of;
  const int max_width = description.max_width / multiple * multiple;
  const double scale = std::min(1.0, static_cast<double>(max_width) / image.width);
  return {std::min(max_width, ToMultiple(scale * image.width, multiple)),
          ToMultiple(scale * image.height, multiple)};
}

}  // namespace carmap
