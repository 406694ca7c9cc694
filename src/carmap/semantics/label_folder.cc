#include "carmap/semantics/label_folder.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>

#include "carmap/base/status_macros.h"
#include "carmap/dataset/image_file.h"
#include "carmap/semantics/mobility.h"

namespace carmap {
namespace {

namespace fs = std::filesystem;

constexpr uint8_t kNoClass = 255;

/// Mobility by value of a label; kNoClass for values that are no class.
cv::Mat MakeMobilityTable() {
  cv::Mat table(1, 256, CV_8U, cv::Scalar(kNoClass));
  for (int value = 0; value < 256; ++value) {
    const auto label = static_cast<SemanticClass>(value);
    if (label > SemanticClass::kBicycle && label != SemanticClass::kUnlabelled) continue;
    table.at<uint8_t>(value) = static_cast<uint8_t>(MobilityOf(label));
  }
  return table;
}

std::string NameOfLabels(uint32_t frame_index) { return fmt::format("{:06}.png", frame_index); }

std::optional<uint32_t> FrameOfLabels(std::string_view name) {
  uint32_t index = 0;
  for (const char digit : name.substr(0, name.find('.'))) {
    if (digit < '0' || digit > '9' || index > 99'999'999) return std::nullopt;
    index = 10 * index + static_cast<uint32_t>(digit - '0');
  }
  if (NameOfLabels(index) != name) return std::nullopt;
  return index;
}

class LabelFolder : public Segmenter {
 public:
  LabelFolder(fs::path folder, cv::Size image) : folder_(std::move(folder)), image_(image) {}

  absl::StatusOr<cv::Mat> Segment(const SegmenterInput& input) override {
    const fs::path path = folder_ / NameOfLabels(input.frame_index);
    std::error_code error;
    if (!fs::exists(path, error)) {
      return cv::Mat(image_, CV_8UC1, cv::Scalar(static_cast<double>(Mobility::kUnknown)));
    }
    CARMAP_ASSIGN_OR_RETURN(const cv::Mat labels, ReadIndexImage(path));
    if (labels.size() != image_) {
      return absl::InvalidArgumentError(
          fmt::format("{}: the labels are {}x{} px and the camera's images {}x{}; take the labels "
                      "of this drive",
                      path.string(), labels.cols, labels.rows, image_.width, image_.height));
    }
    return ToMobility(labels, path);
  }

 private:
  absl::StatusOr<cv::Mat> ToMobility(const cv::Mat& labels, const fs::path& path) const {
    cv::Mat mobility;
    cv::LUT(labels, table_, mobility);
    double highest = 0;
    cv::Point where;
    cv::minMaxLoc(mobility, nullptr, &highest, nullptr, &where);
    if (highest < kNoClass) return mobility;
    return absl::InvalidArgumentError(fmt::format(
        "{}: pixel ({}, {}) has the label {}, which is no class; write Cityscapes train "
        "ids, 0 to 18, and 255 for none",
        path.string(), where.x, where.y, labels.at<uint8_t>(where)));
  }

  const fs::path folder_;
  const cv::Size image_;
  const cv::Mat table_ = MakeMobilityTable();
};

/// Of the frames that have labels.
std::optional<uint32_t> FindFirstFrame(const fs::path& folder) {
  std::optional<uint32_t> first;
  std::error_code error;
  for (fs::directory_iterator it(folder, error), end; it != end; it.increment(error)) {
    const auto index = FrameOfLabels(it->path().filename().string());
    if (index) first = std::min(first.value_or(*index), *index);
  }
  return first;
}

}  // namespace

absl::StatusOr<std::unique_ptr<Segmenter>> OpenLabelFolder(const fs::path& folder, cv::Size image) {
  std::error_code error;
  if (!fs::is_directory(folder, error)) {
    return absl::NotFoundError(
        fmt::format("{}: no such folder; `carmap simulate --labels` writes one", folder.string()));
  }
  const auto first = FindFirstFrame(folder);
  if (!first) {
    return absl::InvalidArgumentError(
        fmt::format("{}: has no labels (000000.png ...); `carmap simulate --labels` writes them",
                    folder.string()));
  }
  auto segmenter = std::make_unique<LabelFolder>(folder, image);
  CARMAP_RETURN_IF_ERROR(segmenter->Segment({*first, cv::Mat()}).status());
  return segmenter;
}

}  // namespace carmap
