#!/usr/bin/env bash
# Simulates drives along real KITTI paths, maps each with loops left open, with loops closed, and
# with GPS; a drive of five rounds on one road, mapped after one and after all; and a drive at
# KITTI's own image size, fed as by a camera of 20 Hz. Prints the figures as tables, which are also
# left in build/evaluate_slam.md.
#
#   scripts/evaluate_slam.sh [PATH...]     paths by their numbers, `rounds` and `replay`;
#                                          default: rounds replay 07 06 09 05 02 00
#
# SIZE=WxH is the images' size. Drives are kept in $CARMAP_DRIVES, or else in build/drives, for all
# evaluations; an interrupted run goes on where it stopped. Remove them after the simulator changed.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source-path=SCRIPTDIR source=report.sh
source scripts/report.sh

carmap=build/release/bin/carmap
poses="${CARMAP_DATA:-../shared/data}/kitti_poses/poses"
size="${SIZE:-620x188}"
drives="${CARMAP_DRIVES:-build/drives}"
out=build/evaluate_slam
table=build/evaluate_slam.md
# A loop is false if its two keyframes are farther apart than this.
max_loop_m=20
(($# > 0)) || set -- rounds replay 07 06 09 05 02 00
mkdir -p "$drives" "$out"

simulate() { # PATH_FILE DRIVE SCENE [OPTION...]
  local path="$1" drive="$2" scene="$3"
  shift 3
  "$carmap" simulate --out "$drive" --scene "$scene" --path "$path" --traffic moving --gps urban "$@"
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

# When the vehicle comes back to where it was, a line each, its first and last frame: less than 5 m
# from a place that it passed 60 m ago or more, and in about the same direction. What is less than
# 30 frames apart is one time.
revisits() { # POSES
  awk '
    { x[NR] = $4; y[NR] = $8; z[NR] = $12; a[NR] = $3; b[NR] = $7; c[NR] = $11
      i = NR - 1
      if (NR > 1) s[NR] = s[i] + sqrt((x[NR] - x[i])^2 + (y[NR] - y[i])^2 + (z[NR] - z[i])^2)
      for (i = 1; i < NR && s[i] < s[NR] - 60; ++i) {
        if ((x[i] - x[NR])^2 + (y[i] - y[NR])^2 + (z[i] - z[NR])^2 > 25) continue
        if (a[i] * a[NR] + b[i] * b[NR] + c[i] * c[NR] < 0.7) continue
        if (last && NR - last > 30) print first - 1, last - 1
        if (!last || NR - last > 30) first = NR
        last = NR
        break
      } }
    END { if (last) print first - 1, last - 1 }' "$1"
}

# After how many frames each return was closed; - where none was.
closing_delays() { # REPORT POSES
  awk '
    FILENAME == ARGV[1] { loop[++loops] = $1; next }
    { delay = "-"
      for (i = loops; i > 0; --i) if (loop[i] > $1 - 30 && loop[i] <= $2 + 30) delay = loop[i] - $1
      printf "%s%s", separator, delay; separator = ", " }' <(closed_loops "$1") <(revisits "$2")
}

header() { # COLUMN...
  [[ ! -s "$table" ]] || echo >>"$table"
  { printf '| %s ' "$@" && echo '|' && printf '|%.0s---' "$@" && echo '|'; } >>"$table"
}

row() { # PATH DRIVE HOW REPORT
  local report="$4"
  echo "| $1 | $3 | $(json_number "$report" tracked_frames)/$(json_number "$report" frames) |\
 $(rounded "$(json_number "$report" path_length_m)" 0) |\
 $(revisits "$2/poses.txt" | wc -l) | $(closed_loops "$report" | wc -l) |\
 $(closing_delays "$report" "$2/poses.txt") | $(false_loops "$report" "$2/poses.txt") |\
 $(json_number "$report" rejected_keyframes) |\
 $(rounded "$(json_number "$report" ate_rmse_m)" 3) |\
 $(rounded "$(json_number "$report" t_rel_100_800_percent)" 3) |\
 $(rounded "$(json_number "$report" georeferenced_error_m mean)" 2) |\
 $(rounded "$(json_number "$report" georeferenced_error_m max)" 2) |\
 $(rounded "$(json_number "$report" frame_ms median)" 1) |\
 $(rounded "$(json_number "$report" frame_ms p99)" 1) |\
 $(rounded "$(json_number "$report" peak_rss_mb)" 0) |" >>"$table"
}

# A camera's poses on five rounds of a street round a block: 100 m by 60 m with round corners.
rounds_path() {
  awk 'BEGIN {
    pi = atan2(0, -1); radius = 14; long = 100 - 2 * radius; short = 60 - 2 * radius
    arc = radius * pi / 2; round = 2 * (long + short + 2 * arc)
    for (s = 0; s < 5 * round + 10; s += 0.8) {
      left = s - round * int(s / round); x = z = heading = 0
      for (side = 0; left > 0; ++side) {
        straight = side % 2 ? short : side == 2 ? long : long / 2
        step = left < straight ? left : straight
        x += step * sin(heading); z += step * cos(heading); left -= step
        step = left < arc ? left : arc; turned = heading + step / radius
        x += radius * (cos(heading) - cos(turned)); z += radius * (sin(turned) - sin(heading))
        heading = turned; left -= step
      }
      c = cos(heading); h = sin(heading)
      printf "%.6f 0 %.6f %.6f 0 1 0 0 %.6f 0 %.6f %.6f\n", c, h, x, -h, c, z
    }
  }'
}

evaluate_rounds() {
  local drive="$drives/rounds_$size" frames
  rounds_path >"$drives/rounds.txt"
  simulate "$drives/rounds.txt" "$drive" suburb --size "$size"
  frames="$(wc -l <"$drive/poses.txt")"
  link_without_gps "$drive" "$out/rounds_$size"
  map_drive "$out/rounds_$size" rounds_1 --last $((frames / 5 + 10))
  map_drive "$out/rounds_$size" rounds_5
  header "rounds, $size" keyframes landmarks "lean MB" "peak MB" "ATE m"
  local rounds report
  for rounds in 1 5; do
    report="$out/rounds_$rounds.json"
    echo "| $rounds | $(json_number "$report" keyframes) | $(json_number "$report" landmarks) |\
 $(awk '{ printf "%.2f", $1 / 1e6 }' <<<"$(json_number "$report" lean_bytes)") |\
 $(rounded "$(json_number "$report" peak_rss_mb)" 0) |\
 $(rounded "$(json_number "$report" ate_rmse_m)" 3) |" >>"$table"
  done
}

evaluate_replay() {
  local drive="$drives/replay" report="$out/replay.json"
  simulate "$poses/07.txt" "$drive" suburb --size 1241x376 --frames 300
  map_drive "$drive" replay --replay 20
  header "replay at Hz, 1241x376" frames dropped "ms a frame, median" p99 max
  echo "| $(json_number "$report" replay rate_hz) | $(json_number "$report" frames) |\
 $(json_number "$report" replay dropped_frames) |\
 $(rounded "$(json_number "$report" frame_ms median)" 1) |\
 $(rounded "$(json_number "$report" frame_ms p99)" 1) |\
 $(rounded "$(json_number "$report" frame_ms max)" 1) |" >>"$table"
}

evaluate_path() { # PATH
  local path="$1" drive="$drives/path$1-$size" name="$1_$size" scene=suburb
  [[ "$path" != 05 ]] || scene=downtown
  simulate "$poses/$path.txt" "$drive" "$scene" --size "$size"
  link_without_gps "$drive" "$out/$name"
  map_drive "$out/$name" "${name}_open" --no-loops
  map_drive "$out/$name" "${name}_closed"
  map_drive "$drive" "${name}_gps"
  header "path, $size" how tracked "path m" returns loops "closed after frames" false rejected \
    "ATE m" "t_rel %" "on Earth m, mean" max "ms a frame, median" p99 "peak MB"
  row "$path" "$drive" "loops left open" "$out/${name}_open.json"
  row "$path" "$drive" "loops closed" "$out/${name}_closed.json"
  row "$path" "$drive" "loops closed, GPS" "$out/${name}_gps.json"
}

: >"$table"
for path; do
  recorded="$poses/${path/replay/07}.txt"
  if [[ "$path" != rounds && ! -f "$recorded" ]]; then
    echo "evaluate-slam: $recorded: no such file, so $path is left out; name a folder with" \
      "kitti_poses: CARMAP_DATA=FOLDER make evaluate-slam" >&2
    continue
  fi
  case "$path" in
    rounds | replay) "evaluate_$path" ;;
    *) evaluate_path "$path" ;;
  esac
done
[[ -s "$table" ]] || exit 1
echo
cat "$table"
echo
echo "Reports: $PWD/$out; table: $PWD/$table"
