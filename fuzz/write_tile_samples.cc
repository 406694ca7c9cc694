// Writes the files that the fuzzer of tiles, patches and diffs begins with into a folder.
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>

#include "carmap/base/file.h"
#include "carmap/format/tile_codec.h"
#include "tile_samples.h"

namespace {

std::string BytesOf(const absl::StatusOr<std::string>& encoded) {
  if (encoded.ok()) return *encoded;
  std::fprintf(stderr, "write_tile_samples: %s\n", encoded.status().ToString().c_str());
  std::exit(1);
}

void Write(const std::filesystem::path& path, const std::string& bytes) {
  if (const absl::Status status = carmap::WriteFileAtomically(path, bytes); !status.ok()) {
    std::fprintf(stderr, "write_tile_samples: %s\n", status.ToString().c_str());
    std::exit(1);
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: write_tile_samples FOLDER\n");
    return 2;
  }
  const carmap::Tile tile = carmap::SampleTile();
  carmap::Tile next = carmap::SampleNextTile();
  next.map = carmap::Quantize(next.map);
  const std::string of_tile = BytesOf(carmap::EncodeTile(tile));
  const std::string of_patch = BytesOf(carmap::EncodePatch(carmap::MakePatch(tile, next)));
  const std::string of_diff = BytesOf(carmap::EncodeDiff(carmap::SampleDiff()));
  const std::filesystem::path folder = argv[1];
  Write(folder / "tile", of_tile);
  Write(folder / "patch", of_patch);
  Write(folder / "diff", of_diff);
  Write(folder / "tile_and_patch", of_tile + of_patch);
  Write(folder / "tile_and_diff", of_tile + of_diff);
  return 0;
}
