#!/usr/bin/env bash
# The loop of the product on a real drive: two segments are mapped, the second is stitched to the
# first, and the whole drive is localized in the result. Leaves a report in demo/.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source-path=SCRIPTDIR source=report.sh
source scripts/report.sh

carmap=build/release/bin/carmap
drive="${CARMAP_DATA:-../shared/data}/kitti06_000-050"

if [[ ! -d "$drive" ]]; then
  echo "demo: $drive: the real drive is absent; put frames 0-50 of KITTI odometry sequence 06" \
    "there, or name the folder that holds kitti06_000-050: CARMAP_DATA=FOLDER make demo" >&2
  exit 1
fi
if [[ ! -x "$carmap" ]]; then
  echo "demo: $carmap: not built yet; run: make demo" >&2
  exit 1
fi

rm -rf demo
mkdir demo

echo "1/5  A first vehicle maps frames 0 to 33."
"$carmap" map "$drive" --last 33 --out demo/base.cmap \
  --report demo/base.json --picture demo/base.png
echo "2/5  A second one maps frames 18 to 50."
"$carmap" map "$drive" --first 18 --out demo/segment.cmap --report demo/segment.json
echo "3/5  The service stitches the second map to the first."
"$carmap" stitch demo/base.cmap demo/segment.cmap --out demo/stitched.cmap \
  --report demo/stitch.json
"$carmap" info demo/stitched.cmap
"$carmap" info demo/stitched.cmap --json >demo/stitched.json
echo "4/5  A third localizes itself in the result, frame by frame."
"$carmap" localize "$drive" --map demo/stitched.cmap --map-truth "$drive" \
  --trajectory demo/localized.txt --report demo/localize.json --picture demo/localize.png
echo "5/5  Its trajectory is compared with the ground truth."
"$carmap" evaluate trajectory demo/localized.txt "$drive/poses.txt"
"$carmap" evaluate trajectory demo/localized.txt "$drive/poses.txt" --json >demo/trajectory.json

# map_row TITLE REPORT: a line of the report's table of maps.
map_row() {
  local landmarks bytes
  landmarks="$(json_number "$2" landmarks)"
  bytes="$(json_number "$2" lean_bytes)"
  echo "| $1 | $(json_number "$2" keyframes) | $landmarks | $bytes |" \
    "$(rounded "$(json_number "$2" frame_ms median)" 1) |" \
    "$(rounded "$(json_number "$2" ate_rmse_m)" 3) |"
}

localized="$(json_number demo/localize.json localized_frames)"
frames="$(json_number demo/localize.json frames)"
error_median="$(rounded "$(json_number demo/localize.json position_error_m median)" 3)"
error_max="$(rounded "$(json_number demo/localize.json position_error_m max)" 3)"
load_ms="$(rounded "$(json_number demo/localize.json load_ms total)" 1)"
turn_median="$(rounded "$(json_number demo/localize.json rotation_error_deg median)" 3)"
ate="$(rounded "$(json_number demo/trajectory.json ate_rmse_m)" 3)"

cat >demo/report.md <<END
# CarMap demo: a road is mapped in two parts, stitched, and driven again

Drive: kitti06_000-050 (KITTI odometry sequence 06, frames 0–50). Made by \`make demo\`.

## Maps

| map | keyframes | landmarks | bytes | ms a frame, median | ATE m |
|---|---|---|---|---|---|
$(map_row "base (frames 0–33)" demo/base.json)
$(map_row "segment (frames 18–50)" demo/segment.json)

After stitching: $(json_number demo/stitched.json keyframes) keyframes and
$(json_number demo/stitched.json landmarks) landmarks in $(wc -c <demo/stitched.cmap) bytes.

## The whole drive, localized in the stitched map

$localized of $frames frames localized. Against the ground truth: position $error_median m in the
median, $error_max m at most; rotation $turn_median° in the median. The trajectory on its own: ATE $ate m.
Reading the map and rebuilding what it leaves out took $load_ms ms.

![The stitched map, the localized trajectory and the truth from above](localize.png)

The base map by itself, with the mapping trajectory and the truth:

![The base map from above](base.png)
END

echo
echo "$localized of $frames frames localized, position error $error_median m (median)," \
  "$error_max m (max)"
echo "Report: $PWD/demo/report.md   Picture: $PWD/demo/localize.png"
