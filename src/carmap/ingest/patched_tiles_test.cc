#include "carmap/ingest/patched_tiles.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "carmap/ingest/test_base.h"

namespace carmap {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

/// A base that a vehicle opened before two drives were added to it.
class PatchedTilesTest : public BaseTest {
 protected:
  PatchedTilesTest() {
    const LeanMap first = MapOf(street_, {.id = 1, .to_m = 60});
    Add(first);
    Contribute(first, "first", *opened_).value();
    Add(MapOf(street_, {.id = 2, .from_m = 20, .to_m = 90, .lane_m = 3}));
    Add(MapOf(street_, {.id = 3, .from_m = 60, .to_m = 300, .lane_m = 3}));
    for (const TileVersion& version : AllTiles()) {
      const auto there = opened_->reader().VersionOf(version.tile).value();
      const auto patches = base_->reader().ReadPatches(version.tile, there).value();
      for (const StoredPatch& stored : patches) {
        patches_.push_back(DecodePatch(stored.patch, "patch").value());
      }
    }
  }
  void ExpectAsAtTheBase(const PatchedTiles& tiles) const {
    for (const TileVersion& version : AllTiles()) {
      const auto tile = tiles.Read(version.tile).value();
      ASSERT_NE(tile, nullptr);
      EXPECT_EQ(tile->version, version.version);
      EXPECT_EQ(HashOf(tile->map), HashOf(base_->Read(version.tile).value()->map));
    }
  }

  /// The first patch of a tile that the vehicle has.
  const Patch& FirstPatch() const {
    return *std::find_if(patches_.begin(), patches_.end(),
                         [](const Patch& patch) { return patch.from_version > 0; });
  }

  const Street street_ = MakeStreet(3, 330);
  std::unique_ptr<BaseMap> opened_ =
      BaseMap::Over(MakeMemoryStore(BaseMap::NewHeader()), "opened").value();
  std::vector<Patch> patches_;
};

TEST_F(PatchedTilesTest, AreThoseOfTheBaseInWhateverOrderPatchesCome) {
  PatchedTiles tiles(*opened_);
  for (auto patch = patches_.rbegin(); patch != patches_.rend(); ++patch) {
    tiles.Add(*patch);
    tiles.Add(*patch);
  }
  ExpectAsAtTheBase(tiles);
  EXPECT_EQ(tiles.applied(), patches_.size());
  EXPECT_THAT(tiles.faults(), IsEmpty());
}

TEST_F(PatchedTilesTest, ShowWhatTheyHaveSoFarAndGoOn) {
  PatchedTiles tiles(*opened_);
  for (const Patch& patch : patches_) {
    tiles.Add(patch);
    EXPECT_EQ(tiles.Read(patch.tile).value()->version, patch.to_version);
  }
  ExpectAsAtTheBase(tiles);
}

TEST_F(PatchedTilesTest, WaitForWhatIsMissing) {
  PatchedTiles tiles(*opened_);
  const TileId tile = FirstPatch().tile;
  const uint64_t version = opened_->reader().VersionOf(tile).value();
  for (const Patch& patch : patches_) {
    if (patch.tile == tile && patch.to_version > version + 1) tiles.Add(patch);
  }
  EXPECT_EQ(tiles.Read(tile).value()->version, version);
  tiles.Add(FirstPatch());
  EXPECT_EQ(tiles.Read(tile).value()->version, base_->reader().VersionOf(tile).value());
}

TEST_F(PatchedTilesTest, LeaveOutAPatchThatIsNotWhatItWas) {
  PatchedTiles tiles(*opened_);
  Patch wrong = FirstPatch();
  wrong.hash ^= 1;
  tiles.Add(wrong);
  EXPECT_EQ(tiles.Read(wrong.tile).value()->version, wrong.from_version);
  tiles.Read(wrong.tile).value();
  ASSERT_THAT(tiles.faults(), SizeIs(1));
  EXPECT_THAT(tiles.faults().front(), HasSubstr("fetch the tile"));
}

TEST_F(PatchedTilesTest, NewTilesAreFoundByPlace) {
  PatchedTiles tiles(*opened_);
  const Component component = opened_->Components().value().front();
  const MapView whole = Whole(1);
  const Eigen::Vector3d end =
      whole.root_from_view() * whole.map().keyframes.back().map_from_camera.translation;
  const size_t before = tiles.Near(component, {end}, 30).value().size();
  for (const Patch& patch : patches_) tiles.Add(patch);
  EXPECT_GT(tiles.Near(component, {end}, 30).value().size(), before);
}

}  // namespace
}  // namespace carmap
