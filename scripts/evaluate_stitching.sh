#!/usr/bin/env bash
# How well map segments are stitched, and how fast, beside the ways that the paper compares with
# (§A.6): simulates drives, maps them, stitches, and prints the figures as tables, which are also
# left in build/evaluate_stitching.md, pictures in build/evaluate_stitching.
#
#   scripts/evaluate_stitching.sh [EXPERIMENT...]
#
#   lanes    figure 22: segments of each freeway lane to a base of each
#   traffic  figure 16: suburb and downtown, empty and in dense traffic, under another sky
#   overlap  figure A.12: one drive split in two, by the frames that both have
#   size     figure A.7: segments of more and more keyframes to one base
#
# Default: all. Segments begin OVERLAP=20 frames before their base ends. SEED=31 and SIZE=620x188
# choose the drives; REAL=DRIVE takes a real one, with poses.txt, for `overlap`. Drives are kept in
# $CARMAP_DRIVES, or else in build/drives, for all evaluations; remove them after the simulator
# changed. Maps and reports are made anew.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

# shellcheck source-path=SCRIPTDIR source=drives.sh
source scripts/drives.sh
poses="${CARMAP_DATA:-../shared/data}/kitti_poses/poses"
out=build/evaluate_stitching
table=build/evaluate_stitching.md
seed="${SEED:-31}"
size="${SIZE:-620x188}"
overlap="${OVERLAP:-20}"
base_frames=60
(($# > 0)) || set -- lanes traffic overlap size
rm -rf "$out"
mkdir -p "$out"
: >"$table"

# Of the seed and size chosen.
drive_of() { # SCENE LANE TRAFFIC LIGHT [map]
  simulate "$1" "$seed" "$size" "${@:2}"
}

# With the full map beside it.
make_map() { # DRIVE NAME [OPTION...]
  tolerate_lost_frames "$carmap" map "$1" --out "$out/$2.cmap" --full-map "$out/$2.cfull" "${@:3}"
}

evaluate() { # NAME TITLE BASE BASE_TRUTH WAYS SEGMENT... -- TRUTH...
  local name="$1" title="$2" base="$3" truth="$4" ways="$5" segments=() truths=()
  shift 5
  while [[ "$1" != -- ]]; do
    segments+=("$out/$1.cmap")
    shift
  done
  shift
  for drive in "$@"; do truths+=(--segment-truth "$drive"); done
  {
    echo
    echo "$title"
    echo
    "$carmap" evaluate stitching "$out/$base.cmap" "${segments[@]}" --base-truth "$truth" \
      "${truths[@]}" --ways "$ways" --report "$out/$name.json" --picture "$out/$name.png"
  } >>"$table"
}

lanes() {
  local lane other base segments truths
  for lane in -1 0 1 2; do
    make_map "$(drive_of freeway "$lane" none overcast)" "lane$lane" \
      --first $((base_frames - overlap))
  done
  for lane in -1 0 1 2; do
    base="$(drive_of freeway "$lane" none sunny map)"
    make_map "$base" "base$lane" --last $((base_frames - 1))
    segments=() truths=()
    for other in -1 0 1 2; do
      segments+=("lane$other")
      truths+=("$(drive_of freeway "$other" none overcast)")
    done
    evaluate "lanes$lane" "Figure 22: a base of freeway lane $lane in sunshine, segments of each lane under clouds; $size, seed $seed" \
      "base$lane" "$base" carmap,quicksketch "${segments[@]}" -- "${truths[@]}"
  done
}

traffic() {
  local scene of base segments truths to
  for scene in suburb downtown; do
    for of in none dense; do
      make_map "$(drive_of "$scene" 0 "$of" overcast)" "$scene-$of" \
        --first $((base_frames - overlap))
    done
    for of in none dense; do
      base="$(drive_of "$scene" 0 "$of" sunny map)"
      make_map "$base" "base-$scene-$of" --last $((base_frames - 1))
      segments=() truths=()
      for to in none dense; do
        segments+=("$scene-$to")
        truths+=("$(drive_of "$scene" 0 "$to" overcast)")
      done
      evaluate "$scene-$of" "Figure 16: a base of $scene, traffic $of, in sunshine, segments under clouds; $size, seed $seed" \
        "base-$scene-$of" "$base" carmap,appearance,quicksketch "${segments[@]}" -- "${truths[@]}"
    done
  done
}

overlap() {
  local drive count first both segments=()
  drive="${REAL:-$(drive_of suburb 0 none sunny map)}"
  count="$(wc -l <"$drive/times.txt")"
  make_map "$drive" split --last $((count / 2 - 1))
  for both in 1 2 3 5 10 20 40; do
    ((both < count / 2)) || continue
    first=$((count / 2 - both))
    make_map "$drive" "overlap-$both" --first "$first"
    segments+=("overlap-$both")
  done
  evaluate overlap "Figure A.12: $(basename "$drive") split in two that have so many frames in common" \
    split "$drive" carmap,progressive,quicksketch "${segments[@]}" -- "$drive"
}

size() {
  local drive="$drives/path07-s1-620x188" last segments=()
  "$carmap" simulate --out "$drive" --scene suburb --path "$poses/07.txt" --size 620x188 \
    --traffic moving --gps urban >&2
  make_map "$drive" long --last 149
  for last in 200 300 500 700 900; do
    make_map "$drive" "to-$last" --first 130 --last "$last"
    segments+=("to-$last")
  done
  evaluate size "Figure A.7: segments of KITTI's path 07 from frame 130 on to a base of frames 0 to 149; 620x188" \
    long "$drive" carmap,progressive "${segments[@]}" -- "$drive"
}

for experiment in "$@"; do
  case "$experiment" in
    lanes | traffic | overlap | size) "$experiment" ;;
    *)
      echo "evaluate_stitching.sh: $experiment: no such experiment; lanes, traffic, overlap or size" >&2
      exit 2
      ;;
  esac
done
cat "$table"
echo
echo "Reports and pictures: $PWD/$out; table: $PWD/$table"
