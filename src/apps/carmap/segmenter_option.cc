#include "apps/carmap/segmenter_option.h"

#include <filesystem>

#include "carmap/semantics/network_description.h"

namespace carmap {

const char* const kSegmenterHelp =
    R"(What tells static from non-static (persons and vehicles, parked ones too) is a segmenter:
  none       nothing does
  default    the network that comes with the program: for simulated drives (docs/segmenter.md)
  labels     the drive's own labels/, as `carmap simulate --labels` writes them: the truth
  FOLDER     labels in another folder: 000000.png ..., Cityscapes train ids, 255 for none
  NET.onnx   a network, described by NET.json beside it (docs/segmenter_networks.md)
  NET.json   the same; its "model" may name a network that lies elsewhere)";

void AddSegmenterOption(CLI::App& command, std::string& segmenter) {
  segmenter = "none";
  command
      .add_option("--segmenter", segmenter,
                  "Leave what moves, or may move, out of the map that is made: told by a network, "
                  "or by the labels of a simulated drive; see below")
      ->capture_default_str()
      ->type_name("none|default|labels|NET.onnx");
}

std::vector<std::string> FilesOfSegmenter(const std::string& segmenter, const std::string& drive) {
  if (segmenter == "none" || segmenter == "default") return {};
  if (segmenter == "labels") return {(std::filesystem::path(drive) / "labels").string()};
  const std::filesystem::path path = segmenter;
  if (path.extension() != ".onnx" && path.extension() != ".json") return {segmenter};
  std::vector<std::string> files = {
      segmenter, std::filesystem::path(path).replace_extension(".json").string()};
  if (const auto description = ReadNetworkDescription(path); description.ok()) {
    files.push_back(description->network.string());
  }
  return files;
}

}  // namespace carmap
