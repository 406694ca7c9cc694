#include "carmap/ingest/evidence.h"

#include <absl/strings/numbers.h>
#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

#include "carmap/base/byte_io.h"
#include "carmap/base/status_macros.h"
#include "carmap/format/columns.h"
#include "carmap/format/id_bytes.h"

namespace carmap {
namespace {

/// What the keys of all evidence begin with, in the store's list of contributions.
constexpr std::string_view kEvidencePrefix = "evidence/";
constexpr double kOddsStep = 1.0 / 16;
constexpr int kZstdLevel = 3;
constexpr size_t kPassBytes = 3 * sizeof(uint64_t);

/// Of what one drive said in several parts, what tells most.
int RankOf(Sighting outcome) {
  switch (outcome) {
    case Sighting::kSeen:
      return 3;
    case Sighting::kSeenThrough:
      return 2;
    case Sighting::kMissed:
      return 1;
    case Sighting::kNone:
      break;
  }
  return 0;
}

std::string KeyPrefixOf(TileId tile) {
  return fmt::format("{}{:08x}/{:016x}/", kEvidencePrefix, tile.component, tile.cell);
}
std::string KeyOf(TileId tile, uint64_t revision) {
  return fmt::format("{}{:016x}", KeyPrefixOf(tile), revision);
}

constexpr size_t kVanishedBytes =
    kIdBytes + 4 * sizeof(float) + sizeof(Descriptor::words) + 1 + sizeof(uint64_t);

void AppendVanished(const VanishedLandmark& landmark, std::string& out) {
  AppendId(landmark.id, out);
  for (const float value : landmark.position_in_tile) AppendFloat(value, out);
  for (const uint64_t word : landmark.descriptor.words) AppendUint(word, out);
  AppendUint(landmark.drive_count, out);
  AppendFloat(landmark.log_odds, out);
  AppendUint(static_cast<uint64_t>(landmark.time_s), out);
}

VanishedLandmark ReadVanished(ByteReader& reader) {
  VanishedLandmark landmark;
  landmark.id = ReadId<LandmarkId>(reader);
  for (float& value : landmark.position_in_tile) {
    value = std::bit_cast<float>(reader.Uint<uint32_t>());
  }
  for (uint64_t& word : landmark.descriptor.words) word = reader.Uint<uint64_t>();
  landmark.drive_count = reader.Uint<uint8_t>();
  landmark.log_odds = std::bit_cast<float>(reader.Uint<uint32_t>());
  landmark.time_s = static_cast<int64_t>(reader.Uint<uint64_t>());
  return landmark;
}

}  // namespace

void TileEvidence::AddPass(DriveId drive, int64_t time_s) {
  times_.try_emplace(drive, time_s);
  while (times_.size() > kMaxPasses) DropOldest();
}

void TileEvidence::DropOldest() {
  const auto oldest =
      std::min_element(times_.begin(), times_.end(), [](const auto& a, const auto& b) {
        return std::pair(a.second, a.first) < std::pair(b.second, b.first);
      });
  RemovePass(oldest->first);
}

void TileEvidence::Record(LandmarkId landmark, DriveId drive, Sighting outcome, double log_odds) {
  if (!times_.contains(drive) || outcome == Sighting::kNone) return;
  Observation& observation = observations_[landmark][drive];
  if (RankOf(outcome) <= RankOf(observation.outcome)) return;
  observation = {outcome,
                 static_cast<int8_t>(std::clamp(std::lround(log_odds / kOddsStep), -127l, 127l))};
}

void TileEvidence::RemovePass(DriveId drive) {
  times_.erase(drive);
  for (auto entry = observations_.begin(); entry != observations_.end();) {
    entry->second.erase(drive);
    entry = entry->second.empty() ? observations_.erase(entry) : std::next(entry);
  }
}

void TileEvidence::RemoveLandmark(LandmarkId landmark) {
  observations_.erase(landmark);
  awaiting_.erase(landmark);
}

void TileEvidence::AddVanished(const VanishedLandmark& landmark) {
  RemoveLandmark(landmark.id);
  if (vanished_.size() == kMaxVanished) vanished_.erase(vanished_.begin());
  vanished_.push_back(landmark);
}

std::optional<VanishedLandmark> TileEvidence::TakeReturned(const Eigen::Vector3d& position_in_tile,
                                                           const Descriptor& descriptor) {
  constexpr double kSamePlaceM = 0.4;
  constexpr int kMaxBits = 45;
  const auto found =
      std::find_if(vanished_.begin(), vanished_.end(), [&](const VanishedLandmark& gone) {
        return (gone.position_in_tile.cast<double>() - position_in_tile).norm() <= kSamePlaceM &&
               HammingDistance(gone.descriptor, descriptor) <= kMaxBits;
      });
  if (found == vanished_.end()) return std::nullopt;
  const VanishedLandmark returned = *found;
  vanished_.erase(found);
  return returned;
}

std::optional<int64_t> TileEvidence::TimeOf(DriveId drive) const {
  const auto found = times_.find(drive);
  if (found == times_.end()) return std::nullopt;
  return found->second;
}

bool TileEvidence::IsConfirmed(LandmarkId landmark) const {
  const auto found = observations_.find(landmark);
  return found != observations_.end() &&
         std::any_of(found->second.begin(), found->second.end(), [&](const auto& entry) {
           return entry.first != landmark.drive && entry.second.outcome == Sighting::kSeen;
         });
}

double TileEvidence::LogOddsOfMisses(LandmarkId landmark) const {
  const auto found = observations_.find(landmark);
  if (found == observations_.end()) return 0;
  double sum = 0;
  for (const auto& [drive, observation] : found->second) {
    if (drive == landmark.drive) continue;
    const double recognised = ProbabilityOf(kOddsStep * observation.odds_steps);
    constexpr double kIfSeenThrough = 0.1;
    sum += observation.outcome == Sighting::kSeenThrough ? std::log(kIfSeenThrough)
                                                         : std::log(1 - recognised);
  }
  return sum;
}

std::vector<LandmarkId> TileEvidence::TakeConfirmed() {
  std::vector<LandmarkId> confirmed;
  for (const LandmarkId& landmark : awaiting_) {
    if (IsConfirmed(landmark)) confirmed.push_back(landmark);
  }
  for (const LandmarkId& landmark : confirmed) awaiting_.erase(landmark);
  return confirmed;
}

std::vector<LandmarkId> TileEvidence::TakeRefuted() {
  const double unlikely = std::log(0.1);
  std::vector<LandmarkId> refuted;
  for (const LandmarkId& landmark : awaiting_) {
    if (!IsConfirmed(landmark) && LogOddsOfMisses(landmark) < unlikely) {
      refuted.push_back(landmark);
    }
  }
  for (const LandmarkId& landmark : refuted) RemoveLandmark(landmark);
  return refuted;
}

std::vector<PassSighting> TileEvidence::PassesOf(LandmarkId landmark) const {
  std::vector<PassSighting> passes;
  const auto found = observations_.find(landmark);
  if (found == observations_.end()) return passes;
  const auto born = times_.find(landmark.drive);
  for (const auto& [drive, observation] : found->second) {
    const int64_t time_s = times_.at(drive);
    if (born != times_.end() && time_s < born->second) continue;
    passes.push_back({time_s, observation.outcome, kOddsStep * observation.odds_steps});
  }
  std::stable_sort(passes.begin(), passes.end(), [](const PassSighting& a, const PassSighting& b) {
    return a.time_s < b.time_s;
  });
  return passes;
}

TileEvidence::Counts TileEvidence::CountsOf(LandmarkId landmark) const {
  Counts counts;
  const auto found = observations_.find(landmark);
  if (found == observations_.end()) return counts;
  for (const auto& [drive, observation] : found->second) {
    counts.seen += observation.outcome == Sighting::kSeen;
    counts.missed += observation.outcome == Sighting::kMissed;
    counts.seen_through += observation.outcome == Sighting::kSeenThrough;
  }
  return counts;
}

int64_t TileEvidence::OldestPassS() const {
  int64_t oldest_s = times_.empty() ? 0 : times_.begin()->second;
  for (const auto& [drive, time_s] : times_) oldest_s = std::min(oldest_s, time_s);
  return oldest_s;
}

int64_t TileEvidence::NewestPassS() const {
  int64_t newest_s = 0;
  for (const auto& [drive, time_s] : times_) newest_s = std::max(newest_s, time_s);
  return newest_s;
}

std::vector<DriveId> TileEvidence::Drives() const {
  std::vector<DriveId> drives;
  for (const auto& [drive, time_s] : times_) drives.push_back(drive);
  return drives;
}

std::string TileEvidence::Encode() const {
  std::string out;
  AppendUint(static_cast<uint32_t>(times_.size()), out);
  std::map<DriveId, uint64_t> index_of;
  for (const auto& [drive, time_s] : times_) {
    index_of.emplace(drive, index_of.size());
    AppendUint(drive.input, out);
    AppendUint(drive.options, out);
    AppendUint(static_cast<uint64_t>(time_s), out);
  }
  std::string ids, outcomes, odds;
  std::vector<uint64_t> counts, passes;
  for (const auto& [landmark, of_landmark] : observations_) {
    AppendId(landmark, ids);
    counts.push_back(of_landmark.size());
    for (const auto& [drive, observation] : of_landmark) {
      passes.push_back(index_of.at(drive));
      outcomes.push_back(static_cast<char>(observation.outcome));
      odds.push_back(static_cast<char>(observation.odds_steps));
    }
  }
  std::string awaiting;
  for (const LandmarkId& landmark : awaiting_) AppendId(landmark, awaiting);
  AppendUint(static_cast<uint32_t>(awaiting_.size()), out);
  AppendUint(static_cast<uint32_t>(counts.size()), out);
  AppendUint(static_cast<uint32_t>(passes.size()), out);
  AppendByteColumn(awaiting, kZstdLevel, out);
  AppendUint(static_cast<uint32_t>(vanished_.size()), out);
  std::string vanished;
  for (const VanishedLandmark& landmark : vanished_) AppendVanished(landmark, vanished);
  AppendByteColumn(vanished, kZstdLevel, out);
  AppendByteColumn(ids, kZstdLevel, out);
  AppendIntColumn(counts, kZstdLevel, out);
  AppendIntColumn(passes, kZstdLevel, out);
  AppendByteColumn(outcomes, kZstdLevel, out);
  AppendByteColumn(odds, kZstdLevel, out);
  return out;
}

absl::StatusOr<TileEvidence> TileEvidence::Decode(std::string_view bytes) {
  constexpr size_t kMaxLandmarks = 1 << 22;
  ByteReader reader(bytes);
  const size_t passes = reader.Uint<uint32_t>();
  if (passes > kMaxPasses || passes > reader.remaining() / kPassBytes) {
    return absl::DataLossError("passes are missing");
  }
  TileEvidence evidence;
  std::vector<DriveId> drives;
  for (size_t i = 0; i < passes; ++i) {
    const auto input = reader.Uint<uint64_t>();
    drives.push_back({input, reader.Uint<uint64_t>()});
    evidence.times_[drives.back()] = static_cast<int64_t>(reader.Uint<uint64_t>());
  }
  const size_t awaiting = reader.Uint<uint32_t>();
  const size_t landmarks = reader.Uint<uint32_t>();
  const size_t observations = reader.Uint<uint32_t>();
  if (awaiting > kMaxLandmarks || landmarks > kMaxLandmarks ||
      observations > landmarks * kMaxPasses) {
    return absl::DataLossError("too many landmarks or observations");
  }
  CARMAP_ASSIGN_OR_RETURN(const std::string awaiting_ids,
                          ReadByteColumn(reader, awaiting * kIdBytes));
  const size_t vanished = reader.Uint<uint32_t>();
  if (vanished > kMaxVanished) return absl::DataLossError("too many landmarks that are gone");
  CARMAP_ASSIGN_OR_RETURN(const std::string vanished_bytes,
                          ReadByteColumn(reader, vanished * kVanishedBytes));
  ByteReader vanished_reader(vanished_bytes);
  for (size_t i = 0; i < vanished; ++i) {
    evidence.vanished_.push_back(ReadVanished(vanished_reader));
    if (!evidence.vanished_.back().position_in_tile.allFinite() ||
        !std::isfinite(evidence.vanished_.back().log_odds)) {
      return absl::DataLossError("a place or odds are no numbers");
    }
  }
  CARMAP_ASSIGN_OR_RETURN(const std::string ids, ReadByteColumn(reader, landmarks * kIdBytes));
  CARMAP_ASSIGN_OR_RETURN(const auto counts, ReadIntColumn(reader, landmarks));
  CARMAP_ASSIGN_OR_RETURN(const auto pass_idxs, ReadIntColumn(reader, observations));
  CARMAP_ASSIGN_OR_RETURN(const std::string outcomes, ReadByteColumn(reader, observations));
  CARMAP_ASSIGN_OR_RETURN(const std::string odds, ReadByteColumn(reader, observations));
  ByteReader awaiting_reader(awaiting_ids), id_reader(ids);
  for (size_t i = 0; i < awaiting; ++i) {
    evidence.awaiting_.insert(ReadId<LandmarkId>(awaiting_reader));
  }
  size_t next = 0;
  for (const uint64_t count : counts) {
    auto& of_landmark = evidence.observations_[ReadId<LandmarkId>(id_reader)];
    for (uint64_t i = 0; i < count; ++i, ++next) {
      if (next >= observations || pass_idxs[next] >= passes ||
          static_cast<uint8_t>(outcomes[next]) > static_cast<uint8_t>(Sighting::kSeenThrough)) {
        return absl::DataLossError("an observation is out of range");
      }
      of_landmark[drives[pass_idxs[next]]] = {static_cast<Sighting>(outcomes[next]),
                                              static_cast<int8_t>(odds[next])};
    }
  }
  if (next != observations || reader.remaining() != 0 || !reader.ok()) {
    return absl::DataLossError("wrong length");
  }
  return evidence;
}

absl::StatusOr<StoredEvidence> ReadEvidence(const MapReader& reader, TileId tile) {
  StoredEvidence stored;
  const std::string prefix = KeyPrefixOf(tile);
  CARMAP_RETURN_IF_ERROR(reader.VisitContributions(
      prefix, [&](std::string_view key, std::string_view value) -> absl::Status {
        auto evidence = TileEvidence::Decode(value);
        if (!evidence.ok()) {
          return absl::DataLossError(fmt::format(
              "what was seen and missed of tile {}/{:016x} is damaged ({}); `carmap base "
              "verify --repair` forgets it",
              tile.component, tile.cell, std::string(evidence.status().message())));
        }
        stored.evidence = *std::move(evidence);
        return absl::SimpleHexAtoi(std::string(key.substr(prefix.size())), &stored.revision)
                   ? absl::OkStatus()
                   : absl::DataLossError("the revision of some evidence is no number");
      }));
  return stored;
}

absl::Status DropEvidence(const MapReader& reader, TileId tile, Commit& commit) {
  return reader.VisitContributions(KeyPrefixOf(tile), [&](std::string_view key, std::string_view) {
    commit.withdrawn.emplace_back(key);
    return absl::OkStatus();
  });
}

absl::Status VisitEvidence(const MapReader& reader, const std::function<void(TileId)>& visit) {
  return reader.VisitContributions(kEvidencePrefix, [&](std::string_view key, std::string_view) {
    constexpr size_t kComponentDigits = 8, kCellDigits = 16;
    TileId tile;
    const std::string name(key.substr(kEvidencePrefix.size()));
    if (name.size() > kComponentDigits + kCellDigits + 1 &&
        absl::SimpleHexAtoi(name.substr(0, kComponentDigits), &tile.component) &&
        absl::SimpleHexAtoi(name.substr(kComponentDigits + 1, kCellDigits), &tile.cell)) {
      visit(tile);
    }
    return absl::OkStatus();
  });
}

void ReplaceEvidence(TileId tile, uint64_t read_revision, const TileEvidence& evidence,
                     Commit& commit) {
  RemoveEvidence(tile, read_revision, commit);
  commit.contributions.emplace_back(KeyOf(tile, read_revision + 1), evidence.Encode());
}

void RemoveEvidence(TileId tile, uint64_t read_revision, Commit& commit) {
  if (read_revision > 0) commit.withdrawn.push_back(KeyOf(tile, read_revision));
}

}  // namespace carmap
