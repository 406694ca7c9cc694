#include "apps/carmap/health_report.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <numbers>

#include "apps/carmap/outputs.h"

namespace carmap {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

/// "frame 7: ", "frames 60 to 190: "; nothing for what is wrong with all of them.
std::string FramesOf(const Suspicion& suspicion) {
  if (suspicion.last_index == 0) return "";
  if (suspicion.first_index == suspicion.last_index) {
    return fmt::format("frame {}: ", suspicion.first_index);
  }
  return fmt::format("frames {} to {}: ", suspicion.first_index, suspicion.last_index);
}

nlohmann::ordered_json ToJson(const PairHealth& pairs) {
  return {{"pairs", pairs.pairs},
          {"telling_pairs", pairs.telling_pairs},
          {"row_offset_px", pairs.row_offset_px},
          {"row_slope_px", pairs.row_slope_px},
          {"before_baselines", pairs.before_baselines},
          {"distortion", pairs.distortion},
          {"brightness_ratio", pairs.brightness_ratio}};
}

nlohmann::ordered_json ToJson(const MotionHealth& motion) {
  return {{"max_speed_mps", motion.max_speed_mps},
          {"max_acceleration_mps2", motion.max_acceleration_mps2},
          {"acceleration_index", motion.acceleration_index},
          {"max_jump_m", motion.max_jump_m},
          {"jump_index", motion.jump_index}};
}

const char* WordOf(GpsClock clock) {
  switch (clock) {
    case GpsClock::kCamera:
      return "camera";
    case GpsClock::kStartTogether:
      return "start_together";
    case GpsClock::kTimeZone:
      return "time_zone";
    case GpsClock::kOfAnotherDay:
      break;
  }
  return "of_another_day";
}

nlohmann::ordered_json ToJson(const GpsUse& gps) {
  nlohmann::ordered_json json = {{"rows", gps.rows},
                                 {"without_fix", gps.without_fix},
                                 {"frozen", gps.frozen},
                                 {"outliers", gps.outliers},
                                 {"used", gps.used},
                                 {"clock", WordOf(gps.clock)},
                                 {"clock_offset_s", gps.clock_offset_s}};
  if (!gps.contradiction.empty()) json["contradiction"] = gps.contradiction;
  return json;
}

}  // namespace

nlohmann::ordered_json ToJson(const std::vector<Suspicion>& suspicions) {
  auto list = nlohmann::ordered_json::array();
  for (const Suspicion& suspicion : suspicions) {
    list.push_back({{"fault", NameOf(suspicion.fault)},
                    {"first_index", suspicion.first_index},
                    {"last_index", suspicion.last_index},
                    {"finding", suspicion.finding},
                    {"remedy", suspicion.remedy}});
  }
  return list;
}

nlohmann::ordered_json ToJson(const DriveHealth& health, const std::optional<GpsUse>& gps) {
  nlohmann::ordered_json json = {{"cameras", ToJson(health.pairs)},
                                 {"depth_share", health.depth_share},
                                 {"near_share", health.near_share},
                                 {"keyframes_per_m", health.keyframes_per_m},
                                 {"disparity_bias_at_bound", health.is_bias_at_bound},
                                 {"motion", ToJson(health.motion)},
                                 {"suspect", ToJson(health.suspicions)}};
  if (gps) json["gps"] = ToJson(*gps);
  return json;
}

nlohmann::ordered_json ToJson(const RowMisalignment& undone) {
  return {{"down_deg", undone.down / kDegree}, {"turn_deg", undone.turn / kDegree}};
}

void PrintUndone(const RowMisalignment& undone) {
  if (undone == RowMisalignment()) return;
  fmt::print(
      "misaligned    right images lie {:+.2f} deg lower and are turned by {:+.2f} deg; undone, "
      "but calibrate anew\n",
      undone.down / kDegree, undone.turn / kDegree);
}

void PrintHealth(const DriveHealth& health, const std::optional<GpsUse>& gps) {
  const std::string faults = NamesOf(health.faults());
  fmt::print(
      "health        {}: rows {:+.1f} px apart, {:.0f} % of features with depth, {:.0f} % of "
      "landmarks near, at most {:.1f} m/s^2\n",
      faults.empty() ? "sound" : "suspect, " + faults, health.pairs.row_offset_px,
      100 * health.depth_share, 100 * health.near_share, health.motion.max_acceleration_mps2);
  if (!gps) return;
  fmt::print("gps           {} of {} rows used, {} without a fix, {} frozen, {} astray\n",
             gps->used, gps->rows, gps->without_fix, gps->frozen, gps->outliers);
}

bool CheckGps(const std::optional<GpsUse>& gps, const std::string& drive) {
  if (!gps || gps->contradiction.empty()) return true;
  PrintProblem(fmt::format("{}: gps.txt: {}", drive, gps->contradiction));
  return false;
}

bool CheckSound(const std::vector<Suspicion>& suspicions, const std::string& drive) {
  for (const Suspicion& suspicion : suspicions) {
    PrintProblem(fmt::format("{}: suspect, {}: {}{}; {}", drive, NameOf(suspicion.fault),
                             FramesOf(suspicion), suspicion.finding, suspicion.remedy));
  }
  return suspicions.empty();
}

}  // namespace carmap
