#include "carmap/eval/street_change_score.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "carmap/base/file.h"
#include "carmap/base/status_macros.h"
#include "carmap/map/by_id.h"

namespace carmap {
namespace {

/// Landmarks are placed to some decimetres.
constexpr double kNearM = 0.5;

Eigen::Vector3d VectorOf(const nlohmann::json& json) {
  return {json.at(0).get<double>(), json.at(1).get<double>(), json.at(2).get<double>()};
}

std::vector<bool> AreOn(const ChangedThing& thing, const PlacedMap& placed) {
  std::vector<bool> are_on;
  for (const LeanLandmark& landmark : placed.map.landmarks) {
    are_on.push_back(IsOn(thing, placed.world_from_map * landmark.position_in_map, kNearM));
  }
  return are_on;
}

size_t CountOn(const ChangedThing& thing, const PlacedMap& placed) {
  const std::vector<bool> are_on = AreOn(thing, placed);
  return static_cast<size_t>(std::count(are_on.begin(), are_on.end(), true));
}

}  // namespace

size_t StreetChangeScore::removed_before() const {
  size_t sum = 0;
  for (const ThingScore& thing : things) sum += thing.is_added ? 0 : thing.before;
  return sum;
}
size_t StreetChangeScore::removed_left() const {
  size_t sum = 0;
  for (const ThingScore& thing : things) sum += thing.is_added ? 0 : thing.after;
  return sum;
}

absl::StatusOr<std::vector<ChangedThing>> ReadChangedThings(const std::filesystem::path& drive) {
  constexpr uint64_t kMaxBytes = uint64_t{1} << 24;
  const std::filesystem::path path = drive / "world.json";
  CARMAP_ASSIGN_OR_RETURN(const std::string text, ReadFile(path, kMaxBytes));
  std::vector<ChangedThing> things;
  try {
    const auto world = nlohmann::json::parse(text);
    for (const auto& change : world.at("options").at("changes")) {
      things.push_back({change.at("name").get<std::string>(),
                        change.at("what").get<std::string>() == "added",
                        VectorOf(change.at("position_in_enu")),
                        change.at("heading_rad").get<double>(), VectorOf(change.at("size_m"))});
    }
  } catch (const nlohmann::json::exception&) {
    return absl::InvalidArgumentError(fmt::format(
        "{}: does not tell what was changed; simulate the drive with --change or --change-seed",
        path.string()));
  }
  return things;
}

bool IsOn(const ChangedThing& thing, const Eigen::Vector3d& p_in_world, double near_m) {
  const Eigen::Vector3d d = p_in_world - thing.foot_in_world;
  const double c = std::cos(thing.heading_rad), s = std::sin(thing.heading_rad);
  return std::abs(c * d.x() + s * d.y()) <= thing.size_m.x() / 2 + near_m &&
         std::abs(c * d.y() - s * d.x()) <= thing.size_m.y() / 2 + near_m && d.z() >= -near_m &&
         d.z() <= thing.size_m.z() + near_m;
}

StreetChangeScore ScoreStreetChanges(const std::vector<ChangedThing>& things,
                                     const PlacedMap& before, const PlacedMap& after,
                                     const std::vector<PlacedMap>& fresh) {
  StreetChangeScore score;
  std::vector<bool> is_removed(before.map.landmarks.size(), false);
  for (const ChangedThing& thing : things) {
    ThingScore& of_thing = score.things.emplace_back();
    of_thing.name = thing.name;
    of_thing.is_added = thing.is_added;
    for (const PlacedMap& map : fresh) of_thing.fresh += CountOn(thing, map);
    if (thing.is_added) {
      for (const LeanLandmark& landmark : after.map.landmarks) {
        of_thing.after += FindById(before.map.landmarks, landmark.id) == nullptr &&
                          IsOn(thing, after.world_from_map * landmark.position_in_map, kNearM);
      }
      of_thing.before = CountOn(thing, before);
      continue;
    }
    const std::vector<bool> are_on = AreOn(thing, before);
    for (size_t i = 0; i < are_on.size(); ++i) {
      if (!are_on[i]) continue;
      is_removed[i] = true;
      ++of_thing.before;
      of_thing.after += FindById(after.map.landmarks, before.map.landmarks[i].id) != nullptr;
    }
  }
  for (size_t i = 0; i < is_removed.size(); ++i) {
    if (is_removed[i]) continue;
    ++score.standing;
    score.standing_lost += FindById(after.map.landmarks, before.map.landmarks[i].id) == nullptr;
  }
  return score;
}

}  // namespace carmap
