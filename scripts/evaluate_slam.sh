#!/usr/bin/env bash
# Simulates drives along real KITTI paths, maps each with loops left open, with loops closed, and
# with GPS, and prints the figures as a table, which is also left in build/evaluate_slam.md.
#
#   scripts/evaluate_slam.sh [PATH...]     paths by their numbers; default: 07 06 05 00
#
# SIZE=WxH is the images' size. Drives are kept in build/slam_drives; an interrupted run goes on
# where it stopped. Remove them after the simulator changed.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source-path=SCRIPTDIR source=report.sh
source scripts/report.sh

carmap=build/release/bin/carmap
poses="${CARMAP_DATA:-../shared/data}/kitti_poses/poses"
size="${SIZE:-620x188}"
drives=build/slam_drives
out=build/evaluate_slam
table=build/evaluate_slam.md
# A loop is false if its two keyframes are farther apart than this.
max_loop_m=20
(($# > 0)) || set -- 07 06 05 00
mkdir -p "$drives" "$out"

simulate() { # PATH DRIVE
  local scene=suburb
  [[ "$1" != 05 ]] || scene=downtown
  "$carmap" simulate --out "$2" --scene "$scene" --path "$poses/$1.txt" --traffic moving \
    --gps urban --size "$size"
}

# A drive without gps.txt, of links to the one with it.
link_without_gps() { # DRIVE LINKS
  mkdir -p "$2"
  local file
  for file in image_0 image_1 calib.txt times.txt poses.txt; do
    ln -sfn "$(realpath "$1/$file")" "$2/$file"
  done
}

map_drive() { # DRIVE NAME [OPTION...]
  local drive="$1" name="$2" status=0
  shift 2
  "$carmap" map "$drive" "$@" --out "$out/$name.cmap" --report "$out/$name.json" || status=$?
  ((status == 0 || status == 3)) || return "$status" # 3: frames were lost, as the table tells
}

# The closed loops, a line each: the frame, and the frame of the place that it came back to.
closed_loops() { # REPORT
  tr -d ' \n\t' <"$1" | grep -o '"index":[0-9]*,"place_index":[0-9]*' | tr -c '0-9\n' ' ' || true
}

# How many of the closed loops join keyframes that are truly far apart.
false_loops() { # REPORT POSES
  awk -v max="$max_loop_m" '
    NR == FNR { x[FNR - 1] = $4; y[FNR - 1] = $8; z[FNR - 1] = $12; next }
    { d = sqrt((x[$1] - x[$2])^2 + (y[$1] - y[$2])^2 + (z[$1] - z[$2])^2); if (d > max) ++count }
    END { print count + 0 }' "$2" <(closed_loops "$1")
}

row() { # PATH DRIVE HOW REPORT
  local report="$4"
  echo "| $1 | $3 | $(json_number "$report" tracked_frames)/$(json_number "$report" frames) |\
 $(rounded "$(json_number "$report" path_length_m)" 0) |\
 $(closed_loops "$report" | wc -l) | $(false_loops "$report" "$2/poses.txt") |\
 $(json_number "$report" rejected_keyframes) |\
 $(rounded "$(json_number "$report" ate_rmse_m)" 3) |\
 $(rounded "$(json_number "$report" t_rel_100_800_percent)" 3) |\
 $(rounded "$(json_number "$report" georeferenced_error_m mean)" 2) |\
 $(rounded "$(json_number "$report" georeferenced_error_m max)" 2) |\
 $(rounded "$(json_number "$report" frame_ms median)" 1) |\
 $(rounded "$(json_number "$report" frame_ms p95)" 1) |\
 $(rounded "$(json_number "$report" peak_rss_mb)" 0) |"
}

rows=()
for path; do
  if [[ ! -f "$poses/$path.txt" ]]; then
    echo "evaluate-slam: $poses/$path.txt: no such file; path $path is left out" >&2
    continue
  fi
  drive="$drives/${path}_$size"
  simulate "$path" "$drive"
  name="${path}_$size"
  link_without_gps "$drive" "$out/$name"
  map_drive "$out/$name" "${name}_open" --no-loops
  map_drive "$out/$name" "${name}_closed"
  map_drive "$drive" "${name}_gps"
  rows+=("$(row "$path" "$drive" "loops left open" "$out/${name}_open.json")"
    "$(row "$path" "$drive" "loops closed" "$out/${name}_closed.json")"
    "$(row "$path" "$drive" "loops closed, GPS" "$out/${name}_gps.json")")
done

if ((${#rows[@]} == 0)); then
  echo "evaluate-slam: $poses: none of the paths $*; name a folder with kitti_poses:" \
    "CARMAP_DATA=FOLDER make evaluate-slam" >&2
  exit 1
fi
{
  echo "| path, $size | how | tracked | path m | loops | false | rejected | ATE m | t_rel % |\
 on Earth m, mean | max | ms a frame, median | p95 | peak MB |"
  echo "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|"
  printf '%s\n' "${rows[@]}"
} >"$table"
echo
cat "$table"
echo
echo "Reports: $PWD/$out; table: $PWD/$table"
