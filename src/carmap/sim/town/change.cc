#include "carmap/sim/town/change.h"

#include <absl/strings/str_format.h>
#include <absl/strings/str_join.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <utility>

#include "carmap/base/random.h"
#include "carmap/sim/models/models.h"
#include "carmap/sim/road/ground_map.h"
#include "carmap/sim/town/occupancy.h"

namespace carmap {
namespace {

constexpr double kStretchM = 60, kClosureEveryM = 500, kClosureM = 30;
/// What the route's vehicle keeps: half its lane.
constexpr double kRouteHalfM = 1.55;

std::string_view KindOf(const WorldObject& object) {
  return std::string_view(object.name).substr(0, object.name.rfind('-'));
}

bool IsKnownKind(const std::string& kind) {
  return PropVariants(kind) > 0 || VehicleVariants(kind) > 0;
}

std::string KnownKinds() {
  const std::vector<std::string_view> props = PropKinds();
  return absl::StrJoin(std::vector<std::string>(props.begin(), props.end()), ", ");
}

Model MakeAny(const std::string& kind, uint32_t variant) {
  return PropVariants(kind) > 0 ? MakeProp(kind, variant) : MakeVehicle(kind, variant);
}

/// Which variant stands for an added thing: follows from its name, as its other looks do.
uint32_t LookOf(const Change& change) {
  uint64_t key = 0x6c6f6f6b;
  for (const char c : change.name) key = HashKeys(key, static_cast<uint64_t>(c));
  return static_cast<uint32_t>(key);
}

/// One model of each kind and variant, for its size.
class Sizes {
 public:
  const Eigen::Vector3f& Of(const Change& change) {
    const uint32_t variants =
        std::max(1u, PropVariants(change.kind) + VehicleVariants(change.kind));
    const std::pair<std::string, uint32_t> key{change.kind, LookOf(change) % variants};
    auto size = sizes_.find(key);
    if (size == sizes_.end()) {
      const Model model = MakeAny(change.kind, key.second);
      size =
          sizes_.emplace(key, Eigen::Vector3f(model.length_m, model.width_m, model.height_m)).first;
    }
    return size->second;
  }

 private:
  std::map<std::pair<std::string, uint32_t>, Eigen::Vector3f> sizes_;
};

GroundBox BoxOf(const Change& change) {
  return {change.position_in_enu.head<2>(), change.heading_rad, change.size_m.x() / 2,
          change.size_m.y() / 2};
}

/// True when a part of the line from a to b lies in the box (Liang, Barsky 1984).
bool Crosses(const GroundBox& box, const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  const Eigen::Vector2d forward = box.Forward(), left(-forward.y(), forward.x());
  double from = 0, to = 1;
  for (const auto& [axis, half_m] :
       {std::pair{forward, box.half_length_m}, std::pair{left, box.half_width_m}}) {
    const double at = axis.dot(a - box.centre_in_enu), step = axis.dot(b - a);
    if (std::abs(step) < 1e-9) {
      if (std::abs(at) > half_m) return false;
      continue;
    }
    const double enter = (-std::copysign(half_m, step) - at) / step;
    const double leave = (std::copysign(half_m, step) - at) / step;
    from = std::max(from, enter);
    to = std::min(to, leave);
  }
  return from < to;
}

/// True when no part of the mesh above the ground reaches into the box.
bool MeshLeavesFree(const Mesh& mesh, const Placement& placement, double ground_m,
                    const GroundBox& box) {
  const double c = std::cos(placement.heading_rad), s = std::sin(placement.heading_rad);
  const auto in_enu = [&](const Eigen::Vector3f& vertex) -> Eigen::Vector3d {
    const Eigen::Vector3d v = placement.scale * vertex.cast<double>();
    return placement.position_in_enu +
           Eigen::Vector3d(c * v.x() - s * v.y(), s * v.x() + c * v.y(), v.z());
  };
  for (const auto& triangle : mesh.triangles) {
    const Eigen::Vector3d corners[] = {in_enu(mesh.vertices[triangle[0]]),
                                       in_enu(mesh.vertices[triangle[1]]),
                                       in_enu(mesh.vertices[triangle[2]])};
    const double top_m = std::max({corners[0].z(), corners[1].z(), corners[2].z()}) - ground_m;
    const double bottom_m = std::min({corners[0].z(), corners[1].z(), corners[2].z()}) - ground_m;
    if (top_m < 0.35 || bottom_m > 4) continue;
    for (size_t i = 0; i < 3; ++i) {
      if (Crosses(box, corners[i].head<2>(), corners[(i + 1) % 3].head<2>())) return false;
    }
  }
  return true;
}

bool IsFree(const World& world, const GroundBox& box) {
  const double ground_m = world.ground->HeightAt(box.centre_in_enu);
  const double reach_m = std::hypot(box.half_length_m, box.half_width_m);
  constexpr double kTileM = 140;  // a tile's diagonal
  for (const Placement& tile : world.tiles) {
    const Eigen::Vector2d middle = tile.position_in_enu.head<2>().array() + 48;
    if ((middle - box.centre_in_enu).norm() > kTileM / 2 + reach_m) continue;
    if (!MeshLeavesFree(world.models[tile.model_idx], tile, ground_m, box)) return false;
  }
  for (const WorldObject& object : world.objects) {
    const Placement& placement = object.placement;
    const double apart_m = (placement.position_in_enu.head<2>() - box.centre_in_enu).norm();
    if (apart_m > reach_m + 6) continue;
    if (!MeshLeavesFree(world.models[placement.model_idx], placement, ground_m, box)) return false;
  }
  return true;
}

/// Changes on a route, as they are drawn.
class Drawing {
 public:
  Drawing(const World& world, const Route& route, uint64_t seed)
      : world_(world), route_(route), draw_(seed, 0x6368616e) {
    FindRemovable();
  }

  std::vector<Change> Draw() {
    const int stretches = std::max(1, static_cast<int>(std::lround(route_.length_m() / kStretchM)));
    const int closures = static_cast<int>(std::lround(route_.length_m() / kClosureEveryM));
    for (int i = 0; i < stretches; ++i) {
      const double begin_m = route_.length_m() * i / stretches;
      const double end_m = route_.length_m() * (i + 1) / stretches;
      if (!draw_.Chance(0.4) || !AddSomething(begin_m, end_m)) RemoveSomething(begin_m, end_m);
    }
    for (int i = 0; i < closures; ++i) {
      const double room_m = route_.length_m() / closures - kClosureM;
      CloseLane(route_.length_m() * i / closures + draw_.Between(0.2, 0.8) * std::max(0.0, room_m));
    }
    return std::move(changes_);
  }

 private:
  struct Removable {
    double along_m;
    size_t object_idx;
    bool is_tree;
  };

  /// Things of a size to be missed, on both sides of the route.
  void FindRemovable() {
    constexpr double kNearM = 22;
    for (size_t i = 0; i < world_.objects.size(); ++i) {
      const std::string_view kind = KindOf(world_.objects[i]);
      const bool is_tree = kind == "tree" || kind == "conifer" || kind == "young-tree";
      if (!is_tree && kind != "billboard" && kind != "kiosk" && kind != "advertising-column") {
        continue;
      }
      const Eigen::Vector2d p = world_.objects[i].placement.position_in_enu.head<2>();
      double nearest = kNearM, along_m = -1;
      for (double s = 0; s < route_.length_m(); s += 4) {
        const double distance = (route_.At(s).position_in_enu - p).norm();
        if (distance >= nearest) continue;
        nearest = distance;
        along_m = s;
      }
      if (along_m >= 0) removable_.push_back({along_m, i, is_tree});
    }
  }

  void RemoveSomething(double begin_m, double end_m) {
    std::vector<size_t> trees, others;
    for (const auto& [along_m, object_idx, is_tree] : removable_) {
      if (along_m < begin_m || along_m >= end_m) continue;
      (is_tree ? trees : others).push_back(object_idx);
    }
    const bool tree = others.empty() || (!trees.empty() && draw_.Chance(0.4));
    const std::vector<size_t>& from = tree ? trees : others;
    if (from.empty()) return;
    const WorldObject& object =
        world_.objects[from[draw_.Below(static_cast<uint32_t>(from.size()))]];
    const Placement& placement = object.placement;
    const Mesh& mesh = world_.models[placement.model_idx];
    Eigen::Vector3f low = mesh.vertices.front(), high = low;
    for (const Eigen::Vector3f& vertex : mesh.vertices) {
      low = low.cwiseMin(vertex);
      high = high.cwiseMax(vertex);
    }
    Change change{.what = Change::What::kRemoved, .name = object.name};
    change.kind = KindOf(object);
    change.position_in_enu = placement.position_in_enu;
    change.heading_rad = placement.heading_rad;
    change.size_m = placement.scale * (high - low);
    changes_.push_back(std::move(change));
  }

  /// To the edge of the carriageway on one side of the route; nothing if it is far.
  std::optional<double> EdgeAt(double along_m, int side) const {
    for (double out_m = 0; out_m < 40; out_m += 0.1) {
      const Eigen::Vector2d p = route_.At(along_m, side * out_m).position_in_enu;
      if (world_.ground->CarriagewayDistance(p) >= 0) return out_m;
    }
    return std::nullopt;
  }

  Change Added(std::string_view kind, double along_m, double left_m, double turn_rad) {
    Change change{.what = Change::What::kAdded};
    change.kind = kind;
    change.name = absl::StrFormat("new-%s-%05d", kind, added_++);
    const RoutePoint at = route_.At(along_m, left_m);
    change.position_in_enu << at.position_in_enu, world_.ground->HeightAt(at.position_in_enu);
    change.heading_rad = static_cast<float>(at.heading_rad + turn_rad);
    change.size_m = sizes_.Of(change);
    return change;
  }

  /// Scaffolding or a container beside the carriageway, where there is room.
  bool AddSomething(double begin_m, double end_m) {
    for (int attempt = 0; attempt < 12; ++attempt) {
      const double along_m = draw_.Between(begin_m, end_m);
      const int side = draw_.Chance(0.5) ? 1 : -1;
      const std::optional<double> edge_m = EdgeAt(along_m, side);
      if (!edge_m) continue;
      Change change =
          Added(draw_.Chance(0.5) ? "scaffolding" : "container", along_m, 0, side > 0 ? M_PI : 0);
      const double out_m = *edge_m + 0.3 + change.size_m.y() / 2 + draw_.Between(0, 4);
      change.position_in_enu.head<2>() = route_.At(along_m, side * out_m).position_in_enu;
      change.position_in_enu.z() = world_.ground->HeightAt(change.position_in_enu.head<2>());
      const GroundBox box = BoxOf(change);
      bool off_road = true;
      for (const double forward : {-1.0, 0.0, 1.0}) {
        for (const double left : {-1.0, 1.0}) {
          off_road &= world_.ground->CarriagewayDistance(box.At(forward, left)) > 0.05;
        }
      }
      if (!off_road || !IsFree(world_, box) || OverlapsEarlier(box)) {
        --added_;
        continue;
      }
      changes_.push_back(std::move(change));
      return true;
    }
    return false;
  }

  bool OverlapsEarlier(const GroundBox& box) const {
    return std::any_of(changes_.begin(), changes_.end(), [&](const Change& change) {
      return change.what == Change::What::kAdded && Overlap(BoxOf(change), box);
    });
  }

  /// Cones and barriers along 30 m to the right of the route's lane; behind them, where a lane or
  /// a parking strip is wide enough, a lorry.
  void CloseLane(double begin_m) {
    double free_m = 1e9;
    for (double s = begin_m; s <= begin_m + kClosureM; s += 2) {
      free_m = std::min(free_m, EdgeAt(s, -1).value_or(1e9));
    }
    constexpr double kConeM = 0.25, kMaxWidthM = 3.6;
    const double inner_m = kRouteHalfM + kConeM;
    // Where the lane ends at the kerb, cones stand on it, beside those that drive.
    const double outer_m =
        std::max(inner_m + 0.1, std::min(free_m - kConeM, kRouteHalfM + kMaxWidthM));
    for (double s = 0; s <= kClosureM; s += 3) {
      const double taper = std::min(1.0, s / 6);  // from the edge towards the lane
      const double out_m = outer_m + taper * (inner_m - outer_m);
      changes_.push_back(Added("cone", begin_m + s, -out_m, 0));
    }
    const double middle_m = (inner_m + outer_m) / 2, width_m = outer_m - inner_m;
    if (width_m < 1.2) return;
    changes_.push_back(Added("road-barrier", begin_m + 8, -middle_m, 0));
    if (width_m > 2.0) {
      const std::string_view kind = VehicleVariants("lorry") > 0 ? "lorry" : "container";
      Change lorry = Added(kind, begin_m + 19, 0, 0);
      const double out_m = inner_m + kConeM + lorry.size_m.y() / 2;
      lorry.position_in_enu.head<2>() = route_.At(begin_m + 19, -out_m).position_in_enu;
      changes_.push_back(std::move(lorry));
    }
  }

  const World& world_;
  const Route& route_;
  HashSequence draw_;
  Sizes sizes_;
  std::vector<Removable> removable_;
  std::vector<Change> changes_;
  int added_ = 0;
};

absl::Status CheckAgainst(const std::vector<Change>& changes, const World& world) {
  std::set<std::string> names;
  for (const WorldObject& object : world.objects) names.insert(object.name);
  for (const Change& change : changes) {
    if (change.what == Change::What::kAdded) {
      if (IsKnownKind(change.kind)) continue;
      return absl::InvalidArgumentError(absl::StrFormat(
          "nothing of kind \"%s\" can be added; kinds are %s", change.kind, KnownKinds()));
    }
    if (names.erase(change.name) > 0) continue;
    std::vector<std::string> some;
    for (size_t i = 0; i < world.objects.size();
         i += std::max<size_t>(1, world.objects.size() / 5)) {
      some.push_back(world.objects[i].name);
    }
    return absl::NotFoundError(absl::StrFormat("the world has no \"%s\" to remove; it has %s, ...",
                                               change.name, absl::StrJoin(some, ", ")));
  }
  return absl::OkStatus();
}

}  // namespace

std::vector<Change> DrawChanges(const World& world, const Route& route, uint64_t seed) {
  return Drawing(world, route, seed).Draw();
}

absl::Status ApplyChanges(const std::vector<Change>& changes, World& world) {
  if (absl::Status status = CheckAgainst(changes, world); !status.ok()) return status;
  std::set<std::string> removed;
  for (const Change& change : changes) {
    if (change.what == Change::What::kRemoved) removed.insert(change.name);
  }
  std::erase_if(world.objects,
                [&](const WorldObject& object) { return removed.count(object.name) > 0; });
  std::map<std::pair<std::string, uint32_t>, uint32_t> model_idxs;
  for (const Change& change : changes) {
    if (change.what != Change::What::kAdded) continue;
    const uint32_t look = LookOf(change);
    const uint32_t variants = PropVariants(change.kind) + VehicleVariants(change.kind);
    const auto [model, is_new] = model_idxs.try_emplace({change.kind, look % variants},
                                                        static_cast<uint32_t>(world.models.size()));
    if (is_new) world.models.push_back(MakeAny(change.kind, look % variants).mesh);
    Placement placement;
    placement.model_idx = model->second;
    placement.position_in_enu = change.position_in_enu;
    placement.heading_rad = change.heading_rad;
    placement.texture_seed = look;
    world.objects.push_back({change.name, placement});
    const GroundBox box = BoxOf(change).Grown(0.3, 0.2);
    std::erase_if(world.parking, [&](const ParkingPlace& place) {
      return Overlap(
          box, {place.position_in_enu.head<2>(), place.heading_rad, place.length_m / 2, 0.95});
    });
  }
  return absl::OkStatus();
}

nlohmann::ordered_json ToJson(const std::vector<Change>& changes) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const Change& change : changes) {
    const bool added = change.what == Change::What::kAdded;
    const Eigen::Vector3d& p = change.position_in_enu;
    const Eigen::Vector3f& size = change.size_m;
    list.push_back({{"what", added ? "added" : "removed"},
                    {"name", change.name},
                    {"kind", change.kind},
                    {"position_in_enu", {p.x(), p.y(), p.z()}},
                    {"heading_rad", change.heading_rad},
                    {"size_m", {size.x(), size.y(), size.z()}}});
  }
  return {{"changes", std::move(list)}};
}

namespace {

using Json = nlohmann::json;

absl::Status Wrong(size_t entry, std::string_view what) {
  return absl::InvalidArgumentError(absl::StrFormat("changes[%d]: %s", entry, what));
}

std::optional<std::string> StringIn(const Json& entry, const char* key) {
  constexpr size_t kMaxLength = 100;
  const auto found = entry.find(key);
  if (found == entry.end() || !found->is_string()) return std::nullopt;
  const auto& text = found->get_ref<const std::string&>();
  return text.empty() || text.size() > kMaxLength ? std::nullopt : std::optional(text);
}

std::optional<double> NumberIn(const Json& value, double most) {
  if (!value.is_number()) return std::nullopt;
  const double number = value.get<double>();
  return std::isfinite(number) && std::abs(number) <= most ? std::optional(number) : std::nullopt;
}

std::optional<Eigen::Vector3d> VectorIn(const Json& entry, const char* key, double most) {
  const auto found = entry.find(key);
  if (found == entry.end() || !found->is_array() || found->size() != 3) return std::nullopt;
  Eigen::Vector3d vector;
  for (int i = 0; i < 3; ++i) {
    const std::optional<double> number = NumberIn((*found)[static_cast<size_t>(i)], most);
    if (!number) return std::nullopt;
    vector[i] = *number;
  }
  return vector;
}

absl::StatusOr<Change> ChangeFromJson(const Json& entry, size_t idx) {
  constexpr double kFarM = 1e6, kLargeM = 1e3, kTurns = 1e3;
  if (!entry.is_object()) return Wrong(idx, "is not an object");
  const std::optional<std::string> what = StringIn(entry, "what");
  if (what != "added" && what != "removed") {
    return Wrong(idx, "\"what\" must be \"added\" or \"removed\"");
  }
  Change change;
  change.what = what == "added" ? Change::What::kAdded : Change::What::kRemoved;
  change.name = StringIn(entry, "name").value_or("");
  change.kind = StringIn(entry, "kind").value_or("");
  const auto position = VectorIn(entry, "position_in_enu", kFarM);
  const auto size = VectorIn(entry, "size_m", kLargeM);
  const auto heading =
      entry.contains("heading_rad") ? NumberIn(entry["heading_rad"], kTurns) : std::optional(0.0);
  if (!heading) return Wrong(idx, "\"heading_rad\" must be a number");
  if (entry.contains("position_in_enu") && !position) {
    return Wrong(idx, "\"position_in_enu\" must be three numbers, metres within 1000 km");
  }
  if (entry.contains("size_m") && (!size || size->minCoeff() < 0)) {
    return Wrong(idx, "\"size_m\" must be three lengths in metres");
  }
  if (change.what == Change::What::kRemoved && change.name.empty()) {
    return Wrong(idx, "\"name\" must tell what is removed");
  }
  if (change.what == Change::What::kAdded) {
    if (!IsKnownKind(change.kind)) {
      return Wrong(idx, absl::StrFormat("\"kind\" must be one of %s", KnownKinds()));
    }
    if (!position) return Wrong(idx, "\"position_in_enu\" must be three numbers");
    if (change.name.empty()) change.name = absl::StrFormat("new-%s-%05d", change.kind, idx);
  }
  if (position) change.position_in_enu = *position;
  change.heading_rad = static_cast<float>(*heading);
  if (size) change.size_m = size->cast<float>();
  return change;
}

}  // namespace

absl::StatusOr<std::vector<Change>> ChangesFromJson(const std::string& text) {
  constexpr size_t kMaxChanges = 20000;
  const Json json = Json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (json.is_discarded()) return absl::InvalidArgumentError("the changes are not JSON");
  const auto list = json.find("changes");
  if (!json.is_object() || list == json.end() || !list->is_array()) {
    return absl::InvalidArgumentError("changes need the form {\"changes\": [...]}");
  }
  if (list->size() > kMaxChanges) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%d changes; at most %d are read", list->size(), kMaxChanges));
  }
  std::vector<Change> changes;
  Sizes sizes;
  for (size_t i = 0; i < list->size(); ++i) {
    absl::StatusOr<Change> change = ChangeFromJson((*list)[i], i);
    if (!change.ok()) return change.status();
    const bool added = change->what == Change::What::kAdded;
    if (added && change->size_m.isZero()) change->size_m = sizes.Of(*change);
    changes.push_back(*std::move(change));
  }
  return changes;
}

}  // namespace carmap
