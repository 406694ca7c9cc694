#include "carmap/slam/drive_sample.h"

#include <tbb/parallel_for.h>

#include <algorithm>

namespace carmap {

std::vector<uint32_t> SpreadOver(const KittiDrive& drive, size_t count) {
  std::vector<uint32_t> indices;
  const size_t steps = std::max<size_t>(count, 2) - 1;
  for (size_t i = 0; i <= steps; ++i) {
    const auto index = drive.first() + static_cast<uint32_t>((drive.size() - 1) * i / steps);
    if (indices.empty() || index > indices.back()) indices.push_back(index);
  }
  return indices;
}

std::vector<SampledPair> SamplePairs(const KittiDrive& drive, const std::vector<uint32_t>& indices,
                                     const RowMisalignment& misalignment) {
  std::vector<std::optional<SampledPair>> found(indices.size());
  tbb::parallel_for(size_t{0}, indices.size(), [&](size_t i) {
    const StereoFrame frame = drive.Read(indices[i]);
    if (!frame.status.ok()) return;
    StereoFrontEnd front_end(drive.rig(), {.misalignment = misalignment});
    const std::vector<Feature> features = front_end.Extract(frame.left, frame.right);
    found[i] = {{frame.index, front_end.MeasurePair(features), front_end.brightness_ratio()},
                features.size(),
                static_cast<size_t>(
                    std::count_if(features.begin(), features.end(),
                                  [](const Feature& feature) { return feature.has_disparity(); }))};
  });
  std::vector<SampledPair> sample;
  for (const auto& pair : found) {
    if (pair) sample.push_back(*pair);
  }
  return sample;
}

std::vector<CheckedPair> PairsOf(const std::vector<SampledPair>& sample) {
  std::vector<CheckedPair> pairs;
  for (const SampledPair& sampled : sample) pairs.push_back(sampled.pair);
  return pairs;
}

RowMisalignment FindMisalignment(const KittiDrive& drive) {
  constexpr size_t kFirstPairs = 3, kPairs = 15;
  const auto misalignment_of = [&](size_t count) {
    return CorrectableMisalignment(PairsOf(SamplePairs(drive, SpreadOver(drive, count))));
  };
  if (!misalignment_of(kFirstPairs)) return {};
  return misalignment_of(kPairs).value_or(RowMisalignment());
}

uint32_t FindOnset(const KittiDrive& drive, DriveFault fault, uint32_t sound_index,
                   uint32_t faulty_index) {
  while (faulty_index - sound_index > 1) {
    const uint32_t middle = sound_index + (faulty_index - sound_index) / 2;
    const auto sample = SamplePairs(drive, {middle});
    const bool is_faulty = !sample.empty() && FaultOf(sample.front().pair.geometry) == fault;
    (is_faulty ? faulty_index : sound_index) = middle;
  }
  return faulty_index;
}

}  // namespace carmap
