#include <fmt/format.h>

#include <CLI/App.hpp>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "apps/carmap/commands.h"
#include "apps/carmap/outputs.h"
#include "apps/carmap/reports.h"
#include "carmap/base/progress.h"
#include "carmap/base/status_macros.h"
#include "carmap/base/stopwatch.h"
#include "carmap/base/summary.h"
#include "carmap/dataset/kitti_drive.h"
#include "carmap/dataset/read_ahead.h"
#include "carmap/eval/place_recognition.h"
#include "carmap/feature/image_pyramid.h"
#include "carmap/feature/orb_extractor.h"
#include "carmap/feature/vocabulary_file.h"

namespace carmap {
namespace {

struct Arguments {
  std::vector<std::string> drives;
  std::string vocabulary;
  double spacing_m = 2;
  bool json = false;
};

struct ViewedDrives {
  std::vector<ViewedPlace> places;
  std::vector<double> histogram_ms;
};

bool IsFarFromLast(const Rigid3& pose, const std::vector<ViewedPlace>& places, double spacing_m) {
  return places.empty() ||
         (pose.translation - places.back().world_from_camera.translation).norm() >= spacing_m;
}

/// Keyframes by the truth's path, as a mapper would take them.
absl::Status ViewPlaces(KittiDrive& drive, const Vocabulary& vocabulary, double spacing_m,
                        ViewedDrives& viewed) {
  Progress progress("reading images", drive.size());
  ReadAhead frames(drive, /*sequential=*/false);
  for (size_t i = 0; const auto frame = frames.Next(); ++i) {
    CARMAP_RETURN_IF_ERROR(frame->status);
    progress.Update(i + 1);
    const auto& pose = drive.truth()[i].world_from_camera;
    if (!pose || !IsFarFromLast(*pose, viewed.places, spacing_m)) continue;
    const std::vector<Feature> features = OrbExtractor().Extract(BuildPyramid(frame->left));
    const Stopwatch watch;
    WordHistogram histogram = HistogramOf(vocabulary, features);
    viewed.histogram_ms.push_back(watch.ElapsedMs());
    viewed.places.push_back({std::move(histogram), *pose});
  }
  return absl::OkStatus();
}

absl::StatusOr<std::vector<std::unique_ptr<KittiDrive>>> OpenWithTruth(
    const std::vector<std::string>& folders) {
  std::vector<std::unique_ptr<KittiDrive>> drives;
  for (const std::string& folder : folders) {
    CARMAP_ASSIGN_OR_RETURN(auto drive, KittiDrive::Open(folder));
    if (drive->truth().empty()) {
      return absl::FailedPreconditionError(fmt::format(
          "{}: has no poses.txt to tell which places are the same; name a drive with ground truth",
          folder));
    }
    drives.push_back(std::move(drive));
  }
  return drives;
}

void Print(const PlaceRecognition& result, const Summary& histogram_ms) {
  fmt::print("keyframes     {}, {} of them where the road was driven before\n", result.keyframes,
             result.revisits);
  const auto percent = [&](size_t count) {
    return 100 * static_cast<double>(count) / static_cast<double>(result.revisits);
  };
  if (result.revisits > 0) {
    for (size_t i = 0; i < PlaceRecognition::kRanks.size(); ++i) {
      fmt::print("{:<14}{} ({:.1f} %) find their place among the first {}\n", i == 0 ? "found" : "",
                 result.found_among[i], percent(result.found_among[i]),
                 PlaceRecognition::kRanks[i]);
    }
    fmt::print("without error {} ({:.1f} %) are more similar than any first wrong one\n",
               result.found_without_error, percent(result.found_without_error));
  }
  fmt::print("histogram     {} ms\n", ToText(histogram_ms, 3));
}

nlohmann::ordered_json ToJson(const PlaceRecognition& result, const Summary& histogram_ms) {
  nlohmann::ordered_json json{{"keyframes", result.keyframes}, {"revisits", result.revisits}};
  for (size_t i = 0; i < PlaceRecognition::kRanks.size(); ++i) {
    json[fmt::format("found_among_{}", PlaceRecognition::kRanks[i])] = result.found_among[i];
  }
  json["found_without_error"] = result.found_without_error;
  json["histogram_ms"] = ToJson(histogram_ms);
  return json;
}

absl::StatusOr<ExitCode> EvaluatePlaces(const Arguments& arguments) {
  CARMAP_ASSIGN_OR_RETURN(const Vocabulary vocabulary, ReadVocabulary(arguments.vocabulary));
  CARMAP_ASSIGN_OR_RETURN(const auto drives, OpenWithTruth(arguments.drives));
  ViewedDrives viewed;
  for (const auto& drive : drives) {
    CARMAP_RETURN_IF_ERROR(ViewPlaces(*drive, vocabulary, arguments.spacing_m, viewed));
  }
  const PlaceRecognition result = EvaluatePlaceRecognition(viewed.places, vocabulary.word_count());
  const Summary histogram_ms = Summarize(viewed.histogram_ms);
  if (arguments.json) {
    fmt::print("{}", JsonText(ToJson(result, histogram_ms)));
  } else {
    Print(result, histogram_ms);
  }
  return kSuccess;
}

}  // namespace

void AddEvaluatePlaces(CLI::App& evaluate, Command& chosen) {
  CLI::App* command = evaluate.add_subcommand(
      "places", "How well a vocabulary recognizes where a drive comes back to");
  const auto arguments = std::make_shared<Arguments>();
  command
      ->add_option("DRIVE", arguments->drives,
                   "Folders of drives with poses.txt, those of several in one frame")
      ->required();
  command->add_option("--vocabulary", arguments->vocabulary, "The vocabulary")
      ->required()
      ->type_name("V.cmvoc");
  command
      ->add_option("--spacing", arguments->spacing_m,
                   "Metres from one keyframe to the next (default 2)")
      ->type_name("M");
  command->add_flag("--json", arguments->json, "Print JSON");
  const PlaceRecognitionOptions options;
  command->footer(fmt::format(
      R"(Each keyframe is compared, by words alone, with all from {:.0f} m and more before it on the path. Where
one of these stands within {:.0f} m and looks the same way, the road was driven before: then the place
counts as found if a candidate stands within {:.0f} m. "Without error" are the first candidates that are
right and more similar, relative to the keyframe before, than any wrong one. Several drives count as
one, so that a later one looks for its places in those before.

Examples:
  carmap evaluate places loop --vocabulary roads.cmvoc
  carmap evaluate places sunny overcast --vocabulary roads.cmvoc

Exit codes: 0 done, 1 error, 2 wrong usage)",
      options.recent_m, options.revisit_m, options.same_place_m));
  command->callback(
      [arguments, &chosen] { chosen = [arguments] { return EvaluatePlaces(*arguments); }; });
}

}  // namespace carmap
