#include "carmap/dataset/kitti_drive.h"

#include <fmt/format.h>
#include <xxhash.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <iterator>
#include <map>
#include <string>
#include <system_error>
#include <utility>

#include "carmap/base/file.h"
#include "carmap/base/status_macros.h"
#include "carmap/dataset/image_file.h"
#include "carmap/dataset/text_table.h"

namespace carmap {
namespace {

namespace fs = std::filesystem;

constexpr uint64_t kMaxTextBytes = uint64_t{1} << 27;

absl::Status Invalid(const fs::path& path, const std::string& cause_and_remedy) {
  return absl::InvalidArgumentError(fmt::format("{}: {}", path.string(), cause_and_remedy));
}

// --- Image folders ---

/// What the parts of a drive are called: KITTI has a grey pair of cameras and a colour pair.
struct Layout {
  std::string left_folder, right_folder, left_projection, right_projection;
};
const Layout kGreyPair{"image_0", "image_1", "P0", "P1"},
    kColourPair{"image_2", "image_3", "P2", "P3"};

const Layout& LayoutOf(const fs::path& folder) {
  std::error_code error;
  const bool has_grey = fs::exists(folder / kGreyPair.left_folder, error) ||
                        fs::exists(folder / kGreyPair.right_folder, error);
  return !has_grey && fs::exists(folder / kColourPair.left_folder, error) ? kColourPair : kGreyPair;
}

/// By number, with leading zeros or without.
bool IsBefore(const fs::path& a, const fs::path& b) {
  return std::pair(a.native().size(), a.native()) < std::pair(b.native().size(), b.native());
}

/// Names of the images in a folder, in order.
absl::StatusOr<std::vector<fs::path>> ListImages(const fs::path& folder) {
  std::error_code error;
  std::vector<fs::path> names;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    const fs::path name = it->path().filename();
    if (HasImageExtension(name) && name.native().front() != '.') names.push_back(name);
  }
  if (error) {
    return absl::NotFoundError(
        fmt::format("{}: cannot be listed ({}); a drive has the folders "
                    "image_0 (left) and image_1 (right), or image_2 and image_3",
                    folder.string(), error.message()));
  }
  std::sort(names.begin(), names.end(), IsBefore);
  return names;
}

/// Names of the frames: of what images there are on either side, nearly all of them on both.
absl::StatusOr<std::vector<fs::path>> ListFrames(const fs::path& folder, const Layout& layout) {
  const fs::path left_folder = folder / layout.left_folder,
                 right_folder = folder / layout.right_folder;
  CARMAP_ASSIGN_OR_RETURN(const std::vector<fs::path> left, ListImages(left_folder));
  CARMAP_ASSIGN_OR_RETURN(const std::vector<fs::path> right, ListImages(right_folder));
  for (const auto& [side, names] : {std::pair(left_folder, left), std::pair(right_folder, right)}) {
    if (names.empty()) {
      return Invalid(side, "the drive is empty; put its images (.png .jpg .pgm) here");
    }
  }
  std::vector<fs::path> names;
  std::set_union(left.begin(), left.end(), right.begin(), right.end(), std::back_inserter(names),
                 IsBefore);
  const size_t pairs = left.size() + right.size() - names.size();
  if (2 * pairs < names.size()) {
    return Invalid(
        folder,
        fmt::format("of {} images in {} and {} in {} only {} have the same name; "
                    "each left image needs a right one of its name",
                    left.size(), layout.left_folder, right.size(), layout.right_folder, pairs));
  }
  return names;
}

std::vector<fs::path> InFolder(const fs::path& folder, std::vector<fs::path> names) {
  for (fs::path& name : names) name = folder / name;
  return names;
}

absl::Status CheckImageSize(const fs::path& path, const cv::Mat& image, int width, int height) {
  if (image.cols == width && image.rows == height) return absl::OkStatus();
  return Invalid(path,
                 fmt::format("the image is {}x{} px but the drive's first is {}x{}; all images "
                             "of a drive have one size",
                             image.cols, image.rows, width, height));
}

/// As ToEightBits needs them, by a sample: all images of a drive are to be scaled alike.
int UsedBitsOf(const std::vector<fs::path>& paths) {
  constexpr size_t kSample = 8;
  int used_bits = 8;
  for (size_t i = 0; i < kSample; ++i) {
    const auto levels = ReadGreyLevels(paths[i * paths.size() / kSample]);
    if (!levels.ok()) continue;
    if (levels->depth() == CV_8U) break;
    used_bits = std::max(used_bits, UsedBits(*levels));
  }
  return used_bits;
}

// --- times.txt ---

/// Frames that cannot be used, whatever their images are.
using FrameFaults = std::map<uint32_t, absl::Status>;

/// A frame with the time of the one before is at fault; it is put a nanosecond later, so that times
/// ascend. Of more times than frames only the number is looked at.
absl::StatusOr<std::vector<Timestamp>> ReadTimes(const fs::path& path, size_t frame_count,
                                                 FrameFaults& faults) {
  CARMAP_ASSIGN_OR_RETURN(const std::string text, ReadFile(path, kMaxTextBytes));
  std::vector<Timestamp> times;
  std::optional<Timestamp> before;
  size_t lines_read = 0;
  TextLines lines(text);
  while (const TextLine* line = lines.Next()) {
    if (lines_read++ >= frame_count) continue;
    const std::optional<Timestamp> time = ParseSeconds(line->tokens.front());
    if (!time || line->tokens.size() != 1) {
      return Invalid(path, fmt::format("line {} is not one time in seconds, within 3e9 s of 0; "
                                       "correct it, or count the times from the drive's start",
                                       line->number));
    }
    if (before && *time < *before) {
      return Invalid(path, fmt::format("line {}: the time {:.6f} s is not after the one before, "
                                       "{:.6f} s; times must ascend",
                                       line->number, time->seconds(), before->seconds()));
    }
    if (!times.empty() && *time <= times.back()) {
      faults[static_cast<uint32_t>(times.size())] =
          Invalid(path, fmt::format("line {}: the time {:.6f} s is that of the frame before; give "
                                    "each frame its own",
                                    line->number, time->seconds()));
      times.push_back({times.back().ns + 1});
    } else {
      times.push_back(*time);
    }
    before = time;
  }
  if (lines_read != frame_count) {
    return Invalid(path, fmt::format("has {} times but the drive has {} frames; write one time a "
                                     "frame",
                                     lines_read, frame_count));
  }
  return times;
}

// --- calib.txt ---

using Projection = std::array<double, 12>;  // 3×4, row-major

absl::StatusOr<Projection> FindProjection(const fs::path& path, std::string_view text,
                                          const std::string& key) {
  std::optional<TextLine> found;
  TextLines lines(text);
  while (const TextLine* line = lines.Next()) {
    if (line->tokens.front() != key + ":") continue;
    if (found) {
      return Invalid(path, fmt::format("the line '{}:' occurs twice; remove one", key));
    }
    found = *line;
  }
  if (!found) {
    return Invalid(path, fmt::format("the line '{}:' is missing; add it with 12 numbers", key));
  }
  const std::optional<std::vector<double>> numbers =
      ParseNumbers({found->tokens.begin() + 1, found->tokens.end()});
  Projection projection;
  if (!numbers || numbers->size() != projection.size()) {
    return Invalid(path, fmt::format("line '{}:' does not hold 12 numbers; correct it", key));
  }
  if (!std::all_of(numbers->begin(), numbers->end(), [](double x) { return std::isfinite(x); })) {
    return Invalid(path, fmt::format("line '{}:' holds nan or inf; calibrate again", key));
  }
  std::copy(numbers->begin(), numbers->end(), projection.begin());
  return projection;
}

/// Rectified cameras have no skew, and their last row is 0 0 1.
bool IsRectified(const Projection& p) {
  constexpr double kTolerance = 1e-6;
  const auto is_about = [](double a, double b) { return std::abs(a - b) <= kTolerance; };
  return is_about(p[1], 0) && is_about(p[4], 0) && is_about(p[8], 0) && is_about(p[9], 0) &&
         is_about(p[10], 1);
}

bool HaveEqualIntrinsics(const Projection& a, const Projection& b) {
  constexpr double kTolerancePx = 0.01;
  constexpr std::array<size_t, 4> kIntrinsics = {0, 5, 2, 6};
  return std::all_of(kIntrinsics.begin(), kIntrinsics.end(),
                     [&](size_t i) { return std::abs(a[i] - b[i]) <= kTolerancePx; });
}

/// The rig but for the image size.
absl::StatusOr<StereoRig> ReadCalibration(const fs::path& path, const Layout& layout) {
  CARMAP_ASSIGN_OR_RETURN(const std::string text, ReadFile(path, kMaxTextBytes));
  const std::string &p_left = layout.left_projection, &p_right = layout.right_projection;
  CARMAP_ASSIGN_OR_RETURN(const Projection left, FindProjection(path, text, p_left));
  CARMAP_ASSIGN_OR_RETURN(const Projection right, FindProjection(path, text, p_right));
  if (!IsRectified(left) || !IsRectified(right)) {
    return Invalid(path, fmt::format("{} and {} are not projections of rectified cameras (fx 0 cx "
                                     "tx, 0 fy cy ty, 0 0 1 tz); rectify the images and calibrate "
                                     "again",
                                     p_left, p_right));
  }
  if (!HaveEqualIntrinsics(left, right)) {
    return Invalid(path, fmt::format("{} and {} differ in focal length or principal point; rectify "
                                     "both images to the same camera",
                                     p_left, p_right));
  }
  constexpr double kMaxFocalPx = 1e5, kMaxBaselineM = 100;
  const double fx = left[0], fy = left[5];
  if (!(fx > 0 && fy > 0 && fx <= kMaxFocalPx && fy <= kMaxFocalPx)) {
    return Invalid(path, fmt::format("the focal lengths {} and {} px of {} are not between 0 and "
                                     "{}; calibrate again",
                                     fx, fy, p_left, kMaxFocalPx));
  }
  const double baseline_m = (left[3] - right[3]) / fx;
  if (!(baseline_m > 0 && baseline_m <= kMaxBaselineM)) {
    return Invalid(path, fmt::format("the baseline ({0}[3] - {1}[3]) / fx is {2} m, not between 0 "
                                     "and {3}; {0} is of the left camera, {1} of the right",
                                     p_left, p_right, baseline_m, kMaxBaselineM));
  }
  return StereoRig{{.fx = fx, .fy = fy, .cx = left[2], .cy = left[6]}, baseline_m};
}

absl::Status CheckPrincipalPoint(const fs::path& path, const PinholeCamera& camera) {
  if (camera.Contains({camera.cx, camera.cy})) return absl::OkStatus();
  return Invalid(path, fmt::format("the principal point ({}, {}) is outside of the {}x{} px image; "
                                   "use the calibration of this image size",
                                   camera.cx, camera.cy, camera.width, camera.height));
}

// --- gps.txt ---

/// Nothing if there is no file.
absl::StatusOr<std::optional<GpsLog>> ReadGps(const fs::path& path,
                                              const std::vector<Timestamp>& times) {
  std::error_code error;
  if (!fs::exists(path, error)) return std::nullopt;
  return GpsLog::Read(path, times);
}

// --- poses.txt ---

/// One pose a frame of the drive, with its time; empty if there is no file.
absl::StatusOr<Trajectory> ReadTruth(const fs::path& path, const std::vector<Timestamp>& times) {
  std::error_code error;
  if (!fs::exists(path, error)) return Trajectory{};
  CARMAP_ASSIGN_OR_RETURN(Trajectory truth, ReadTrajectory(path));
  if (truth.front().timestamp) {
    return Invalid(path, "is in TUM form; ground truth of a drive is in KITTI form (12 numbers)");
  }
  if (truth.size() != times.size()) {
    return Invalid(path, fmt::format("has {} poses but the drive has {} frames; write one a frame, "
                                     "or remove the file",
                                     truth.size(), times.size()));
  }
  for (size_t i = 0; i < truth.size(); ++i) truth[i].timestamp = times[i];
  return truth;
}

// --- Range and identity ---

absl::StatusOr<FrameRange> ResolveRange(const fs::path& folder, const FrameRange& range,
                                        size_t frame_count) {
  const uint32_t last_of_drive = static_cast<uint32_t>(frame_count) - 1;
  const uint32_t last = range.last.value_or(last_of_drive);
  if (range.first > last || last > last_of_drive) {
    return Invalid(folder,
                   fmt::format("frames {} to {} were asked for, the drive has frames 0 to {}; "
                               "choose a range within it",
                               range.first, last, last_of_drive));
  }
  return FrameRange{range.first, last};
}

template <typename Number>
void AppendBytes(Number value, std::string& bytes) {
  static_assert(std::endian::native == std::endian::little, "ids must agree between machines");
  bytes.append(reinterpret_cast<const char*>(&value), sizeof(value));
}

void AppendPixels(const cv::Mat& image, std::string& bytes) {
  for (int y = 0; y < image.rows; ++y) {
    bytes.append(image.ptr<char>(y), static_cast<size_t>(image.cols));
  }
}

uint64_t HashInput(const StereoRig& rig, uint32_t first, Timestamp time, const cv::Mat& left,
                   const cv::Mat& right) {
  std::string bytes;
  const PinholeCamera& camera = rig.camera;
  for (const double value : {camera.fx, camera.fy, camera.cx, camera.cy, rig.baseline_m}) {
    AppendBytes(value, bytes);
  }
  for (const int32_t side : {camera.width, camera.height}) AppendBytes(side, bytes);
  AppendBytes(first, bytes);
  AppendBytes(time.ns, bytes);
  AppendPixels(left, bytes);
  AppendPixels(right, bytes);
  return XXH3_64bits(bytes.data(), bytes.size());
}

}  // namespace

absl::StatusOr<std::unique_ptr<KittiDrive>> KittiDrive::Open(const fs::path& folder,
                                                             const FrameRange& range) {
  std::error_code error;
  if (!fs::is_directory(folder, error)) {
    return absl::NotFoundError(fmt::format(
        "{}: no such folder; name a drive's folder (image_0 image_1 calib.txt times.txt)",
        folder.string()));
  }
  const Layout& layout = LayoutOf(folder);
  CARMAP_ASSIGN_OR_RETURN(const std::vector<fs::path> names, ListFrames(folder, layout));
  CARMAP_ASSIGN_OR_RETURN(const FrameRange resolved, ResolveRange(folder, range, names.size()));

  std::unique_ptr<KittiDrive> drive(new KittiDrive);
  drive->left_paths_ = InFolder(folder / layout.left_folder, names);
  drive->right_paths_ = InFolder(folder / layout.right_folder, names);
  drive->first_ = drive->next_ = resolved.first;
  drive->last_ = *resolved.last;
  drive->used_bits_ = UsedBitsOf(drive->left_paths_);

  CARMAP_ASSIGN_OR_RETURN(drive->times_,
                          ReadTimes(folder / "times.txt", names.size(), drive->faults_));
  CARMAP_ASSIGN_OR_RETURN(drive->rig_, ReadCalibration(folder / "calib.txt", layout));
  CARMAP_RETURN_IF_ERROR(drive->FindFirstPair(folder / "calib.txt"));
  CARMAP_ASSIGN_OR_RETURN(const Trajectory truth, ReadTruth(folder / "poses.txt", drive->times_));
  if (!truth.empty()) {
    drive->truth_.assign(truth.begin() + drive->first_, truth.begin() + drive->last_ + 1);
  }
  CARMAP_ASSIGN_OR_RETURN(drive->gps_, ReadGps(folder / "gps.txt", drive->times_));
  return drive;
}

absl::StatusOr<StereoFrame> KittiDrive::FirstReadable(uint32_t first) const {
  absl::Status why_not_first;
  for (uint32_t index = first; index <= last_; ++index) {
    StereoFrame frame;
    const absl::Status read = ReadPair(index, frame);
    if (read.ok()) return frame;
    if (index == first) why_not_first = read;
  }
  return why_not_first;
}

absl::Status KittiDrive::FindFirstPair(const fs::path& calibration_path) {
  CARMAP_ASSIGN_OR_RETURN(const StereoFrame frame, FirstReadable(first_));
  rig_.camera.width = frame.left.cols;
  rig_.camera.height = frame.left.rows;
  CARMAP_RETURN_IF_ERROR(CheckPrincipalPoint(calibration_path, rig_.camera));
  id_.input = HashInput(rig_, first_, times_[first_], frame.left, frame.right);
  id_.options = XXH3_64bits(&last_, sizeof(last_));
  return absl::OkStatus();
}

bool KittiDrive::HasInput(DriveId id, uint32_t first_mapped) const {
  if (id.input == id_.input) return true;
  if (first_mapped < first_ || first_mapped > last_) return false;
  const auto frame = FirstReadable(first_mapped);
  return frame.ok() &&
         id.input == HashInput(rig_, first_mapped, times_[first_mapped], frame->left, frame->right);
}

std::optional<Timestamp> KittiDrive::unix_start() const {
  constexpr double kEarliestS = 1e9;  // September 2001; no drive is that long
  if (times_[first_].seconds() < kEarliestS) return std::nullopt;
  return Timestamp{0};
}

absl::Status KittiDrive::ReadPair(uint32_t index, StereoFrame& frame) const {
  const fs::path &left_path = left_paths_[index], &right_path = right_paths_[index];
  CARMAP_ASSIGN_OR_RETURN(const cv::Mat left, ReadGreyLevels(left_path));
  CARMAP_ASSIGN_OR_RETURN(const cv::Mat right, ReadGreyLevels(right_path));
  const bool is_first = rig_.camera.width == 0;
  const int width = is_first ? left.cols : rig_.camera.width,
            height = is_first ? left.rows : rig_.camera.height;
  CARMAP_RETURN_IF_ERROR(CheckImageSize(left_path, left, width, height));
  CARMAP_RETURN_IF_ERROR(CheckImageSize(right_path, right, width, height));
  frame.left = ToEightBits(left, used_bits_);
  frame.right = ToEightBits(right, used_bits_);
  return absl::OkStatus();
}

std::optional<StereoFrame> KittiDrive::Next() {
  if (next_ > last_) return std::nullopt;
  return Read(next_++);
}

StereoFrame KittiDrive::Read(uint32_t index) const {
  StereoFrame frame{.index = index, .timestamp = times_[index]};
  if (gps_) frame.gps = gps_->At(times_[index]);
  const auto fault = faults_.find(index);
  frame.status = fault == faults_.end() ? ReadPair(index, frame) : fault->second;
  return frame;
}

}  // namespace carmap
