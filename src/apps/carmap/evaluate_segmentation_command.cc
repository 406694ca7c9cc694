#include <fmt/format.h>

#include <CLI/App.hpp>
#include <CLI/Validators.hpp>
#include <algorithm>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <string>
#include <utility>
#include <vector>

#include "apps/carmap/commands.h"
#include "apps/carmap/outputs.h"
#include "apps/carmap/reports.h"
#include "apps/carmap/segmenter_option.h"
#include "carmap/base/progress.h"
#include "carmap/base/status_macros.h"
#include "carmap/base/stopwatch.h"
#include "carmap/dataset/kitti_drive.h"
#include "carmap/eval/canvas.h"
#include "carmap/eval/landmark_votes.h"
#include "carmap/eval/segmentation_picture.h"
#include "carmap/eval/segmentation_score.h"
#include "carmap/map/strip.h"
#include "carmap/semantics/feature_mobility.h"
#include "carmap/semantics/label_folder.h"
#include "carmap/semantics/segmenter_choice.h"
#include "carmap/slam/frame_extraction.h"
#include "carmap/slam/map_drive.h"

namespace carmap {
namespace {

struct Arguments {
  std::string drive, report, picture;
  std::vector<std::string> segmenters;
  size_t every = 1;
  bool landmarks = false;
};

struct Contestant {
  std::string name;
  std::shared_ptr<Segmenter> segmenter;
  SegmentationScore score;
  FrameLabels labels;
};

cv::Size ImageSize(const StereoRig& rig) { return {rig.camera.width, rig.camera.height}; }

absl::StatusOr<std::vector<Contestant>> LoadSegmenters(const Arguments& arguments, cv::Size image) {
  std::vector<Contestant> contestants;
  for (const std::string& name : arguments.segmenters) {
    CARMAP_ASSIGN_OR_RETURN(auto segmenter, MakeSegmenter(name, arguments.drive, image));
    if (!segmenter) {
      return absl::InvalidArgumentError(
          fmt::format("--segmenter {}: tells nothing that could be right; name a network", name));
    }
    contestants.push_back({name, std::move(segmenter), {}});
  }
  return contestants;
}

/// Scores all segmenters frame by frame, and keeps the frame that shows most of what is not static.
class Evaluation {
 public:
  Evaluation(std::vector<Contestant> contestants, cv::Size feature_image)
      : contestants_(std::move(contestants)), feature_image_(feature_image) {}

  /// `truth`: mobility of each pixel, of the image's size.
  absl::Status Take(const ExtractedFrame& frame, const cv::Mat& truth) {
    const auto true_features = MobilityOfFeatures(*frame.features, feature_image_, truth);
    true_labels_[frame.index] = true_features;
    SegmentationPicture picture{fmt::format("frame {}", frame.index), frame.left, truth, {}};
    for (Contestant& contestant : contestants_) {
      const Stopwatch watch;
      CARMAP_ASSIGN_OR_RETURN(const cv::Mat told,
                              contestant.segmenter->Segment({frame.index, frame.left}));
      contestant.score.frame_ms.push_back(watch.ElapsedMs());
      contestant.score.TakePixels(truth, AtImageSize(told, truth.size()));
      auto& labels = contestant.labels[frame.index];
      labels = MobilityOfFeatures(*frame.features, feature_image_, told);
      contestant.score.TakeFeatures(true_features, labels);
      picture.told.push_back({contestant.name, told});
    }
    ++frames_;
    const int non_static = cv::countNonZero(truth == static_cast<double>(Mobility::kNonStatic));
    if (non_static > most_non_static_) {
      most_non_static_ = non_static;
      picture_ = std::move(picture);
    }
    return absl::OkStatus();
  }

  /// The landmarks of the drive's unfiltered map, by the votes of its keyframes.
  void TakeLandmarks(const Map& map) {
    for (const Contestant& contestant : contestants_) {
      for (const size_t cycle : kCycles) {
        landmarks_.push_back({contestant.name, cycle,
                              VoteOnLandmarks(map, true_labels_, contestant.labels, cycle,
                                              StripOptions().min_observations)});
      }
    }
  }

  size_t frames() const { return frames_; }
  const SegmentationPicture& picture() const { return picture_; }

  std::string Text() const {
    std::vector<NamedSegmentationScore> scores;
    for (const Contestant& contestant : contestants_) {
      scores.push_back({NameOf(contestant.name), contestant.score});
    }
    std::string text = ToText(scores);
    if (landmarks_.empty()) return text;
    constexpr const char* kRow = "{:<32} {:>14} {:>12} {:>20} {:>12} {:>22}\n";
    text += "\n" + fmt::format(kRow, "landmarks of the map", "keyframes", "non-static", "found %",
                               "static", "lost %");
    for (const LandmarkScore& score : landmarks_) {
      const MobilityConfusion& votes = score.votes;
      text += fmt::format(
          kRow, NameOf(score.name), score.cycle == 1 ? "all" : fmt::format("1 of {}", score.cycle),
          votes.count(Mobility::kNonStatic),
          fmt::format("{:.1f}", 100 * votes.Share(Mobility::kNonStatic, Mobility::kNonStatic)),
          votes.count(Mobility::kStatic),
          fmt::format("{:.1f}", 100 * votes.Share(Mobility::kStatic, Mobility::kNonStatic)));
    }
    return text;
  }

  nlohmann::ordered_json Json() const {
    nlohmann::ordered_json segmenters = nlohmann::ordered_json::array();
    for (const Contestant& contestant : contestants_) {
      nlohmann::ordered_json& json = segmenters.emplace_back();
      json["segmenter"] = contestant.name;
      json.update(ToJson(contestant.score));
    }
    nlohmann::ordered_json json = {{"frames", frames_}, {"segmenters", segmenters}};
    for (const LandmarkScore& score : landmarks_) {
      const MobilityConfusion& votes = score.votes;
      const auto of = [&](Mobility truth, Mobility told) { return votes.count(truth, told); };
      json["landmarks"].push_back(
          {{"segmenter", score.name},
           {"cycle", score.cycle},
           {"non_static", votes.count(Mobility::kNonStatic)},
           {"non_static_found", of(Mobility::kNonStatic, Mobility::kNonStatic)},
           {"static", votes.count(Mobility::kStatic)},
           {"static_lost", of(Mobility::kStatic, Mobility::kNonStatic)}});
    }
    return json;
  }

 private:
  /// Every so many keyframes are labelled (figure A.6).
  static constexpr size_t kCycles[] = {1, 2, 4};
  struct LandmarkScore {
    std::string name;
    size_t cycle;
    MobilityConfusion votes;
  };

  std::vector<Contestant> contestants_;
  FrameLabels true_labels_;
  std::vector<LandmarkScore> landmarks_;
  const cv::Size feature_image_;
  size_t frames_ = 0;
  int most_non_static_ = -1;
  SegmentationPicture picture_;
};

/// Sequentially, so that nothing runs beside what is timed.
absl::StatusOr<Evaluation> EvaluateFrames(KittiDrive& drive, const Arguments& arguments) {
  const cv::Size image = ImageSize(drive.rig());
  CARMAP_ASSIGN_OR_RETURN(
      const auto labels, OpenLabelFolder(std::filesystem::path(arguments.drive) / "labels", image));
  CARMAP_ASSIGN_OR_RETURN(auto contestants, LoadSegmenters(arguments, image));
  FrameExtraction frames(drive, {}, /*sequential=*/true);
  Evaluation evaluation(std::move(contestants), ImageSize(frames.front_end().rig()));
  Progress progress("segmenting", drive.size());
  for (size_t n = 0; const auto frame = frames.Next(); ++n) {
    progress.Update(n);
    if (n % arguments.every != 0 || !frame->features) continue;
    CARMAP_ASSIGN_OR_RETURN(const cv::Mat truth, labels->Segment({frame->index, frame->left}));
    if (cv::countNonZero(truth) == 0) continue;  // a frame without labels
    CARMAP_RETURN_IF_ERROR(evaluation.Take(*frame, truth));
  }
  progress.Update(drive.size());
  return evaluation;
}

absl::Status EvaluateLandmarks(const Arguments& arguments, Evaluation& evaluation) {
  CARMAP_ASSIGN_OR_RETURN(const auto drive, KittiDrive::Open(arguments.drive));
  Progress progress("mapping", drive->size());
  const auto mapped =
      MapDrive(*drive, drive->id(), {}, [&](size_t frames, size_t) { progress.Update(frames); });
  if (!mapped.ok()) return WithName(arguments.drive, mapped.status());
  if (!mapped->failure.empty()) {
    return WithName(arguments.drive, absl::InternalError(mapped->failure));
  }
  evaluation.TakeLandmarks(mapped->map);
  return absl::OkStatus();
}

absl::StatusOr<ExitCode> EvaluateSegmentation(const Arguments& arguments) {
  std::vector<std::string> inputs = FilesOfDrive(arguments.drive);
  inputs.push_back((std::filesystem::path(arguments.drive) / "labels").string());
  for (const std::string& segmenter : arguments.segmenters) {
    AddFiles(FilesOfSegmenter(segmenter, arguments.drive), inputs);
  }
  CARMAP_RETURN_IF_ERROR(CheckOutputs({arguments.report, arguments.picture}, inputs));
  CARMAP_ASSIGN_OR_RETURN(const auto drive, KittiDrive::Open(arguments.drive));
  CARMAP_ASSIGN_OR_RETURN(Evaluation evaluation, EvaluateFrames(*drive, arguments));
  if (evaluation.frames() == 0) {
    return absl::FailedPreconditionError(
        fmt::format("{}: none of its frames can be used and has labels; write labels/ of these "
                    "frames, or give a smaller --every",
                    arguments.drive));
  }
  if (arguments.landmarks) CARMAP_RETURN_IF_ERROR(EvaluateLandmarks(arguments, evaluation));
  OutputFiles files;
  files.Write(arguments.report, [&] { return WriteReport(arguments.report, evaluation.Json()); });
  files.Write(arguments.picture, [&] {
    SegmentationPicture picture = evaluation.picture();
    picture.title = NameOf(arguments.drive) + ", " + picture.title;
    return WritePng(arguments.picture, RenderSegmentationPicture(picture));
  });
  fmt::print("{}of {} with labels\n", evaluation.Text(), Count(evaluation.frames(), "frame"));
  return files.Finish() ? kSuccess : kIncomplete;
}

}  // namespace

void AddEvaluateSegmentation(CLI::App& evaluate, Command& chosen) {
  CLI::App* command = evaluate.add_subcommand(
      "segmentation", "How well networks tell static from non-static, and how fast");
  const auto arguments = std::make_shared<Arguments>();
  command
      ->add_option("DRIVE", arguments->drive,
                   "Folder of the drive, with labels/ as `carmap simulate --labels` writes them")
      ->required();
  command
      ->add_option("--segmenter", arguments->segmenters,
                   "What to evaluate, see below; give it again to compare several")
      ->required()
      ->allow_extra_args(false)
      ->type_name("NET.onnx");
  CLI::Option* every =
      command->add_option("--every", arguments->every, "Take every n-th frame alone");
  every->check(CLI::Range(1, 1000000))->capture_default_str()->type_name("N");
  command
      ->add_flag("--landmarks", arguments->landmarks,
                 "Map the drive too, without a filter, and let its keyframes vote on what its "
                 "landmarks are: all, every other and every fourth of them")
      ->excludes(every);
  command
      ->add_option("--report", arguments->report, "Write the figures as JSON, shares from 0 to 1")
      ->type_name("R.json");
  command
      ->add_option("--picture", arguments->picture,
                   "Draw what each told of the frame that shows most of what is not static")
      ->type_name("P.png");
  command->footer(fmt::format(
      R"(Figures 17 and A.6 of the paper. Of the pixels, and of the features that
`carmap map` finds: how many are told rightly, IoU (intersection over union), which share of the
non-static features is found, and which of the static ones is lost, being called non-static. Where
truth is unknown nothing is counted, where a segmenter tells nothing it is wrong. Times are of the
segmenter alone, on one thread.

{}

Example:
  carmap simulate --out busy --scene suburb --traffic moving --labels
  carmap evaluate segmentation busy --segmenter a.onnx --segmenter b.json --picture busy.png

Exit codes: 0 measured, whatever the result, 1 error, 2 wrong usage, 3 measured but not all files
could be written)",
      kSegmenterHelp));
  command->callback(
      [arguments, &chosen] { chosen = [arguments] { return EvaluateSegmentation(*arguments); }; });
}

}  // namespace carmap
