#include "carmap/semantics/segmenter_choice.h"

#include <fmt/format.h>

#include <system_error>

#include "carmap/semantics/default_segmenter.h"
#include "carmap/semantics/label_folder.h"
#include "carmap/semantics/onnx_segmenter.h"

namespace carmap {

absl::StatusOr<std::shared_ptr<Segmenter>> MakeSegmenter(const std::string& choice,
                                                         const std::filesystem::path& drive,
                                                         cv::Size image) {
  if (choice == "none") return nullptr;
  if (choice == "labels") return OpenLabelFolder(drive / "labels", image);
  if (choice == "default") return MakeDefaultSegmenter(image);
  const std::filesystem::path path = choice;
  if (path.extension() == ".onnx" || path.extension() == ".json") {
    return LoadOnnxSegmenter(path, image);
  }
  std::error_code error;
  if (std::filesystem::is_directory(path, error)) return OpenLabelFolder(path, image);
  return absl::InvalidArgumentError(fmt::format(
      "{}: is no segmenter; give none, default, labels, a folder of labels, or a network's .onnx "
      "or .json file",
      choice));
}

}  // namespace carmap
