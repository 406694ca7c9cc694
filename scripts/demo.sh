#!/usr/bin/env bash
# The loop of the product in a simulated suburb: one vehicle drives an empty street and maps it in
# two segments, the second is stitched to the first, and another vehicle, past parked cars and in
# traffic, finds itself in the result. Leaves a report with pictures in demo/.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source-path=SCRIPTDIR source=report.sh
source scripts/report.sh

carmap=build/release/bin/carmap
if [[ ! -x "$carmap" ]]; then
  echo "demo: $carmap: not built yet; run: make demo" >&2
  exit 1
fi

rm -rf demo
mkdir demo
world=(--scene suburb --length 300 --seed 1 --frames 80)

echo "1/6  A first vehicle drives down a street without traffic."
"$carmap" simulate --out demo/empty "${world[@]}" --traffic none
echo "2/6  Later another one drives there, past parked cars and in traffic, under other light."
"$carmap" simulate --out demo/busy "${world[@]}" --traffic moving --traffic-seed 7 \
  --light overcast --light-seed 2 --speed 9
echo "3/6  The first drive is mapped in two segments."
"$carmap" map demo/empty --last 50 --out demo/base.cmap --report demo/base.json \
  --picture demo/base.png
"$carmap" map demo/empty --first 30 --out demo/segment.cmap --report demo/segment.json
echo "4/6  The service stitches the second segment to the first."
"$carmap" stitch demo/base.cmap demo/segment.cmap --out demo/stitched.cmap \
  --report demo/stitch.json
"$carmap" info demo/stitched.cmap
"$carmap" info demo/stitched.cmap --json >demo/stitched.json
echo "5/6  The second vehicle localizes itself in the result, frame by frame."
"$carmap" localize demo/busy --map demo/stitched.cmap --map-truth demo/empty \
  --trajectory demo/localized.txt --report demo/localize.json --picture demo/localize.png \
  --frame-picture demo/frame.png --error-picture demo/error.png
echo "6/6  Its trajectory is compared with the ground truth."
"$carmap" evaluate trajectory demo/localized.txt demo/busy/poses.txt
"$carmap" evaluate trajectory demo/localized.txt demo/busy/poses.txt --json >demo/trajectory.json

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
# CarMap demo: a street is mapped in two parts, stitched, and driven again in traffic

Two drives through one simulated suburb: [empty](empty/world.json), a street without traffic in
sunshine, and [busy](busy/world.json), the same street with parked and moving cars under clouds.
Made by \`make demo\`.

| the mapping drive | the later one |
|---|---|
| ![A frame of the empty street](empty/image_0/000040.png) | ![A frame in traffic](busy/image_0/000040.png) |

## Maps

| map | keyframes | landmarks | bytes | ms a frame, median | ATE m |
|---|---|---|---|---|---|
$(map_row "base (frames 0–50)" demo/base.json)
$(map_row "segment (frames 30–79)" demo/segment.json)

After stitching: $(json_number demo/stitched.json keyframes) keyframes and
$(json_number demo/stitched.json landmarks) landmarks in $(wc -c <demo/stitched.cmap) bytes.

## The later drive, localized in the stitched map

$localized of $frames frames localized. Against the ground truth: position $error_median m in the
median, $error_max m at most; rotation $turn_median° in the median. The trajectory on its own: ATE $ate m.
Reading the map and rebuilding what it leaves out took $load_ms ms.

![Errors over the distance driven](error.png)

A frame with its features, and which of them are in the map:

![The frame that was found best](frame.png)

The stitched map, the localized trajectory and the truth from above:

![The stitched map from above](localize.png)

The base map by itself, with the mapping trajectory and the truth:

![The base map from above](base.png)
END

echo
echo "$localized of $frames frames localized, position error $error_median m (median)," \
  "$error_max m (max)"
echo "Report: $PWD/demo/report.md   Pictures: $PWD/demo/{localize,frame,error}.png"
