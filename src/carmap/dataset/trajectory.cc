#include "carmap/dataset/trajectory.h"

#include <fmt/format.h>

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <string>
#include <utility>

#include "carmap/base/file.h"
#include "carmap/base/status_macros.h"
#include "carmap/dataset/text_table.h"

namespace carmap {
namespace {

namespace fs = std::filesystem;

constexpr uint64_t kMaxFileBytes = uint64_t{1} << 28;
constexpr size_t kKittiColumns = 12, kTumColumns = 8;
constexpr double kRotationTolerance = 1e-3;
constexpr double kMaxDistanceM = 1e9;

absl::Status LineError(const fs::path& path, size_t line, const std::string& what) {
  return absl::InvalidArgumentError(fmt::format("{}: line {}: {}", path.string(), line, what));
}

bool IsPosition(const Eigen::Vector3d& p) {
  return p.allFinite() && p.cwiseAbs().maxCoeff() <= kMaxDistanceM;
}

/// The rotation next to a matrix that is one within its printed digits.
std::optional<Eigen::Quaterniond> NearestRotation(const Eigen::Matrix3d& matrix) {
  if (!matrix.allFinite()) return std::nullopt;
  const Eigen::Matrix3d excess = matrix * matrix.transpose() - Eigen::Matrix3d::Identity();
  if (!(excess.cwiseAbs().maxCoeff() <= kRotationTolerance) || matrix.determinant() < 0) {
    return std::nullopt;
  }
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(matrix, Eigen::ComputeFullU | Eigen::ComputeFullV);
  return Eigen::Quaterniond(Eigen::Matrix3d(svd.matrixU() * svd.matrixV().transpose()))
      .normalized();
}

absl::StatusOr<TimedPose> ParseKittiLine(const fs::path& path, size_t line,
                                         const std::vector<double>& numbers) {
  if (std::all_of(numbers.begin(), numbers.end(), [](double x) { return std::isnan(x); })) {
    return TimedPose{};
  }
  const Eigen::Matrix<double, 3, 4> pose =
      Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>>(numbers.data());
  const std::optional<Eigen::Quaterniond> rotation = NearestRotation(pose.leftCols<3>());
  if (!rotation) {
    return LineError(path, line,
                     "columns 1-3, 5-7 and 9-11 are not a rotation matrix; write 12 times nan "
                     "for a lost frame");
  }
  if (!IsPosition(pose.col(3))) {
    return LineError(path, line, "columns 4, 8 and 12 are not a position in metres; correct it");
  }
  return TimedPose{std::nullopt, Rigid3{*rotation, pose.col(3)}};
}

absl::StatusOr<TimedPose> ParseTumLine(const fs::path& path, size_t line,
                                       std::string_view time_token,
                                       const std::vector<double>& numbers) {
  const std::optional<Timestamp> timestamp = ParseSeconds(time_token);
  if (!timestamp) {
    return LineError(path, line,
                     fmt::format("'{}' is not a time in seconds, within 3e9 s of 0; correct it, or "
                                 "count the times from another moment",
                                 time_token));
  }
  const Eigen::Vector3d position(numbers[1], numbers[2], numbers[3]);
  if (!IsPosition(position)) {
    return LineError(path, line, "columns 2-4 are not a position in metres; correct it");
  }
  const Eigen::Quaterniond rotation(numbers[7], numbers[4], numbers[5], numbers[6]);
  if (!(std::abs(rotation.norm() - 1) <= kRotationTolerance)) {
    return LineError(path, line, "columns 5-8 are not a unit quaternion (qx qy qz qw); correct it");
  }
  return TimedPose{timestamp, Rigid3{rotation.normalized(), position}};
}

absl::StatusOr<TimedPose> ParseLine(const fs::path& path, const TextLine& line) {
  const std::optional<std::vector<double>> numbers = ParseNumbers(line.tokens);
  if (!numbers) {
    return LineError(path, line.number, "holds something that is not a number; correct it");
  }
  return numbers->size() == kKittiColumns
             ? ParseKittiLine(path, line.number, *numbers)
             : ParseTumLine(path, line.number, line.tokens.front(), *numbers);
}

absl::Status CheckColumns(const fs::path& path, const TextLine& line, size_t columns_before) {
  const size_t columns = line.tokens.size();
  if (columns != kKittiColumns && columns != kTumColumns) {
    return LineError(path, line.number,
                     fmt::format("has {} columns; KITTI form has 12, TUM form 8", columns));
  }
  if (columns != columns_before) {
    return LineError(path, line.number,
                     fmt::format("has {} columns but the lines before have {}; a file has one form",
                                 columns, columns_before));
  }
  return absl::OkStatus();
}

void AppendKittiLine(const std::optional<Rigid3>& pose, std::string& text) {
  Eigen::Matrix<double, 3, 4> matrix;
  if (pose) {
    matrix << pose->rotation.toRotationMatrix(), pose->translation;
  } else {
    matrix.setConstant(std::nan(""));
  }
  const Eigen::Matrix<double, 4, 3> by_row = matrix.transpose();
  fmt::format_to(std::back_inserter(text), "{:.12g}\n",
                 fmt::join(by_row.data(), by_row.data() + by_row.size(), " "));
}

void AppendTumLine(Timestamp timestamp, const Rigid3& pose, std::string& text) {
  constexpr int64_t kNsPerSecond = 1'000'000'000;
  const Eigen::Vector3d& p = pose.translation;
  const Eigen::Quaterniond& q = pose.rotation;
  fmt::format_to(std::back_inserter(text),
                 "{}{}.{:09} {:.12g} {:.12g} {:.12g} {:.12g} {:.12g} {:.12g} {:.12g}\n",
                 timestamp.ns < 0 ? "-" : "", std::abs(timestamp.ns / kNsPerSecond),
                 std::abs(timestamp.ns % kNsPerSecond), p.x(), p.y(), p.z(), q.x(), q.y(), q.z(),
                 q.w());
}

absl::StatusOr<std::string> ToTum(const fs::path& path, const Trajectory& trajectory) {
  std::string text = "# time_s x y z qx qy qz qw\n";
  for (size_t i = 0; i < trajectory.size(); ++i) {
    const TimedPose& pose = trajectory[i];
    if (!pose.world_from_camera) continue;
    if (!pose.timestamp) {
      return absl::InvalidArgumentError(
          fmt::format("{}: TUM form needs time stamps and frame {} has none; choose a name that "
                      "does not end in .tum for KITTI form",
                      path.string(), i));
    }
    AppendTumLine(*pose.timestamp, *pose.world_from_camera, text);
  }
  return text;
}

std::string ToKitti(const Trajectory& trajectory) {
  std::string text;
  for (const TimedPose& pose : trajectory) AppendKittiLine(pose.world_from_camera, text);
  return text;
}

}  // namespace

absl::StatusOr<Trajectory> ReadTrajectory(const fs::path& path) {
  CARMAP_ASSIGN_OR_RETURN(const std::string text, ReadFile(path, kMaxFileBytes));
  TextLines lines(text);
  Trajectory trajectory;
  trajectory.reserve(TextLines::MaxCount(text, kTumColumns));
  size_t columns = 0;
  while (const TextLine* line = lines.Next()) {
    if (trajectory.empty()) columns = line->tokens.size();
    CARMAP_RETURN_IF_ERROR(CheckColumns(path, *line, columns));
    CARMAP_ASSIGN_OR_RETURN(const TimedPose pose, ParseLine(path, *line));
    if (pose.timestamp && !trajectory.empty() && trajectory.back().timestamp >= pose.timestamp) {
      return LineError(path, line->number,
                       "its time is not after the line before; sort the lines by time");
    }
    trajectory.push_back(pose);
  }
  if (std::none_of(trajectory.begin(), trajectory.end(),
                   [](const TimedPose& pose) { return pose.world_from_camera.has_value(); })) {
    return absl::InvalidArgumentError(
        fmt::format("{}: holds no pose; give a trajectory in KITTI or TUM form", path.string()));
  }
  return trajectory;
}

absl::Status WriteTrajectory(const fs::path& path, const Trajectory& trajectory) {
  if (path.extension() != ".tum") return WriteFileAtomically(path, ToKitti(trajectory));
  CARMAP_ASSIGN_OR_RETURN(const std::string text, ToTum(path, trajectory));
  return WriteFileAtomically(path, text);
}

double PathLengthM(const Trajectory& trajectory) {
  double length_m = 0;
  std::optional<Eigen::Vector3d> previous;
  for (const TimedPose& pose : trajectory) {
    if (!pose.world_from_camera) continue;
    const Eigen::Vector3d& position = pose.world_from_camera->translation;
    if (previous) length_m += (position - *previous).norm();
    previous = position;
  }
  return length_m;
}

}  // namespace carmap
