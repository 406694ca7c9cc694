// Chooses the comparisons that make a signature, of drives of the same roads in different light
// with known poses. What it writes becomes part of the program; see scripts/train_signature.sh.
#include <fmt/format.h>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "carmap/base/file.h"
#include "carmap/base/progress.h"
#include "carmap/base/status_macros.h"
#include "carmap/dataset/kitti_drive.h"
#include "carmap/eval/true_matches.h"
#include "carmap/feature/feature_grid.h"
#include "carmap/feature/image_pyramid.h"
#include "carmap/feature/smoothing.h"
#include "carmap/feature/stereo_features.h"
#include "carmap/feature/test_selection.h"

namespace carmap {
namespace {

struct Frame {
  Rigid3 world_from_camera;
  std::vector<Feature> features;
  ImagePyramid smooth;
};

struct Drive {
  StereoRig rig;
  std::vector<Frame> frames;
};

absl::StatusOr<Drive> ReadDrive(const std::string& folder) {
  CARMAP_ASSIGN_OR_RETURN(const auto source, KittiDrive::Open(folder));
  StereoFrontEnd front_end(source->rig());
  Drive drive{.rig = front_end.rig(), .frames = {}};
  for (size_t n = 0; const auto image = source->Next(); ++n) {
    CARMAP_RETURN_IF_ERROR(image->status);
    if (n >= source->truth().size() || !source->truth()[n].world_from_camera) {
      return absl::FailedPreconditionError(
          fmt::format("{}: frame {} has no true pose; simulate the drive", folder, n));
    }
    Frame& frame = drive.frames.emplace_back();
    frame.world_from_camera = *source->truth()[n].world_from_camera;
    frame.features = front_end.Extract(image->left, image->right);
    const ImagePyramid levels = BuildPyramid(front_end.AtFeatureSize(image->left));
    for (size_t level = 0; level < levels.size(); ++level) {
      SmoothImage(levels[level], frame.smooth[level]);
    }
  }
  return drive;
}

SignaturePatch PatchAround(const Feature& feature, const ImagePyramid& smooth) {
  const double scale = ScaleOfLevel(feature.level);
  const auto x = static_cast<int>(std::lround(LevelFromFullSize(feature.x_px, scale)));
  const auto y = static_cast<int>(std::lround(LevelFromFullSize(feature.y_px, scale)));
  SignaturePatch patch;
  auto* to = patch.begin();
  for (int row = y - kSignatureRadius; row <= y + kSignatureRadius; ++row) {
    const uint8_t* const from = smooth[feature.level].ptr<uint8_t>(row, x - kSignatureRadius);
    to = std::copy_n(from, 2 * kSignatureRadius + 1, to);
  }
  return patch;
}

/// Features that a search for the predicted one would come upon, and that are not it.
std::vector<uint32_t> Rivals(const PredictedFeature& prediction, const Feature& truth,
                             const FeatureGrid& grid) {
  constexpr double kWindowPx = 100, kOwnCornerPx = 5, kLevels = 1.5;
  std::vector<uint32_t> rivals;
  grid.VisitNear(prediction.uvd.x(), prediction.uvd.y(), kWindowPx, [&](uint32_t idx) {
    const Feature& feature = grid.features()[idx];
    const double distance_px = std::hypot(feature.x_px - truth.x_px, feature.y_px - truth.y_px);
    if (std::abs(feature.level - prediction.level) <= kLevels &&
        distance_px > kOwnCornerPx * ScaleOfLevel(truth.level)) {
      rivals.push_back(idx);
    }
  });
  return rivals;
}

/// Every third match, each with a rival drawn by lot.
void AppendTriples(const Frame& from, const Frame& to, const StereoRig& rig,
                   std::mt19937_64& random, std::vector<PatchTriple>& triples) {
  const Rigid3 to_from_from = to.world_from_camera.Inverse() * from.world_from_camera;
  const auto predictions = PredictFeatures(from.features, to_from_from, rig);
  const FeatureGrid grid(to.features, rig.camera.width, rig.camera.height);
  for (const TrueMatch& match : FindTrueMatches(predictions, grid, rig)) {
    if (random() % 3 != 0) continue;
    const PredictedFeature& prediction = predictions[match.prediction_idx];
    const Feature& same = to.features[match.feature_idx];
    const std::vector<uint32_t> rivals = Rivals(prediction, same, grid);
    if (rivals.empty()) continue;
    const Feature& other = to.features[rivals[random() % rivals.size()]];
    triples.push_back({PatchAround(from.features[prediction.feature_idx], from.smooth),
                       PatchAround(same, to.smooth), PatchAround(other, to.smooth)});
  }
}

/// Frames of the one drive, each with those of the other that stand beside it and 3 m farther on.
std::vector<PatchTriple> TriplesOf(const Drive& first, const Drive& second,
                                   std::mt19937_64& random) {
  constexpr double kMaxApartM = 1, kMaxSideM = 8, kMaxTurnRad = 0.2;
  std::vector<PatchTriple> triples;
  for (const Frame& from : first.frames) {
    for (const double ahead_m : {0., 3.}) {
      const Frame* nearest = nullptr;
      double nearest_m = kMaxApartM;
      for (const Frame& to : second.frames) {
        const Rigid3 from_from_to = from.world_from_camera.Inverse() * to.world_from_camera;
        const double apart_m = std::abs(from_from_to.translation.z() - ahead_m);
        if (apart_m < nearest_m && from_from_to.translation.norm() < kMaxSideM &&
            RotationAngle(from_from_to.rotation) < kMaxTurnRad) {
          nearest = &to;
          nearest_m = apart_m;
        }
      }
      if (nearest != nullptr) AppendTriples(from, *nearest, first.rig, random, triples);
    }
  }
  return triples;
}

absl::Status Train(const std::vector<std::string>& drives, size_t most_a_pair,
                   const std::string& out) {
  if (drives.size() % 2 != 0) {
    return absl::InvalidArgumentError("drives come in pairs: two of one road in different light");
  }
  std::mt19937_64 random(1);
  std::vector<PatchTriple> triples;
  for (size_t i = 0; i < drives.size(); i += 2) {
    CARMAP_ASSIGN_OR_RETURN(const Drive first, ReadDrive(drives[i]));
    CARMAP_ASSIGN_OR_RETURN(const Drive second, ReadDrive(drives[i + 1]));
    std::vector<PatchTriple> of_pair = TriplesOf(first, second, random);
    std::shuffle(of_pair.begin(), of_pair.end(), random);
    of_pair.resize(std::min(of_pair.size(), most_a_pair));
    fmt::print("{:5} corners  {} {}\n", of_pair.size(), drives[i], drives[i + 1]);
    triples.insert(triples.end(), of_pair.begin(), of_pair.end());
  }
  if (triples.empty()) {
    return absl::FailedPreconditionError("no corner is seen by two drives; take the same roads");
  }
  const SelectionOptions options;
  Progress progress("choosing tests", options.tests);
  const auto tests = SelectTests(triples, options, [&](size_t done) { progress.Update(done); });
  std::string text = "// Written by `make signature`.\n";
  for (const SignatureTest& test : tests) {
    text += fmt::format("{{{}, {}, {}, {}}},\n", test.a_x, test.a_y, test.b_x, test.b_y);
  }
  return WriteFileAtomically(out, text);
}

int Main(int argc, char** argv) {
  CLI::App app("Chooses the comparisons of the signature");
  std::vector<std::string> drives;
  std::string out;
  size_t most_a_pair = 1000;
  app.add_option("DRIVES", drives, "Pairs of drives: A B C D")->required();
  app.add_option("--most", most_a_pair, "Corners of a pair, at most (default 1000)");
  app.add_option("--out", out, "The list of comparisons")->required();
  CLI11_PARSE(app, argc, argv);
  const absl::Status status = Train(drives, most_a_pair, out);
  if (!status.ok()) fmt::print(stderr, "train_signature: {}\n", std::string(status.message()));
  return status.ok() ? 0 : 1;
}

}  // namespace
}  // namespace carmap

int main(int argc, char** argv) { return carmap::Main(argc, argv); }
