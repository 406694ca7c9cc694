#include <fmt/format.h>

#include <CLI/App.hpp>
#include <algorithm>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "apps/carmap/commands.h"
#include "apps/carmap/outputs.h"
#include "apps/carmap/reports.h"
#include "carmap/base/file.h"
#include "carmap/base/progress.h"
#include "carmap/base/status_macros.h"
#include "carmap/base/stopwatch.h"
#include "carmap/dataset/kitti_drive.h"
#include "carmap/dataset/read_ahead.h"
#include "carmap/feature/image_pyramid.h"
#include "carmap/feature/orb_extractor.h"
#include "carmap/feature/vocabulary_file.h"
#include "carmap/feature/vocabulary_trainer.h"

namespace carmap {
namespace {

struct TrainArguments {
  std::vector<std::string> drives;
  std::string out;
  size_t step = 2;
  VocabularyOptions options;
};

struct InfoArguments {
  std::string vocabulary;
  bool json = false;
};

std::vector<Descriptor> DescriptorsOf(const cv::Mat& image) {
  std::vector<Descriptor> descriptors;
  for (const Feature& feature : OrbExtractor().Extract(BuildPyramid(image))) {
    descriptors.push_back(feature.descriptor);
  }
  return descriptors;
}

/// Of every step-th frame's left image.
absl::Status AppendImages(KittiDrive& drive, size_t step,
                          std::vector<std::vector<Descriptor>>& images, Progress& progress) {
  ReadAhead frames(drive, /*sequential=*/false);
  for (size_t i = 0; const auto frame = frames.Next(); ++i) {
    CARMAP_RETURN_IF_ERROR(frame->status);
    if (i % step != 0) continue;
    images.push_back(DescriptorsOf(frame->left));
    progress.Update(images.size());
  }
  return absl::OkStatus();
}

absl::StatusOr<std::vector<std::vector<Descriptor>>> ReadImages(const TrainArguments& arguments) {
  std::vector<std::unique_ptr<KittiDrive>> drives;
  size_t count = 0;
  for (const std::string& folder : arguments.drives) {
    CARMAP_ASSIGN_OR_RETURN(auto drive, KittiDrive::Open(folder));
    count += (drive->size() + arguments.step - 1) / arguments.step;
    drives.push_back(std::move(drive));
  }
  std::vector<std::vector<Descriptor>> images;
  Progress progress("reading images", count);
  for (const auto& drive : drives) {
    CARMAP_RETURN_IF_ERROR(AppendImages(*drive, arguments.step, images, progress));
  }
  return images;
}

void PrintVocabulary(const std::string& name, const Vocabulary& vocabulary, size_t bytes) {
  const VocabularyTables& tables = vocabulary.tables();
  const auto [least, most] = std::minmax_element(tables.weights.begin(), tables.weights.end());
  fmt::print("vocabulary    {}, {}\n", name, BytesText(static_cast<double>(bytes)));
  fmt::print("tree          {}, {} levels of up to {} children\n",
             Count(vocabulary.word_count(), "word"), vocabulary.depth(),
             *std::max_element(tables.child_counts.begin(), tables.child_counts.end()));
  fmt::print("weights       {:.2f} to {:.2f}, counted in {}\n",
             static_cast<double>(*least) / Vocabulary::kWeightUnits,
             static_cast<double>(*most) / Vocabulary::kWeightUnits,
             Count(tables.training_images, "image"));
}

nlohmann::ordered_json ToJson(const Vocabulary& vocabulary, size_t bytes) {
  const VocabularyTables& tables = vocabulary.tables();
  const auto [least, most] = std::minmax_element(tables.weights.begin(), tables.weights.end());
  return {{"words", vocabulary.word_count()},
          {"nodes", tables.centers.size() + 1},
          {"levels", vocabulary.depth()},
          {"branching", *std::max_element(tables.child_counts.begin(), tables.child_counts.end())},
          {"training_images", tables.training_images},
          {"least_weight", static_cast<double>(*least) / Vocabulary::kWeightUnits},
          {"largest_weight", static_cast<double>(*most) / Vocabulary::kWeightUnits},
          {"bytes", bytes}};
}

absl::StatusOr<ExitCode> Train(const TrainArguments& arguments) {
  const Stopwatch watch;
  CARMAP_RETURN_IF_ERROR(arguments.options.Validate());
  if (arguments.step == 0) {
    return absl::InvalidArgumentError("step 0 takes no frame; choose 1 or more");
  }
  std::vector<std::string> inputs;
  for (const std::string& drive : arguments.drives) {
    AddFiles(FilesOfDrive(drive), inputs);
  }
  CARMAP_RETURN_IF_ERROR(CheckOutputs({arguments.out}, inputs));
  CARMAP_ASSIGN_OR_RETURN(const auto images, ReadImages(arguments));
  Progress progress("training", arguments.options.depth + 1);
  const auto vocabulary = TrainVocabulary(images, arguments.options,
                                          [&](size_t done, size_t) { progress.Update(done); });
  if (!vocabulary.ok()) return WithName(arguments.drives.front(), vocabulary.status());
  const std::string bytes = EncodeVocabulary(*vocabulary);
  CARMAP_RETURN_IF_ERROR(WriteFileAtomically(arguments.out, bytes));
  PrintVocabulary(arguments.out, *vocabulary, bytes.size());
  fmt::print("trained       in {:.1f} s\n", watch.ElapsedMs() * 1e-3);
  return kSuccess;
}

absl::StatusOr<ExitCode> Info(const InfoArguments& arguments) {
  CARMAP_ASSIGN_OR_RETURN(const Vocabulary vocabulary, ReadVocabulary(arguments.vocabulary));
  const size_t bytes = EncodeVocabulary(vocabulary).size();
  if (arguments.json) {
    fmt::print("{}", JsonText(ToJson(vocabulary, bytes)));
  } else {
    PrintVocabulary(arguments.vocabulary, vocabulary, bytes);
  }
  return kSuccess;
}

void AddTrain(CLI::App& command, Command& chosen) {
  CLI::App* train = command.add_subcommand("train", "Make a vocabulary of what drives show");
  const auto arguments = std::make_shared<TrainArguments>();
  train->add_option("DRIVE", arguments->drives, "Folders of drives")->required();
  train->add_option("--out", arguments->out, "The vocabulary to write")
      ->required()
      ->type_name("V.cmvoc");
  train
      ->add_option("--branching", arguments->options.branching,
                   fmt::format("Children of a node, 2 to {} (default {})", kMaxBranching,
                               arguments->options.branching))
      ->type_name("K");
  train
      ->add_option("--depth", arguments->options.depth,
                   fmt::format("Levels of the tree (default {}): up to K^L words, of 18 bytes each",
                               arguments->options.depth))
      ->type_name("L");
  train->add_option("--step", arguments->step, "Take every N-th frame of a drive (default 2)")
      ->type_name("N");
  train->add_option("--seed", arguments->options.seed, "Of the draws (default 1)")->type_name("N");
  train->footer(
      R"(The left images' features are divided into K groups of similar ones, each of these again, L times;
the groups of the last level are the words. A word weighs the more the fewer images show it.
The same drives, options and seed give the same bytes, on any number of cores. A frame takes 150 kB
of memory.

Example:
  carmap vocabulary train suburb downtown freeway --out roads.cmvoc

Exit codes: 0 done, 1 error, 2 wrong usage)");
  train->callback([arguments, &chosen] { chosen = [arguments] { return Train(*arguments); }; });
}

void AddInfo(CLI::App& command, Command& chosen) {
  CLI::App* info = command.add_subcommand("info", "Say what a vocabulary file holds");
  const auto arguments = std::make_shared<InfoArguments>();
  info->add_option("VOCABULARY", arguments->vocabulary, "Vocabulary file (.cmvoc)")->required();
  info->add_flag("--json", arguments->json, "Print JSON");
  info->footer(R"(The whole file is read and checked: exit 0 means that it is a sound vocabulary.

Example:
  carmap vocabulary info roads.cmvoc

Exit codes: 0 done, 1 error, 2 wrong usage)");
  info->callback([arguments, &chosen] { chosen = [arguments] { return Info(*arguments); }; });
}

}  // namespace

void AddVocabularyCommand(CLI::App& app, Command& chosen) {
  CLI::App* command =
      app.add_subcommand("vocabulary", "Train and look at vocabularies, which recognize places");
  command->require_subcommand(1);
  command->footer(
      R"(A vocabulary sorts features into words; places are recognized by the words that they share.

Examples:
  carmap vocabulary train suburb downtown freeway --out roads.cmvoc
  carmap vocabulary info roads.cmvoc

Exit codes: 0 done, 1 error, 2 wrong usage)");
  AddTrain(*command, chosen);
  AddInfo(*command, chosen);
}

}  // namespace carmap
