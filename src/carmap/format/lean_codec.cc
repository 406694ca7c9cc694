#include "carmap/format/lean_codec.h"

#include <fmt/format.h>
#include <xxhash.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <optional>
#include <utility>
#include <vector>

#include "carmap/base/byte_io.h"
#include "carmap/base/file.h"
#include "carmap/base/status_macros.h"
#include "carmap/format/columns.h"
#include "carmap/format/container.h"
#include "carmap/format/lean_grid.h"
#include "carmap/format/lean_sections.h"

namespace carmap {
namespace {

enum LeanSection : uint16_t { kCounts = 1, kDrives, kKeyframes, kLandmarks, kDescriptors };
bool IsAddedSection(uint16_t id) { return id > kDescriptors && id <= kLastAddedSection; }

/// What a file with this section is.
const char* NameOfAdded(uint16_t id) {
  switch (static_cast<AddedSection>(id)) {
    case AddedSection::kTile:
      return "a tile of a base map";
    case AddedSection::kPatch:
      return "a patch of a base map";
    case AddedSection::kDiff:
      return "a diff of a base map";
    case AddedSection::kNone:
      break;
  }
  return "a map";
}

constexpr const char* kSectionNames[] = {"",          "counts",    "drives",
                                         "keyframes", "landmarks", "descriptors"};

constexpr uint64_t kMaxDrives = uint64_t{1} << 16;
constexpr uint64_t kMaxKeyframes = uint64_t{1} << 24;
constexpr uint64_t kMaxLandmarks = uint64_t{1} << 28;
constexpr uint64_t kMaxObservations = uint64_t{1} << 36;
constexpr size_t kDriveBytes = 100;
/// In place of the start of a drive that is not known.
constexpr int64_t kNoStart = INT64_MIN;
/// Of a keyframe.
constexpr char kHasGps = 1, kIsStub = 2;
constexpr size_t kDescriptorBytes = sizeof(Descriptor);

/// How many records of each kind the columns hold.
struct Counts {
  uint64_t drives = 0, keyframes = 0, gps_fixes = 0, landmarks = 0;
  uint64_t runs = 0;          ///< of consecutive keyframes, in all keyframe lists together
  uint64_t observations = 0;  ///< entries of all keyframe lists together
};

/// A bound on what the map takes in memory, for comparison with its file.
uint64_t DecodedSize(const Counts& counts) {
  return 128 * (counts.drives + counts.keyframes + counts.landmarks) + 16 * counts.runs +
         4 * counts.observations;
}

/// A file of this size may decode to this much, so that no small file exhausts memory.
uint64_t DecodedSizeLimit(uint64_t file_size) { return (uint64_t{1} << 20) + 64 * file_size; }

bool IsWithinLimits(const Counts& counts) {
  return counts.drives <= kMaxDrives && counts.keyframes <= kMaxKeyframes &&
         counts.landmarks <= kMaxLandmarks && counts.observations <= kMaxObservations;
}

/// Calls visit(first, length) for each run of consecutive numbers.
template <typename Visitor>
void ForEachRun(const std::vector<uint32_t>& ascending, Visitor visit) {
  for (size_t begin = 0; begin < ascending.size();) {
    size_t end = begin + 1;
    while (end < ascending.size() && ascending[end] == ascending[end - 1] + 1) ++end;
    visit(ascending[begin], static_cast<uint32_t>(end - begin));
    begin = end;
  }
}

Counts CountsOf(const LeanMap& map) {
  Counts counts;
  counts.drives = map.drives.size();
  counts.keyframes = map.keyframes.size();
  counts.landmarks = map.landmarks.size();
  for (const LeanKeyframe& keyframe : map.keyframes) counts.gps_fixes += keyframe.gps ? 1 : 0;
  for (const LeanLandmark& landmark : map.landmarks) {
    counts.observations += landmark.keyframe_idxs.size();
    ForEachRun(landmark.keyframe_idxs, [&](uint32_t, uint32_t) { ++counts.runs; });
  }
  return counts;
}

// Writing. The order of the columns is that of docs/format.md.

/// Each less the one before it; the first as it is.
std::vector<GridVector> Differences(const std::vector<GridVector>& values) {
  std::vector<GridVector> differences(values);
  for (size_t i = 1; i < values.size(); ++i) differences[i] -= values[i - 1];
  return differences;
}

void AppendVectors(const std::vector<GridVector>& values, int level, std::string& out) {
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<uint64_t> column;
    column.reserve(values.size());
    for (const GridVector& value : values) column.push_back(ZigZag(value[axis]));
    AppendIntColumn(column, level, out);
  }
}

/// Records are ordered by (drive, index): how many each drive has, and how many indices lie between
/// one and the next.
template <typename Record>
void AppendIds(const std::vector<LeanDrive>& drives, const std::vector<Record>& records, int level,
               std::string& out) {
  std::vector<uint64_t> per_drive, skipped;
  auto record = records.begin();
  for (const LeanDrive& drive : drives) {
    const auto first = record;
    uint64_t next_index = 0;
    for (; record != records.end() && record->id.drive == drive.id; ++record) {
      skipped.push_back(record->id.index - next_index);
      next_index = uint64_t{record->id.index} + 1;
    }
    per_drive.push_back(static_cast<uint64_t>(record - first));
  }
  AppendIntColumn(per_drive, level, out);
  AppendIntColumn(skipped, level, out);
}

std::string EncodeCounts(const Counts& counts) {
  std::string out;
  AppendUint(static_cast<uint8_t>(static_cast<int8_t>(kPositionExponent)), out);
  AppendUint(static_cast<uint32_t>(counts.drives), out);
  AppendUint(static_cast<uint32_t>(counts.keyframes), out);
  AppendUint(static_cast<uint32_t>(counts.gps_fixes), out);
  AppendUint(static_cast<uint32_t>(counts.landmarks), out);
  AppendUint(counts.runs, out);
  AppendUint(counts.observations, out);
  return out;
}

std::string EncodeDrives(const std::vector<LeanDrive>& drives) {
  std::string out;
  for (const LeanDrive& drive : drives) {
    const PinholeCamera& camera = drive.rig.camera;
    AppendUint(drive.id.input, out);
    AppendUint(drive.id.options, out);
    for (const double value : {camera.fx, camera.fy, camera.cx, camera.cy, drive.rig.baseline_m}) {
      AppendDouble(value, out);
    }
    for (const double value : drive.rig.disparity_bias.coefficients_px) AppendDouble(value, out);
    AppendUint(static_cast<uint32_t>(camera.width), out);
    AppendUint(static_cast<uint32_t>(camera.height), out);
    AppendUint(static_cast<uint32_t>(drive.faults.to_ulong()), out);
    AppendUint(static_cast<uint64_t>(drive.unix_start ? drive.unix_start->ns : kNoStart), out);
  }
  return out;
}

std::string EncodeKeyframes(const LeanMap& map, int level) {
  std::vector<uint64_t> times;
  std::vector<GridVector> rotations, translations, fixes;
  std::string flags;
  uint64_t previous_ns = 0;
  for (const LeanKeyframe& keyframe : map.keyframes) {
    const uint64_t ns = static_cast<uint64_t>(keyframe.timestamp.ns);
    times.push_back(ZigZag(static_cast<int64_t>(ns - previous_ns)));
    previous_ns = ns;
    rotations.push_back(RotationToGrid(keyframe.map_from_camera.rotation));
    translations.push_back(ToGrid(keyframe.map_from_camera.translation, kTranslationExponent));
    flags.push_back(
        static_cast<char>((keyframe.gps ? kHasGps : 0) | (keyframe.is_stub ? kIsStub : 0)));
    if (keyframe.gps) fixes.push_back(GpsToGrid(*keyframe.gps));
  }
  std::string out;
  AppendIds(map.drives, map.keyframes, level, out);
  AppendIntColumn(times, level, out);
  AppendVectors(Differences(rotations), level, out);
  AppendVectors(Differences(translations), level, out);
  AppendByteColumn(flags, level, out);
  AppendVectors(Differences(fixes), level, out);
  return out;
}

void AppendKeyframeLists(const std::vector<LeanLandmark>& landmarks, int level, std::string& out) {
  std::vector<uint64_t> extra_runs, firsts, extra_lengths, extra_gaps;
  int64_t previous_first = 0;
  for (const LeanLandmark& landmark : landmarks) {
    const int64_t first = landmark.keyframe_idxs.front();
    firsts.push_back(ZigZag(first - previous_first));
    previous_first = first;
    uint64_t runs = 0;
    uint32_t run_end = 0;
    ForEachRun(landmark.keyframe_idxs, [&](uint32_t run_first, uint32_t length) {
      if (runs > 0) extra_gaps.push_back(run_first - run_end - 1);
      extra_lengths.push_back(length - 1);
      run_end = run_first + length;
      ++runs;
    });
    extra_runs.push_back(runs - 1);
  }
  for (const auto* column : {&firsts, &extra_runs, &extra_lengths, &extra_gaps}) {
    AppendIntColumn(*column, level, out);
  }
}

std::string EncodeLandmarks(const LeanMap& map, int level) {
  std::string anchor_levels, drive_counts;
  std::vector<uint64_t> views_after_anchor;
  std::vector<GridVector> positions;
  for (const LeanLandmark& landmark : map.landmarks) {
    const std::vector<uint32_t>& seen_by = landmark.keyframe_idxs;
    anchor_levels.push_back(static_cast<char>(landmark.anchor_level));
    drive_counts.push_back(static_cast<char>(landmark.drive_count));
    views_after_anchor.push_back(static_cast<uint64_t>(
        seen_by.end() - std::upper_bound(seen_by.begin(), seen_by.end(), landmark.anchor_idx)));
    positions.push_back(ToGrid(PositionInAnchor(map, landmark), kPositionExponent));
  }
  std::string out;
  AppendIds(map.drives, map.landmarks, level, out);
  AppendByteColumn(anchor_levels, level, out);
  AppendByteColumn(drive_counts, level, out);
  AppendKeyframeLists(map.landmarks, level, out);
  AppendIntColumn(views_after_anchor, level, out);
  AppendVectors(positions, level, out);
  return out;
}

/// A column for each byte: neighbouring tests of a descriptor agree a little more often
/// than not, which whole descriptors hide.
std::string EncodeDescriptors(const std::vector<LeanLandmark>& landmarks, int level) {
  std::string out, column(landmarks.size(), '\0');
  for (size_t byte = 0; byte < kDescriptorBytes; ++byte) {
    for (size_t i = 0; i < landmarks.size(); ++i) {
      column[i] = static_cast<char>(landmarks[i].descriptor.words[byte / 8] >> (8 * (byte % 8)));
    }
    AppendByteColumn(column, level, out);
  }
  return out;
}

std::vector<Section> SectionsOf(const LeanMap& map, const Counts& counts, int level) {
  return {{kCounts, true, EncodeCounts(counts)},
          {kDrives, true, EncodeDrives(map.drives)},
          {kKeyframes, true, EncodeKeyframes(map, level)},
          {kLandmarks, true, EncodeLandmarks(map, level)},
          {kDescriptors, true, EncodeDescriptors(map.landmarks, level)}};
}

std::string EncodeAtLevel(const LeanMap& map, const Counts& counts,
                          const std::optional<Section>& added, int level) {
  std::vector<Section> sections = SectionsOf(map, counts, level);
  if (added) sections.push_back(*added);
  return WriteContainer(sections);
}

absl::Status CheckRange(const LeanMap& map) {
  // Rounding may take a landmark farther out, and must not take it out of what a reader accepts.
  constexpr double kRoundingM = 2;
  const auto is_near = [](const Eigen::Vector3d& p, double margin_m) {
    return p.cwiseAbs().maxCoeff() <= kMaxCoordinateM - margin_m;
  };
  for (size_t i = 0; i < map.keyframes.size(); ++i) {
    if (!is_near(map.keyframes[i].map_from_camera.translation, 0)) {
      return absl::InvalidArgumentError(fmt::format(
          "keyframe {} of the map lies more than {} m from its origin", i, kMaxCoordinateM));
    }
  }
  for (size_t i = 0; i < map.landmarks.size(); ++i) {
    if (!is_near(map.landmarks[i].position_in_map, kRoundingM)) {
      return absl::InvalidArgumentError(fmt::format(
          "landmark {} of the map lies more than {} m from its origin", i, kMaxCoordinateM));
    }
    if (PositionInAnchor(map, map.landmarks[i]).cwiseAbs().maxCoeff() > kMaxAnchorDistanceM) {
      return absl::InvalidArgumentError(
          fmt::format("landmark {} of the map lies more than {:.0f} m from its anchor", i,
                      kMaxAnchorDistanceM));
    }
  }
  return absl::OkStatus();
}

// Reading. Errors say what is wrong; DecodeLeanMap adds file and section.

absl::Status Malformed(const char* what) { return absl::DataLossError(what); }

int64_t WrappingAdd(int64_t a, int64_t b) {
  return static_cast<int64_t>(static_cast<uint64_t>(a) + static_cast<uint64_t>(b));
}

GridVector WrappingAdd(const GridVector& a, const GridVector& b) {
  return {WrappingAdd(a.x(), b.x()), WrappingAdd(a.y(), b.y()), WrappingAdd(a.z(), b.z())};
}

uint64_t SaturatingAdd(uint64_t a, uint64_t b) { return a > UINT64_MAX - b ? UINT64_MAX : a + b; }

absl::StatusOr<std::vector<GridVector>> ReadVectors(ByteReader& reader, size_t count) {
  std::vector<GridVector> values(count);
  for (int axis = 0; axis < 3; ++axis) {
    CARMAP_ASSIGN_OR_RETURN(const std::vector<uint64_t> column, ReadIntColumn(reader, count));
    for (size_t i = 0; i < count; ++i) values[i][axis] = UnZigZag(column[i]);
  }
  return values;
}

absl::StatusOr<std::vector<GridVector>> ReadDifferences(ByteReader& reader, size_t count) {
  CARMAP_ASSIGN_OR_RETURN(std::vector<GridVector> values, ReadVectors(reader, count));
  for (size_t i = 1; i < count; ++i) values[i] = WrappingAdd(values[i - 1], values[i]);
  return values;
}

template <typename Id>
absl::StatusOr<std::vector<Id>> ReadIds(ByteReader& reader, const std::vector<LeanDrive>& drives,
                                        size_t count) {
  CARMAP_ASSIGN_OR_RETURN(const std::vector<uint64_t> per_drive,
                          ReadIntColumn(reader, drives.size()));
  CARMAP_ASSIGN_OR_RETURN(const std::vector<uint64_t> skipped, ReadIntColumn(reader, count));
  std::vector<Id> ids;
  ids.reserve(count);
  for (size_t drive = 0; drive < drives.size(); ++drive) {
    if (per_drive[drive] > count - ids.size()) return Malformed("drives have too many records");
    uint64_t next_index = 0;
    for (uint64_t i = 0; i < per_drive[drive]; ++i) {
      const uint64_t gap = skipped[ids.size()];
      if (next_index > UINT32_MAX || gap > UINT32_MAX - next_index) {
        return Malformed("an index exceeds 32 bits");
      }
      next_index += gap;
      ids.push_back({drives[drive].id, static_cast<uint32_t>(next_index)});
      ++next_index;
    }
  }
  if (ids.size() != count) return Malformed("drives have too few records");
  return ids;
}

struct Header {
  Counts counts;
  int position_exponent = 0;
};

absl::StatusOr<Header> DecodeCounts(std::string_view bytes) {
  ByteReader reader(bytes);
  Header header;
  header.position_exponent = static_cast<int8_t>(reader.Uint<uint8_t>());
  Counts& counts = header.counts;
  counts.drives = reader.Uint<uint32_t>();
  counts.keyframes = reader.Uint<uint32_t>();
  counts.gps_fixes = reader.Uint<uint32_t>();
  counts.landmarks = reader.Uint<uint32_t>();
  counts.runs = reader.Uint<uint64_t>();
  counts.observations = reader.Uint<uint64_t>();
  if (!reader.ok() || reader.remaining() != 0) return Malformed("wrong length");
  if (header.position_exponent < kMinPositionExponent ||
      header.position_exponent > kMaxPositionExponent) {
    return Malformed("impossible grid of positions");
  }
  if (counts.gps_fixes > counts.keyframes || counts.runs < counts.landmarks ||
      counts.observations < counts.runs) {
    return Malformed("counts contradict each other");
  }
  return header;
}

absl::StatusOr<std::vector<LeanDrive>> DecodeDrives(std::string_view bytes, size_t count) {
  if (bytes.size() != kDriveBytes * count) return Malformed("wrong length");
  ByteReader reader(bytes);
  std::vector<LeanDrive> drives(count);
  for (LeanDrive& drive : drives) {
    PinholeCamera& camera = drive.rig.camera;
    drive.id.input = reader.Uint<uint64_t>();
    drive.id.options = reader.Uint<uint64_t>();
    for (double* value : {&camera.fx, &camera.fy, &camera.cx, &camera.cy, &drive.rig.baseline_m}) {
      *value = reader.Double();
    }
    for (double& value : drive.rig.disparity_bias.coefficients_px) value = reader.Double();
    camera.width = static_cast<int>(reader.Uint<uint32_t>());
    camera.height = static_cast<int>(reader.Uint<uint32_t>());
    const auto faults = reader.Uint<uint32_t>();
    if (faults >> kDriveFaultCount != 0) return Malformed("unknown faults of a drive");
    drive.faults = faults;
    const auto start_ns = static_cast<int64_t>(reader.Uint<uint64_t>());
    if (start_ns != kNoStart) drive.unix_start = Timestamp{start_ns};
  }
  return drives;
}

absl::Status ReadTimes(ByteReader& reader, std::vector<LeanKeyframe>& keyframes) {
  CARMAP_ASSIGN_OR_RETURN(const std::vector<uint64_t> times,
                          ReadIntColumn(reader, keyframes.size()));
  int64_t ns = 0;
  for (size_t i = 0; i < keyframes.size(); ++i) {
    ns = WrappingAdd(ns, UnZigZag(times[i]));
    keyframes[i].timestamp = {ns};
  }
  return absl::OkStatus();
}

absl::Status ReadPoses(ByteReader& reader, std::vector<LeanKeyframe>& keyframes) {
  const size_t count = keyframes.size();
  CARMAP_ASSIGN_OR_RETURN(const std::vector<GridVector> rotations, ReadDifferences(reader, count));
  CARMAP_ASSIGN_OR_RETURN(const std::vector<GridVector> translations,
                          ReadDifferences(reader, count));
  for (size_t i = 0; i < count; ++i) {
    if (!IsRotation(rotations[i])) return Malformed("a pose is not a rotation");
    if (!IsInRange(translations[i], kTranslationExponent, kMaxCoordinateM)) {
      return Malformed("a keyframe lies too far away");
    }
    keyframes[i].map_from_camera = {RotationFromGrid(rotations[i]),
                                    FromGrid(translations[i], kTranslationExponent)};
  }
  return absl::OkStatus();
}

absl::Status ReadFlagsAndGps(ByteReader& reader, size_t fix_count,
                             std::vector<LeanKeyframe>& keyframes) {
  CARMAP_ASSIGN_OR_RETURN(const std::string flags, ReadByteColumn(reader, keyframes.size()));
  size_t with_fix = 0;
  for (size_t i = 0; i < keyframes.size(); ++i) {
    if ((flags[i] & ~(kHasGps | kIsStub)) != 0) return Malformed("a keyframe has unknown flags");
    with_fix += flags[i] & kHasGps;
    keyframes[i].is_stub = (flags[i] & kIsStub) != 0;
  }
  if (with_fix != fix_count) return Malformed("it is unclear which keyframes have a GPS fix");
  CARMAP_ASSIGN_OR_RETURN(const std::vector<GridVector> fixes, ReadDifferences(reader, fix_count));
  auto fix = fixes.begin();
  for (size_t i = 0; i < keyframes.size(); ++i) {
    if ((flags[i] & kHasGps) != 0) keyframes[i].gps = GpsFromGrid(*fix++);
  }
  return absl::OkStatus();
}

absl::Status DecodeKeyframes(std::string_view bytes, const Counts& counts, LeanMap& map) {
  ByteReader reader(bytes);
  CARMAP_ASSIGN_OR_RETURN(const std::vector<KeyframeId> ids,
                          ReadIds<KeyframeId>(reader, map.drives, counts.keyframes));
  map.keyframes.resize(counts.keyframes);
  for (size_t i = 0; i < ids.size(); ++i) map.keyframes[i].id = ids[i];
  CARMAP_RETURN_IF_ERROR(ReadTimes(reader, map.keyframes));
  CARMAP_RETURN_IF_ERROR(ReadPoses(reader, map.keyframes));
  CARMAP_RETURN_IF_ERROR(ReadFlagsAndGps(reader, counts.gps_fixes, map.keyframes));
  if (reader.remaining() != 0) return Malformed("bytes follow its columns");
  return absl::OkStatus();
}

void AppendRange(uint64_t begin, uint64_t length, std::vector<uint32_t>& list) {
  const size_t old_size = list.size();
  list.resize(old_size + length);
  std::iota(list.begin() + static_cast<ptrdiff_t>(old_size), list.end(),
            static_cast<uint32_t>(begin));
}

absl::Status ReadKeyframeLists(ByteReader& reader, const Counts& counts,
                               std::vector<LeanLandmark>& landmarks) {
  CARMAP_ASSIGN_OR_RETURN(const auto firsts, ReadIntColumn(reader, counts.landmarks));
  CARMAP_ASSIGN_OR_RETURN(const auto extra_runs, ReadIntColumn(reader, counts.landmarks));
  CARMAP_ASSIGN_OR_RETURN(const auto extra_lengths, ReadIntColumn(reader, counts.runs));
  CARMAP_ASSIGN_OR_RETURN(const auto extra_gaps,
                          ReadIntColumn(reader, counts.runs - counts.landmarks));
  auto extra_length = extra_lengths.begin();
  auto extra_gap = extra_gaps.begin();
  uint64_t first = 0, observations_left = counts.observations;
  for (size_t i = 0; i < landmarks.size(); ++i) {
    first += static_cast<uint64_t>(UnZigZag(firsts[i]));
    if (extra_runs[i] > static_cast<uint64_t>(extra_gaps.end() - extra_gap)) {
      return Malformed("keyframe lists have too many runs");
    }
    uint64_t begin = first;
    for (uint64_t run = 0; run <= extra_runs[i]; ++run) {
      if (run > 0) begin = SaturatingAdd(begin, SaturatingAdd(*extra_gap++, 1));
      if (begin >= counts.keyframes || *extra_length >= counts.keyframes - begin) {
        return Malformed("a keyframe list exceeds the keyframes");
      }
      const uint64_t length = *extra_length++ + 1;
      if (length > observations_left) return Malformed("keyframe lists are longer than counted");
      AppendRange(begin, length, landmarks[i].keyframe_idxs);
      observations_left -= length;
      begin += length;
    }
  }
  if (extra_gap != extra_gaps.end() || observations_left != 0) {
    return Malformed("keyframe lists are shorter than counted");
  }
  return absl::OkStatus();
}

absl::Status DecodeLandmarks(std::string_view bytes, const Header& header, LeanMap& map) {
  ByteReader reader(bytes);
  const size_t count = header.counts.landmarks;
  CARMAP_ASSIGN_OR_RETURN(const std::vector<LandmarkId> ids,
                          ReadIds<LandmarkId>(reader, map.drives, count));
  CARMAP_ASSIGN_OR_RETURN(const std::string anchor_levels, ReadByteColumn(reader, count));
  CARMAP_ASSIGN_OR_RETURN(const std::string drive_counts, ReadByteColumn(reader, count));
  map.landmarks.resize(count);
  CARMAP_RETURN_IF_ERROR(ReadKeyframeLists(reader, header.counts, map.landmarks));
  CARMAP_ASSIGN_OR_RETURN(const auto views_after_anchor, ReadIntColumn(reader, count));
  CARMAP_ASSIGN_OR_RETURN(const std::vector<GridVector> positions, ReadVectors(reader, count));
  if (reader.remaining() != 0) return Malformed("bytes follow its columns");
  for (size_t i = 0; i < count; ++i) {
    LeanLandmark& landmark = map.landmarks[i];
    landmark.id = ids[i];
    landmark.anchor_level = static_cast<uint8_t>(anchor_levels[i]);
    landmark.drive_count = static_cast<uint8_t>(drive_counts[i]);
    const std::vector<uint32_t>& seen_by = landmark.keyframe_idxs;
    if (views_after_anchor[i] >= seen_by.size()) {
      return Malformed("a landmark's anchor is not in its list");
    }
    landmark.anchor_idx = seen_by[seen_by.size() - 1 - views_after_anchor[i]];
    if (!IsInRange(positions[i], header.position_exponent, kMaxAnchorDistanceM)) {
      return Malformed("a landmark lies too far from its anchor");
    }
    landmark.position_in_map = map.keyframes[landmark.anchor_idx].map_from_camera *
                               FromGrid(positions[i], header.position_exponent);
    if (landmark.position_in_map.cwiseAbs().maxCoeff() > kMaxCoordinateM) {
      return Malformed("a landmark lies too far away");
    }
  }
  return absl::OkStatus();
}

absl::Status DecodeDescriptors(std::string_view bytes, std::vector<LeanLandmark>& landmarks) {
  ByteReader reader(bytes);
  for (size_t word = 0; word < kDescriptorBytes / 8; ++word) {
    std::array<std::string, 8> columns;
    for (std::string& column : columns) {
      CARMAP_ASSIGN_OR_RETURN(column, ReadByteColumn(reader, landmarks.size()));
    }
    for (size_t i = 0; i < landmarks.size(); ++i) {
      uint64_t value = 0;
      for (size_t byte = 0; byte < 8; ++byte) {
        value |= uint64_t{static_cast<uint8_t>(columns[byte][i])} << (8 * byte);
      }
      landmarks[i].descriptor.words[word] = value;
    }
  }
  if (reader.remaining() != 0) return Malformed("bytes follow its columns");
  return absl::OkStatus();
}

/// The contents of the five sections, by LeanSection, and at 0 that of the added one.
using Contents = std::vector<std::string_view>;

absl::StatusOr<Contents> KnownContents(const std::vector<SectionView>& sections, AddedSection added,
                                       const std::string& name) {
  std::vector<std::optional<std::string_view>> found(kDescriptors + 1);
  if (added == AddedSection::kNone) found[0].emplace();
  for (const SectionView& section : sections) {
    if (section.id >= kCounts && section.id <= kDescriptors) {
      found[section.id] = section.content;
    } else if (added != AddedSection::kNone && section.id == static_cast<uint16_t>(added)) {
      found[0] = section.content;
    } else if (IsAddedSection(section.id)) {
      return absl::InvalidArgumentError(fmt::format("{}: is {}, not {}", name,
                                                    NameOfAdded(section.id),
                                                    NameOfAdded(static_cast<uint16_t>(added))));
    } else if (section.is_mandatory) {
      return absl::UnimplementedError(
          fmt::format("{}: needs section {}, which this version does not know; upgrade carmap",
                      name, section.id));
    }
  }
  Contents contents;
  for (size_t id = 0; id < found.size(); ++id) {
    if (!found[0]) {
      return absl::InvalidArgumentError(
          fmt::format("{}: is not {}", name, NameOfAdded(static_cast<uint16_t>(added))));
    }
    if (!found[id]) {
      return absl::DataLossError(
          fmt::format("{}: has no section '{}'; copy or download the file "
                      "again, or make it anew with `carmap map`",
                      name, kSectionNames[id]));
    }
    contents.push_back(*found[id]);
  }
  return contents;
}

absl::Status InSection(const absl::Status& status, LeanSection id, const std::string& name) {
  return absl::DataLossError(
      fmt::format("{}: section '{}' is malformed ({}); make the file anew with `carmap map`", name,
                  kSectionNames[id], std::string(status.message())));
}

absl::Status CheckAffordable(const Counts& counts, uint64_t file_size, const std::string& name) {
  if (IsWithinLimits(counts) && DecodedSize(counts) <= DecodedSizeLimit(file_size)) {
    return absl::OkStatus();
  }
  return absl::ResourceExhaustedError(fmt::format(
      "{}: claims {} drives, {} keyframes, {} landmarks and {} observations, more than {} bytes "
      "can "
      "hold; make the file anew with `carmap map`",
      name, counts.drives, counts.keyframes, counts.landmarks, counts.observations, file_size));
}

}  // namespace

absl::Status LeanEncodeOptions::Validate() const {
  if (zstd_level >= 1 && zstd_level <= 19) return absl::OkStatus();
  return absl::InvalidArgumentError(
      fmt::format("zstd_level is {}; choose one from 1 to 19", zstd_level));
}

absl::StatusOr<std::string> EncodeLeanMap(const LeanMap& map, const LeanEncodeOptions& options) {
  return EncodeWithSection(map, std::nullopt, options);
}

absl::StatusOr<std::string> EncodeWithSection(const LeanMap& map,
                                              const std::optional<Section>& added,
                                              const LeanEncodeOptions& options) {
  CARMAP_RETURN_IF_ERROR(options.Validate());
  CARMAP_RETURN_IF_ERROR(CheckConsistency(map));
  CARMAP_RETURN_IF_ERROR(CheckRange(map));
  const Counts counts = CountsOf(map);
  if (IsWithinLimits(counts)) {
    std::string bytes = EncodeAtLevel(map, counts, added, options.zstd_level);
    if (DecodedSize(counts) <= DecodedSizeLimit(bytes.size())) return bytes;
    // Unusually uniform: a reader would take the small file for an attack on its memory.
    bytes = EncodeAtLevel(map, counts, added, 0);
    if (DecodedSize(counts) <= DecodedSizeLimit(bytes.size())) return bytes;
  }
  return absl::InvalidArgumentError(fmt::format(
      "the map is larger than a file may hold ({} drives, {} keyframes, {} landmarks, {} "
      "observations); split it",
      counts.drives, counts.keyframes, counts.landmarks, counts.observations));
}

uint64_t HashOf(const LeanMap& map) {
  std::string columns;
  for (const Section& section : SectionsOf(map, CountsOf(map), 0)) columns += section.content;
  return XXH3_64bits(columns.data(), columns.size());
}

absl::StatusOr<LeanMap> DecodeLeanMap(std::string_view bytes, const std::string& name) {
  CARMAP_ASSIGN_OR_RETURN(DecodedSections decoded,
                          DecodeWithSection(bytes, AddedSection::kNone, name));
  return std::move(decoded.map);
}

absl::StatusOr<DecodedSections> DecodeWithSection(std::string_view bytes, AddedSection added,
                                                  const std::string& name) {
  CARMAP_ASSIGN_OR_RETURN(const std::vector<SectionView> sections, ReadContainer(bytes, name));
  CARMAP_ASSIGN_OR_RETURN(const Contents contents, KnownContents(sections, added, name));

  const auto header = DecodeCounts(contents[kCounts]);
  if (!header.ok()) return InSection(header.status(), kCounts, name);
  CARMAP_RETURN_IF_ERROR(CheckAffordable(header->counts, bytes.size(), name));

  LeanMap map;
  auto drives = DecodeDrives(contents[kDrives], header->counts.drives);
  if (!drives.ok()) return InSection(drives.status(), kDrives, name);
  map.drives = *std::move(drives);

  if (const absl::Status status = DecodeKeyframes(contents[kKeyframes], header->counts, map);
      !status.ok()) {
    return InSection(status, kKeyframes, name);
  }
  if (const absl::Status status = DecodeLandmarks(contents[kLandmarks], *header, map);
      !status.ok()) {
    return InSection(status, kLandmarks, name);
  }
  if (const absl::Status status = DecodeDescriptors(contents[kDescriptors], map.landmarks);
      !status.ok()) {
    return InSection(status, kDescriptors, name);
  }
  if (const absl::Status status = CheckConsistency(map); !status.ok()) {
    return absl::DataLossError(fmt::format("{}: {}; make the file anew with `carmap map`", name,
                                           std::string(status.message())));
  }
  return DecodedSections{std::move(map), contents[0]};
}

LeanMap Quantize(const LeanMap& map) {
  LeanMap quantized = map;
  std::vector<Eigen::Vector3d> positions_in_anchor;
  for (const LeanLandmark& landmark : map.landmarks) {
    positions_in_anchor.push_back(
        FromGrid(ToGrid(PositionInAnchor(map, landmark), kPositionExponent), kPositionExponent));
  }
  for (LeanKeyframe& keyframe : quantized.keyframes) {
    Rigid3& pose = keyframe.map_from_camera;
    pose.rotation = RotationFromGrid(RotationToGrid(pose.rotation));
    pose.translation =
        FromGrid(ToGrid(pose.translation, kTranslationExponent), kTranslationExponent);
    if (keyframe.gps) keyframe.gps = GpsFromGrid(GpsToGrid(*keyframe.gps));
  }
  for (size_t i = 0; i < quantized.landmarks.size(); ++i) {
    LeanLandmark& landmark = quantized.landmarks[i];
    landmark.position_in_map =
        quantized.keyframes[landmark.anchor_idx].map_from_camera * positions_in_anchor[i];
  }
  return quantized;
}

absl::StatusOr<LeanMap> ReadLeanMap(const std::filesystem::path& path) {
  CARMAP_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(path, kMaxLeanFileBytes));
  return DecodeLeanMap(bytes, path.string());
}

absl::Status WriteLeanMap(const std::filesystem::path& path, const LeanMap& map,
                          const LeanEncodeOptions& options) {
  CARMAP_ASSIGN_OR_RETURN(const std::string bytes, EncodeLeanMap(map, options));
  return WriteFileAtomically(path, bytes);
}

}  // namespace carmap
