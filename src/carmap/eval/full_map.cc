#include "carmap/eval/full_map.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <optional>
#include <utility>

#include "carmap/base/byte_io.h"
#include "carmap/base/status_macros.h"
#include "carmap/format/container.h"

namespace carmap {
namespace {

constexpr uint16_t kFullMapSection = 100;  // lean maps have the low numbers
constexpr size_t kFeatureBytes = 3 * 4 + 1 + sizeof(Descriptor) + 4, kLandmarkBytes = 3 * 8,
                 kKeyframeBytes = 4 + 8 + 7 * 8 + 4;
constexpr int kMaxImagePx = 1 << 14;
constexpr double kMaxCoordinateM = 1e7;

class Writer {
 public:
  void Int(int value) { AppendUint(static_cast<uint32_t>(value), bytes); }
  void Count(size_t value) { AppendUint(static_cast<uint32_t>(value), bytes); }
  void Vector(const Eigen::Vector3d& v) {
    for (const double value : v) AppendDouble(value, bytes);
  }
  void Rig(const StereoRig& rig) {
    const PinholeCamera& camera = rig.camera;
    for (const double value : {camera.fx, camera.fy, camera.cx, camera.cy, rig.baseline_m}) {
      AppendDouble(value, bytes);
    }
    Vector(rig.disparity_bias.coefficients_px);
    Int(camera.width);
    Int(camera.height);
  }
  void Pose(const Rigid3& pose) {
    for (const double value : pose.rotation.coeffs()) AppendDouble(value, bytes);
    Vector(pose.translation);
  }
  void Feature(const FullFeature& full) {
    for (const float value : {full.feature.x_px, full.feature.y_px, full.feature.disparity_px}) {
      AppendFloat(value, bytes);
    }
    AppendUint(full.feature.level, bytes);
    for (const uint64_t word : full.feature.descriptor.words) AppendUint(word, bytes);
    AppendUint(full.landmark_idx, bytes);
  }

  std::string bytes;
};

/// Reads what Writer writes. A value out of its range is remembered, like an end that comes early.
class Reader {
 public:
  explicit Reader(std::string_view bytes) : reader_(bytes) {}

  bool ok() const { return reader_.ok() && in_range_; }
  bool at_end() const { return reader_.remaining() == 0; }

  uint32_t Uint() { return reader_.Uint<uint32_t>(); }
  uint64_t Uint64() { return reader_.Uint<uint64_t>(); }
  /// Of records that take at least so many bytes each: no more than the bytes that are left hold.
  size_t Count(size_t record_bytes) {
    const size_t count = Uint();
    Require(count <= reader_.remaining() / record_bytes);
    return ok() ? count : 0;
  }
  double Number(double low, double high) {
    const double value = reader_.Double();
    Require(value >= low && value <= high);
    return value;
  }
  Eigen::Vector3d Vector(double max) {
    const double x = Number(-max, max), y = Number(-max, max), z = Number(-max, max);
    return {x, y, z};
  }
  StereoRig Rig() {
    StereoRig rig;
    rig.camera.fx = Number(1, 1e6);
    rig.camera.fy = Number(1, 1e6);
    rig.camera.cx = Number(-1e6, 1e6);
    rig.camera.cy = Number(-1e6, 1e6);
    rig.baseline_m = Number(1e-6, 1e3);
    rig.disparity_bias.coefficients_px = Vector(1e3);
    rig.camera.width = ImageSide();
    rig.camera.height = ImageSide();
    return rig;
  }
  Rigid3 Pose() {
    Eigen::Vector4d q;
    for (double& value : q) value = Number(-2, 2);
    Require(std::abs(q.norm() - 1) < 1e-6);
    return {Eigen::Quaterniond(q), Vector(kMaxCoordinateM)};
  }
  FullFeature Feature(size_t landmark_count) {
    FullFeature full;
    full.feature.x_px = Pixel();
    full.feature.y_px = Pixel();
    full.feature.disparity_px = Pixel();
    full.feature.level = reader_.Uint<uint8_t>();
    Require(full.feature.level < kLevelCount);
    for (uint64_t& word : full.feature.descriptor.words) word = Uint64();
    full.landmark_idx = Uint();
    Require(full.landmark_idx == FullFeature::kNoLandmark || full.landmark_idx < landmark_count);
    return full;
  }
  void Require(bool is_in_range) { in_range_ = in_range_ && is_in_range; }

 private:
  int ImageSide() {
    const uint32_t side = Uint();
    Require(side > 0 && side <= kMaxImagePx);
    return static_cast<int>(side);
  }
  float Pixel() {
    const auto value = std::bit_cast<float>(Uint());
    Require(value >= -1 && value <= kMaxImagePx);
    return value;
  }

  ByteReader reader_;
  bool in_range_ = true;
};

FullKeyframe ReadKeyframe(Reader& reader, size_t landmark_count) {
  FullKeyframe keyframe;
  keyframe.index = reader.Uint();
  keyframe.timestamp.ns = static_cast<int64_t>(reader.Uint64());
  keyframe.map_from_camera = reader.Pose();
  const size_t count = reader.Count(kFeatureBytes);
  keyframe.features.reserve(count);
  for (size_t i = 0; i < count; ++i) keyframe.features.push_back(reader.Feature(landmark_count));
  return keyframe;
}

/// The map, as far as it can be read; `reader` knows whether that is all of it.
FullMap ReadMap(Reader& reader) {
  FullMap map;
  map.drive.id.input = reader.Uint64();
  map.drive.id.options = reader.Uint64();
  map.drive.rig = reader.Rig();
  const size_t landmarks = reader.Count(kLandmarkBytes);
  map.landmarks_in_map.reserve(landmarks);
  for (size_t i = 0; i < landmarks; ++i) {
    map.landmarks_in_map.push_back(reader.Vector(kMaxCoordinateM));
  }
  const size_t keyframes = reader.Count(kKeyframeBytes);
  for (size_t i = 0; i < keyframes && reader.ok(); ++i) {
    FullKeyframe keyframe = ReadKeyframe(reader, landmarks);
    reader.Require(map.keyframes.empty() || map.keyframes.back().index < keyframe.index);
    map.keyframes.push_back(std::move(keyframe));
  }
  reader.Require(reader.at_end());
  return map;
}

std::optional<Eigen::Vector3d> PositionInMap(const FullMap& map, const FullKeyframe& keyframe,
                                             const FullFeature& full) {
  if (full.landmark_idx != FullFeature::kNoLandmark) return map.landmarks_in_map[full.landmark_idx];
  if (!full.feature.has_disparity()) return std::nullopt;
  const StereoRig& rig = map.drive.rig;
  const double disparity_px = rig.WithoutBias(full.feature.x_px, full.feature.disparity_px);
  if (disparity_px <= 0) return std::nullopt;
  return keyframe.map_from_camera *
         rig.Triangulate({full.feature.x_px, full.feature.y_px}, disparity_px);
}

}  // namespace

FullMap FullMapOf(const Map& map, const LeanDrive& drive) {
  FullMap full{.drive = drive};
  std::vector<LandmarkId> landmark_ids;  // ascending
  for (const auto& [id, landmark] : map.landmarks()) {
    landmark_ids.push_back(id);
    full.landmarks_in_map.push_back(landmark.position_in_map);
  }
  for (const auto& [id, keyframe] : map.keyframes()) {
    FullKeyframe& kept = full.keyframes.emplace_back(
        FullKeyframe{id.index, keyframe.timestamp, keyframe.map_from_camera, {}});
    const auto& landmarks = map.LandmarksOf(id);
    for (size_t i = 0; i < keyframe.features->size(); ++i) {
      FullFeature& feature = kept.features.emplace_back(FullFeature{(*keyframe.features)[i]});
      if (!landmarks[i]) continue;
      const auto found = std::lower_bound(landmark_ids.begin(), landmark_ids.end(), *landmarks[i]);
      feature.landmark_idx = static_cast<uint32_t>(found - landmark_ids.begin());
    }
  }
  return full;
}

std::string EncodeFullMap(const FullMap& map) {
  Writer writer;
  AppendUint(map.drive.id.input, writer.bytes);
  AppendUint(map.drive.id.options, writer.bytes);
  writer.Rig(map.drive.rig);
  writer.Count(map.landmarks_in_map.size());
  for (const Eigen::Vector3d& landmark : map.landmarks_in_map) writer.Vector(landmark);
  writer.Count(map.keyframes.size());
  for (const FullKeyframe& keyframe : map.keyframes) {
    AppendUint(keyframe.index, writer.bytes);
    AppendUint(static_cast<uint64_t>(keyframe.timestamp.ns), writer.bytes);
    writer.Pose(keyframe.map_from_camera);
    writer.Count(keyframe.features.size());
    for (const FullFeature& feature : keyframe.features) writer.Feature(feature);
  }
  return WriteContainer({{kFullMapSection, true, std::move(writer.bytes)}});
}

absl::StatusOr<FullMap> DecodeFullMap(std::string_view bytes, const std::string& name) {
  CARMAP_ASSIGN_OR_RETURN(const auto sections, ReadContainer(bytes, name));
  if (sections.size() != 1 || sections.front().id != kFullMapSection) {
    return absl::InvalidArgumentError(fmt::format(
        "{}: is no full map; give what `carmap map --full-map` wrote of the drive", name));
  }
  Reader reader(sections.front().content);
  FullMap map = ReadMap(reader);
  if (!reader.ok()) {
    return absl::DataLossError(
        fmt::format("{}: its records do not fit together; write it anew with `carmap map "
                    "--full-map`",
                    name));
  }
  return map;
}

MapSnapshot SnapshotOf(const FullMap& map) {
  MapSnapshot snapshot;
  for (const FullKeyframe& keyframe : map.keyframes) {
    SnapshotKeyframe& kept = snapshot.keyframes.emplace_back();
    kept.id = {map.drive.id, keyframe.index};
    kept.timestamp = keyframe.timestamp;
    kept.map_from_camera = keyframe.map_from_camera;
    for (const FullFeature& full : keyframe.features) {
      const auto position_in_map = PositionInMap(map, keyframe, full);
      if (!position_in_map) continue;
      const auto idx = static_cast<uint32_t>(snapshot.landmarks.size());
      kept.landmark_idxs.push_back(idx);
      SnapshotLandmark& landmark = snapshot.landmarks.emplace_back();
      landmark.id = {map.drive.id, idx};
      landmark.position_in_map = *position_in_map;
      landmark.descriptor = full.feature.descriptor;
      const Eigen::Vector3d& viewer = keyframe.map_from_camera.translation;
      DeriveVisibility({viewer}, viewer, full.feature.level, landmark);
    }
  }
  return snapshot;
}

LeanMap KeyframesOf(const FullMap& map) {
  LeanMap lean;
  lean.drives = {map.drive};
  for (const FullKeyframe& keyframe : map.keyframes) {
    lean.keyframes.push_back({.id = {map.drive.id, keyframe.index},
                              .timestamp = keyframe.timestamp,
                              .map_from_camera = keyframe.map_from_camera,
                              .gps = std::nullopt});
  }
  return lean;
}

}  // namespace carmap
