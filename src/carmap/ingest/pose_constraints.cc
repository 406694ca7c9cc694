#include "carmap/ingest/pose_constraints.h"

#include <fmt/format.h>

#include <cmath>
#include <cstdint>
#include <utility>

#include "carmap/base/byte_io.h"
#include "carmap/base/status_macros.h"
#include "carmap/format/id_bytes.h"
#include "carmap/format/tile_codec.h"
#include "carmap/index/keyframe_tree.h"

namespace carmap {
namespace {

constexpr size_t kStepBytes = 2 * sizeof(uint32_t) + 1;
constexpr size_t kAnchorBytes = 2 * kIdBytes + 9 * sizeof(double);

void AppendAnchor(const AnchorConstraint& anchor, std::string& out) {
  AppendId(anchor.keyframe, out);
  AppendId(anchor.reference, out);
  const Rigid3& pose = anchor.reference_from_keyframe;
  for (const double value : pose.rotation.coeffs()) AppendDouble(value, out);
  for (const double value : pose.translation) AppendDouble(value, out);
  AppendDouble(anchor.sigma_m, out);
  AppendDouble(anchor.sigma_rad, out);
}

AnchorConstraint ReadAnchor(ByteReader& reader) {
  AnchorConstraint anchor;
  anchor.keyframe = ReadId<KeyframeId>(reader);
  anchor.reference = ReadId<KeyframeId>(reader);
  Rigid3& pose = anchor.reference_from_keyframe;
  for (int i = 0; i < 4; ++i) pose.rotation.coeffs()[i] = reader.Double();
  for (int i = 0; i < 3; ++i) pose.translation[i] = reader.Double();
  anchor.sigma_m = reader.Double();
  anchor.sigma_rad = reader.Double();
  return anchor;
}

bool IsSound(const AnchorConstraint& anchor) {
  constexpr double kMaxNormError = 1e-6, kMaxM = 1e6, kMinSigma = 1e-6;
  const Rigid3& pose = anchor.reference_from_keyframe;
  return std::abs(pose.rotation.norm() - 1) < kMaxNormError && pose.translation.norm() < kMaxM &&
         anchor.sigma_m > kMinSigma && anchor.sigma_m < kMaxM && anchor.sigma_rad > kMinSigma &&
         anchor.sigma_rad < kMaxM && anchor.keyframe != anchor.reference;
}

}  // namespace

PoseConstraints ConstraintsOf(const LeanMap& segment, std::vector<DriveStep> steps) {
  return {{segment.drives, segment.keyframes, {}}, std::move(steps), {}};
}

void AddAnchors(const LeanMap& base, const LeanMap& segment,
                const std::vector<AnchoredKeyframe>& anchors, PoseConstraints& constraints) {
  if (base.keyframes.empty()) return;
  const KdTree of_base = TreeOfKeyframes(base);
  for (const AnchoredKeyframe& anchor : anchors) {
    const LeanKeyframe& reference =
        base.keyframes[of_base.Nearest(anchor.base_from_camera.translation, 1).front()];
    constraints.anchors.push_back({segment.keyframes[anchor.keyframe_idx].id, reference.id,
                                   reference.map_from_camera.Inverse() * anchor.base_from_camera,
                                   anchor.sigma_m, anchor.sigma_rad});
  }
}

absl::StatusOr<std::string> EncodeConstraints(const PoseConstraints& constraints) {
  CARMAP_ASSIGN_OR_RETURN(const std::string drive, EncodeLeanMap(constraints.drive, kTileEncoding));
  std::string out;
  AppendUint(static_cast<uint32_t>(drive.size()), out);
  out += drive;
  AppendUint(static_cast<uint32_t>(constraints.steps.size()), out);
  for (const auto& [from, to, is_lost] : constraints.steps) {
    AppendUint(from, out);
    AppendUint(to, out);
    AppendUint(static_cast<uint8_t>(is_lost), out);
  }
  AppendUint(static_cast<uint32_t>(constraints.anchors.size()), out);
  for (const AnchorConstraint& anchor : constraints.anchors) AppendAnchor(anchor, out);
  return out;
}

absl::StatusOr<PoseConstraints> DecodeConstraints(std::string_view bytes, const std::string& name) {
  const auto damaged = [&] {
    return absl::DataLossError(fmt::format("{}: what it measured of poses is damaged", name));
  };
  ByteReader reader(bytes);
  const auto drive_bytes = reader.Uint<uint32_t>();
  CARMAP_ASSIGN_OR_RETURN(LeanMap drive, DecodeLeanMap(reader.Bytes(drive_bytes), name));
  PoseConstraints constraints{std::move(drive), {}, {}};
  const size_t steps = reader.Uint<uint32_t>();
  if (steps > reader.remaining() / kStepBytes) return damaged();
  for (size_t i = 0; i < steps; ++i) {
    const auto from = reader.Uint<uint32_t>(), to = reader.Uint<uint32_t>();
    if (from >= to || to >= constraints.drive.keyframes.size()) return damaged();
    constraints.steps.push_back({from, to, reader.Uint<uint8_t>() != 0});
  }
  const size_t anchors = reader.Uint<uint32_t>();
  if (anchors > reader.remaining() / kAnchorBytes) return damaged();
  for (size_t i = 0; i < anchors; ++i) {
    constraints.anchors.push_back(ReadAnchor(reader));
    if (!IsSound(constraints.anchors.back())) return damaged();
  }
  if (!reader.ok() || reader.remaining() > 0) return damaged();
  return constraints;
}

}  // namespace carmap
