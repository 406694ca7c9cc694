#include "carmap/semantics/onnx_segmenter.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <exception>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/dnn.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "carmap/base/file.h"
#include "carmap/base/status_macros.h"
#include "carmap/semantics/network_description.h"

namespace carmap {
namespace {

namespace fs = std::filesystem;

constexpr uint64_t kMaxNetworkBytes = 1'000'000'000;

/// What OpenCV said, in one line of bounded length.
std::string CauseOf(const std::exception& error) {
  constexpr size_t kMaxLength = 200;
  const auto* const of_opencv = dynamic_cast<const cv::Exception*>(&error);
  std::string cause = of_opencv ? of_opencv->err : error.what();
  cause.resize(std::min(cause.size(), kMaxLength));
  std::replace(cause.begin(), cause.end(), '\n', ' ');
  return cause;
}

absl::StatusOr<cv::dnn::Net> DecodeNetwork(std::string_view bytes, const fs::path& path) {
  try {
    cv::dnn::Net network = cv::dnn::readNetFromONNX(bytes.data(), bytes.size());
    if (!network.empty()) return network;
  } catch (const std::exception& error) {
    return absl::InvalidArgumentError(
        fmt::format("{}: is not an ONNX network that OpenCV {} can read ({}); copy it again, or "
                    "export it with another opset",
                    path.string(), CV_VERSION, CauseOf(error)));
  }
  return absl::InvalidArgumentError(
      fmt::format("{}: is a network without layers; export it again", path.string()));
}

/// 1 x channels x rows x columns, CV_32F.
cv::Mat MakeInput(const cv::Mat& image, const NetworkDescription& description) {
  const cv::Size size = NetworkInputSize(description, image.size());
  cv::Mat resized;
  cv::resize(image, resized, size, 0, 0,
             size.width < image.cols ? cv::INTER_AREA : cv::INTER_LINEAR);
  cv::Mat input(std::vector<int>{1, description.channels(), size.height, size.width}, CV_32F);
  for (int c = 0; c < description.channels(); ++c) {
    // Red, green and blue of a grey pixel are equal: only mean and scale differ by channel.
    const auto channel = static_cast<size_t>(c);
    cv::Mat plane(size, CV_32F, input.ptr(0, c));
    resized.convertTo(plane, CV_32F, description.scale[channel],
                      -description.mean[channel] * description.scale[channel]);
  }
  return input;
}

/// By pixel, that of the class with the highest score; the first of equals.
cv::Mat MobilityOfScores(const cv::Mat& scores, const std::vector<Mobility>& of_class) {
  const cv::Size size(scores.size[3], scores.size[2]);
  cv::Mat best(size, CV_32F, cv::Scalar(-std::numeric_limits<float>::infinity()));
  cv::Mat mobility(size, CV_8U);
  for (int c = 0; c < scores.size[1]; ++c) {
    const cv::Mat score(size, CV_32F, const_cast<uchar*>(scores.ptr(0, c)));
    const cv::Mat is_better = score > best;
    score.copyTo(best, is_better);
    mobility.setTo(static_cast<double>(of_class[static_cast<size_t>(c)]), is_better);
  }
  return mobility;
}

class OnnxSegmenter : public Segmenter {
 public:
  OnnxSegmenter(cv::dnn::Net network, NetworkDescription description)
      : network_(std::move(network)), description_(std::move(description)) {}

  absl::StatusOr<cv::Mat> Segment(const SegmenterInput& input) override {
    CARMAP_ASSIGN_OR_RETURN(const cv::Mat scores, Run(input.image));
    CARMAP_RETURN_IF_ERROR(CheckScores(scores));
    return MobilityOfScores(scores, description_.of_class);
  }

  absl::Status CheckOutputs() const {
    const size_t outputs = network_.getUnconnectedOutLayers().size();
    if (outputs == 1) return absl::OkStatus();
    return Error(fmt::format("has {} outputs; export it with the scores alone", outputs));
  }

 private:
  absl::Status Error(std::string_view what) const {
    return absl::InvalidArgumentError(fmt::format("{}: {}", description_.network.string(), what));
  }

  absl::StatusOr<cv::Mat> Run(const cv::Mat& image) {
    const cv::Size size = NetworkInputSize(description_, image.size());
    try {
      network_.setInput(MakeInput(image, description_), description_.input_name);
      return network_.forward();
    } catch (const std::exception& error) {
      return Error(
          fmt::format("fails on an input of 1x{}x{}x{} ({}); correct \"input\" in its JSON "
                      "file, or export it for this size",
                      description_.channels(), size.height, size.width, CauseOf(error)));
    }
  }

  absl::Status CheckScores(const cv::Mat& scores) const {
    if (scores.dims != 4 || scores.type() != CV_32F || scores.size[0] != 1 || scores.total() == 0) {
      return Error(
          fmt::format("its output has {} dimensions; export it with scores of "
                      "1 x classes x rows x columns",
                      scores.dims));
    }
    if (scores.size[1] != static_cast<int>(description_.of_class.size())) {
      return Error(
          fmt::format("its output has {} channels, and its JSON file names {} classes; name "
                      "one for each",
                      scores.size[1], description_.of_class.size()));
    }
    if (!cv::checkRange(scores)) {
      return Error("its output is not finite; check \"mean\" and \"scale\", or train it again");
    }
    return absl::OkStatus();
  }

  cv::dnn::Net network_;
  const NetworkDescription description_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<Segmenter>> LoadOnnxSegmenter(const fs::path& path, cv::Size image) {
  CARMAP_ASSIGN_OR_RETURN(NetworkDescription description, ReadNetworkDescription(path));
  CARMAP_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(description.network, kMaxNetworkBytes));
  return MakeOnnxSegmenter(bytes, std::move(description), image);
}

absl::StatusOr<std::unique_ptr<Segmenter>> MakeOnnxSegmenter(std::string_view bytes,
                                                             NetworkDescription description,
                                                             cv::Size image) {
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
  CARMAP_ASSIGN_OR_RETURN(cv::dnn::Net network, DecodeNetwork(bytes, description.network));
  auto segmenter = std::make_unique<OnnxSegmenter>(std::move(network), std::move(description));
  CARMAP_RETURN_IF_ERROR(segmenter->CheckOutputs());
  const cv::Mat blank(image, CV_8UC1, cv::Scalar(0));
  CARMAP_RETURN_IF_ERROR(segmenter->Segment({0, blank}).status());
  return segmenter;
}

}  // namespace carmap
