#include "carmap/sim/town/site.h"

#include <absl/strings/str_format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "carmap/sim/models/models.h"

namespace carmap {
namespace {

/// Half of what a kind takes on the ground, where that is less than its bounding box.
double TrunkHalf(std::string_view kind) {
  constexpr std::pair<std::string_view, double> kTrunks[] = {
      {"tree", 0.35}, {"young-tree", 0.3},   {"conifer", 0.4},       {"lamp", 0.15},
      {"pole", 0.2},  {"traffic-sign", 0.1}, {"traffic-light", 0.2}, {"street-name", 0.1},
  };
  const auto* found = std::find_if(std::begin(kTrunks), std::end(kTrunks),
                                   [&](const auto& entry) { return entry.first == kind; });
  return found == std::end(kTrunks) ? 0 : found->second;
}

std::pair<int, int> TileKey(const Eigen::Vector2d& p) {
  return {static_cast<int>(std::floor(p.x() / Site::kTileM)),
          static_cast<int>(std::floor(p.y() / Site::kTileM))};
}

Eigen::Vector3d TileOrigin(const std::pair<int, int>& key) {
  return {key.first * Site::kTileM, key.second * Site::kTileM, 0};
}

/// A motorway lies in cuttings and on embankments.
GroundBanks BanksOf(Scene scene) {
  if (scene != Scene::kFreeway) return {};
  return {.height_m = 5, .from_m = 24, .to_m = 48};
}

}  // namespace

Site::Site(Scene scene, const Route& route, const std::vector<Eigen::Vector3d>& heights,
           uint64_t seed)
    : scene_(scene),
      seed_(seed),
      roads_(scene, route, seed),
      ground_(std::make_shared<RoadGround>(
          scene, roads_, HeightField(roads_.Points(), heights, seed, BanksOf(scene)), seed)) {
  constexpr double kPieceM = 3, kHalfWidthM = 1.15;
  for (double s = 0; s < route.length_m(); s += kPieceM) {
    const RoutePoint at = route.At(s + kPieceM / 2);
    route_swath_.Add({at.position_in_enu, at.heading_rad, kPieceM / 2 + 0.2, kHalfWidthM});
  }
}

Eigen::Vector3d Site::At(const Eigen::Vector2d& p) const {
  return {p.x(), p.y(), ground_->HeightAt(p)};
}

double Site::PitchAt(const Eigen::Vector2d& p, double heading_rad) const {
  const Eigen::Vector2d forward(std::cos(heading_rad), std::sin(heading_rad));
  return std::atan(ground_->HeightAt(p + 0.5 * forward) - ground_->HeightAt(p - 0.5 * forward));
}

bool Site::IsFree(const GroundBox& box, double edge_m) const {
  const auto steps_of = [](double half_m) {
    return std::max(1, static_cast<int>(std::ceil(2 * half_m / 1.5)));
  };
  const int rows = steps_of(box.half_width_m), columns = steps_of(box.half_length_m);
  for (int row = 0; row <= rows; ++row) {
    for (int column = 0; column <= columns; ++column) {
      const Eigen::Vector2d p = box.At(2.0 * column / columns - 1, 2.0 * row / rows - 1);
      if (ground_->CarriagewayDistance(p) < edge_m) return false;
    }
  }
  return occupancy_.IsFree(box);
}

const Site::SharedModel& Site::ModelOf(std::string_view kind, uint32_t variant) {
  const std::pair<std::string_view, uint32_t> key{kind, variant % PropVariants(kind)};
  const auto known = model_by_kind_.find(key);
  if (known != model_by_kind_.end()) return known->second;
  Model model = MakeProp(kind, key.second);
  const SharedModel shared{static_cast<uint32_t>(models_.size()), model.length_m, model.width_m,
                           model.height_m};
  models_.push_back(std::move(model.mesh));
  return model_by_kind_.emplace(std::pair{model.kind, key.second}, shared).first->second;
}

bool Site::Place(std::string_view kind, uint32_t variant, const Eigen::Vector2d& p,
                 const Setting& setting, HashSequence& draw) {
  const SharedModel& model = ModelOf(kind, variant);
  const double trunk = TrunkHalf(kind);
  // Long parts touch their neighbours.
  const double half_length = trunk > 0 ? trunk : 0.47 * model.length_m;
  const double half_width = trunk > 0 ? trunk : 0.47 * model.width_m;
  const GroundBox box{p, setting.heading_rad, setting.scale * half_length,
                      setting.scale * half_width};
  if (!IsFree(box.Grown(setting.margin_m), setting.edge_m)) return false;
  occupancy_.Add(box);
  PlaceAnyway(kind, variant, p, setting, draw);
  return true;
}

void Site::PlaceAnyway(std::string_view kind, uint32_t variant, const Eigen::Vector2d& p,
                       const Setting& setting, HashSequence& draw) {
  Placement placement;
  placement.model_idx = ModelOf(kind, variant).idx;
  placement.position_in_enu = At(p) + setting.lift_m * Eigen::Vector3d::UnitZ();
  placement.heading_rad = static_cast<float>(setting.heading_rad);
  const bool leans_with_ground = TrunkHalf(kind) == 0;
  if (leans_with_ground) {
    placement.pitch_rad = static_cast<float>(PitchAt(p, setting.heading_rad));
  }
  placement.scale = static_cast<float>(setting.scale);
  placement.shade = static_cast<float>(draw.Between(0.85, 1.15));
  placement.texture_seed = static_cast<uint32_t>(draw.Next());
  const uint32_t number = counts_[kind]++;
  objects_.push_back({absl::StrFormat("%s-%05d", kind, number), placement});
}

MeshBuilder& Site::TileAt(const Eigen::Vector2d& p) { return tiles_[TileKey(p)]; }

Eigen::Affine3f Site::FrameInTile(const Eigen::Vector2d& tile_of,
                                  const Eigen::Vector3d& origin_in_enu, double heading_rad) const {
  const Eigen::Vector3d origin = origin_in_enu - TileOrigin(TileKey(tile_of));
  return FrameAt(origin.cast<float>(), static_cast<float>(heading_rad));
}

World Site::Finish() && {
  World world;
  for (auto& [key, builder] : tiles_) {
    Placement placement;
    placement.model_idx = static_cast<uint32_t>(world.models.size());
    placement.position_in_enu = TileOrigin(key);
    placement.texture_seed = 0;  // what goes on from tile to tile looks as if it did
    world.models.push_back(std::move(builder).Build());
    world.tiles.push_back(placement);
  }
  const auto tile_count = static_cast<uint32_t>(world.models.size());
  for (Mesh& mesh : models_) world.models.push_back(std::move(mesh));
  for (WorldObject& object : objects_) object.placement.model_idx += tile_count;
  world.objects = std::move(objects_);
  world.parking = std::move(parking_);
  ground_->SetDecals(std::move(decals_));
  world.ground = std::move(ground_);
  // Karlsruhe, where the drives that it imitates were recorded.
  world.origin = {49.01, 8.43, 115};
  return world;
}

}  // namespace carmap
