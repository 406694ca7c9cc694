#include "carmap/ingest/pass_memory.h"

#include <absl/container/flat_hash_map.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "carmap/base/status_macros.h"
#include "carmap/format/tile_codec.h"
#include "carmap/map/by_id.h"

namespace carmap {
namespace {

/// Of places where a pass saw or missed something: log odds of being recognised there. Counted in
/// cubes, of which those around a place tell of it.
class PassOdds {
 public:
  explicit PassOdds(const PassLight& light) : light_(light) {}

  void Add(const Eigen::Vector3d& place, bool is_seen) {
    for (Counts* counts : {&all_, &cubes_[CubeOf(place)]}) {
      counts->told += 1;
      counts->seen += is_seen;
    }
  }
  double At(const Eigen::Vector3d& place) const {
    constexpr double kLeast = 0.5;
    const double of_pass = (all_.seen + kLeast) / (all_.told + 2 * kLeast);
    Counts near;
    const Cube middle = CubeOf(place);
    for (int i = 0; i < 27; ++i) {
      const auto cube =
          cubes_.find({middle[0] + i % 3 - 1, middle[1] + i / 3 % 3 - 1, middle[2] + i / 9 - 1});
      if (cube == cubes_.end()) continue;
      near.told += cube->second.told;
      near.seen += cube->second.seen;
    }
    const double share = (near.seen + light_.prior * of_pass) / (near.told + light_.prior);
    return std::log(share / (1 - share));
  }

 private:
  using Cube = std::array<int, 3>;
  struct Counts {
    double told = 0, seen = 0;
  };
  Cube CubeOf(const Eigen::Vector3d& place) const {
    const auto index = [&](double x) {
      return static_cast<int>(std::clamp(std::floor(x / light_.radius_m), -1e8, 1e8));
    };
    return {index(place.x()), index(place.y()), index(place.z())};
  }

  const PassLight light_;
  Counts all_;
  absl::flat_hash_map<Cube, Counts> cubes_;
};

}  // namespace

absl::StatusOr<std::optional<std::vector<LandmarkId>>> LandmarksOfVersion(TileId id,
                                                                          uint64_t version,
                                                                          const BaseMap& base) {
  CARMAP_ASSIGN_OR_RETURN(const auto stored, base.Read(id));
  std::optional<std::vector<LandmarkId>> ids;
  if (!stored || version == 0 || version > stored->version) return ids;
  Tile tile = *stored;
  if (tile.version > version) {
    const auto patches = base.reader().ReadPatches(id, version);
    if (absl::IsOutOfRange(patches.status())) return ids;
    CARMAP_RETURN_IF_ERROR(patches.status());
    for (auto patch = patches->rbegin(); patch != patches->rend(); ++patch) {
      CARMAP_ASSIGN_OR_RETURN(Patch inverse, DecodePatch(patch->inverse, base.name()));
      CARMAP_ASSIGN_OR_RETURN(tile, Applied(inverse, tile));
      tile.version = patch->to_version - 1;
    }
  }
  ids.emplace();
  for (const LeanLandmark& landmark : tile.map.landmarks) ids->push_back(landmark.id);
  return ids;
}

absl::Status PassMemory::Load(const std::vector<TileId>& tiles) {
  for (const TileId& id : tiles) {
    Remembered& remembered = tiles_[id];
    CARMAP_ASSIGN_OR_RETURN(remembered.tile, changes_.Read(id));
    CARMAP_ASSIGN_OR_RETURN(remembered.stored, ReadEvidence(base_.reader(), id));
  }
  return absl::OkStatus();
}

void PassMemory::AddPass(DriveId drive, int64_t time_s,
                         const std::map<LandmarkId, Sighting>& outcomes, const PassLight& light) {
  for (auto& [id, remembered] : tiles_) {
    TileEvidence& evidence = remembered.stored.evidence;
    evidence.AddPass(drive, time_s);
    if (!remembered.tile) continue;
    // Of the tile alone, in its own frame: what is near its border has half of its neighbours.
    PassOdds odds(light);
    std::vector<std::pair<const LeanLandmark*, Sighting>> told;
    for (const LeanLandmark& landmark : remembered.tile->map.landmarks) {
      const auto outcome = outcomes.find(landmark.id);
      if (outcome == outcomes.end()) continue;
      told.emplace_back(&landmark, outcome->second);
      if (outcome->second == Sighting::kSeenThrough) continue;
      odds.Add(landmark.position_in_map, outcome->second == Sighting::kSeen);
    }
    for (const auto& [landmark, outcome] : told) {
      evidence.Record(landmark->id, drive, outcome, odds.At(landmark->position_in_map));
    }
  }
}

void PassMemory::AddNews(const std::set<LandmarkId>& news) {
  for (auto& [id, remembered] : tiles_) {
    if (!remembered.tile) continue;
    TileEvidence& evidence = remembered.stored.evidence;
    for (const LeanLandmark& landmark : remembered.tile->map.landmarks) {
      if (!news.contains(landmark.id)) continue;
      const auto returned = evidence.TakeReturned(landmark.position_in_map, landmark.descriptor);
      if (returned) {
        remembered.returned[landmark.id] = returned->drive_count;
      } else {
        evidence.AwaitConfirmation(landmark.id);
      }
    }
  }
}

absl::StatusOr<PassConsequences> PassMemory::Draw(Changes& changes) {
  PassConsequences consequences;
  for (auto& [id, remembered] : tiles_) {
    if (!remembered.tile) continue;
    TileEvidence& evidence = remembered.stored.evidence;
    Tile next = *remembered.tile;
    Patch patch{
        .tile = id, .from_version = next.version, .to_version = next.version + 1, .put = {}};
    std::vector<WatchedLandmark> watched;
    for (const LeanLandmark& landmark : next.map.landmarks) {
      watched.push_back({landmark.position_in_map, evidence.PassesOf(landmark.id)});
    }
    for (const VanishedLandmark& gone : evidence.vanished()) {
      watched.push_back({gone.position_in_tile.cast<double>(), {}, gone.time_s});
    }
    for (const auto& [idx, log_odds] : FindVanished(watched, evidence.NewestPassS(), options_)) {
      const LeanLandmark& gone = next.map.landmarks[idx];
      patch.removed_landmarks.push_back(gone.id);
      evidence.AddVanished({gone.id, gone.position_in_map.cast<float>(), gone.descriptor,
                            gone.drive_count, static_cast<float>(log_odds),
                            evidence.NewestPassS()});
    }
    consequences.vanished += patch.removed_landmarks.size();
    for (const LandmarkId& landmark : evidence.TakeRefuted()) {
      if (FindById(next.map.landmarks, landmark) == nullptr) continue;
      patch.removed_landmarks.push_back(landmark);
      ++consequences.refuted;
    }
    std::sort(patch.removed_landmarks.begin(), patch.removed_landmarks.end());
    constexpr uint8_t kConfirmed = 2;
    std::map<LandmarkId, uint8_t> seen_by = std::exchange(remembered.returned, {});
    consequences.returned += seen_by.size();
    for (const LandmarkId& landmark : evidence.TakeConfirmed()) {
      consequences.confirmed += seen_by.try_emplace(landmark, kConfirmed).second;
    }
    for (const auto& [landmark, drives] : seen_by) {
      LeanLandmark* there = FindById(next.map.landmarks, landmark);
      if (there != nullptr) there->drive_count = std::max({there->drive_count, drives, kConfirmed});
    }
    if (seen_by.empty() && patch.removed_landmarks.empty()) continue;
    CARMAP_ASSIGN_OR_RETURN(next, Applied(patch, next));
    CARMAP_RETURN_IF_ERROR(changes.Put(std::move(next)));
  }
  return consequences;
}

void PassMemory::AddTo(Commit& commit) const {
  for (const auto& [id, remembered] : tiles_) {
    if (remembered.tile) {
      ReplaceEvidence(id, remembered.stored.revision, remembered.stored.evidence, commit);
    } else {
      RemoveEvidence(id, remembered.stored.revision, commit);
    }
  }
}

}  // namespace carmap
