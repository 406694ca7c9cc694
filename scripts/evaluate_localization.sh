#!/usr/bin/env bash
# How well drives are localized in maps that were made in other traffic, light and lanes: simulates
# the drives, maps, localizes, and prints the figures as tables, which are also left in
# build/evaluate_localization.md, pictures in build/evaluate_localization.
#
#   scripts/evaluate_localization.sh
#
# By default each three conditions meet in a cell, and the cells of which there is a record run
# always; ALL=1 runs every cell. SEEDS, SIZES and SCENES select (SEEDS=31 SIZES=620x188
# SCENES="suburb downtown"). BASELINES=1 localizes the named cells by appearance too, as ORB-SLAM2
# and QuickSketch would, in full maps. SEGMENTER=default (or what else --segmenter takes) maps and
# localizes with the dynamic object filter too, which the tables have beside.
# CELLS="SCENE MAP_TRAFFIC LANE TRAFFIC LIGHT" runs only these, a cell a line.
#
# Drives are kept in $CARMAP_DRIVES, or else in build/drives, for all evaluations; remove them after
# the simulator changed. Maps and reports are made anew, unless RESUME=1.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

# shellcheck source-path=SCRIPTDIR source=drives.sh
source scripts/drives.sh
out=build/evaluate_localization
table=build/evaluate_localization.md
seeds="${SEEDS:-31 32 33}"
sizes="${SIZES:-1241x376 620x188}"
scenes="${SCENES:-suburb downtown freeway}"

# SCENE MAP_TRAFFIC LANE TRAFFIC LIGHT, of each size and seed.
named_cells="suburb none 0 none sunny
suburb none 0 parked low-sun
suburb none 1 dense overcast
suburb none 1 dense low-sun
downtown none 0 moving low-sun
downtown none 1 none overcast
downtown none 1 dense overcast
downtown dense 0 dense overcast
downtown dense 1 none overcast
downtown dense 1 dense overcast
freeway none 2 dense overcast
freeway none 1 dense low-sun
freeway dense 2 dense overcast
freeway dense 1 dense low-sun"

# Prints the map's path without its ending.
make_map() { # DRIVE
  local map
  map="$out/maps/$(basename "$1")"
  [[ -s "$map.cmap" ]] || tolerate_lost_frames "$carmap" map "$1" --out "$map.cmap" \
    ${BASELINES:+--full-map "$map.cfull"} --report "$map.json"
  echo "$map"
}

evaluate_cell() { # SCENE SEED SIZE MAP_TRAFFIC LANE TRAFFIC LIGHT
  local map_drive drive map report
  map_drive="$(simulate "$1" "$2" "$3" 0 "$4" sunny map)"
  drive="$(simulate "$1" "$2" "$3" "$5" "$6" "$7")"
  map="$(make_map "$map_drive")"
  report="$out/reports/$1-s$2-$3-map_$4-to-lane$5-$6-$7"
  # That no frame was found is a result too.
  [[ -s "$report.json" ]] || "$carmap" localize "$drive" --map "$map.cmap" --map-truth "$map_drive" \
    --report "$report.json" >&2 || [[ -s "$report.json" ]]
  [[ -z "${SEGMENTER:-}" ]] || evaluate_filtered "$map_drive" "$drive" "$map" "$report"
  [[ -z "${BASELINES:-}" ]] || evaluate_baselines "$@" "$map_drive" "$drive" "$map" "$report"
}

# With the dynamic object filter in both drives (§3.3).
evaluate_filtered() { # MAP_DRIVE DRIVE MAP REPORT
  [[ -s "$3-filtered.cmap" ]] || tolerate_lost_frames "$carmap" map "$1" --out "$3-filtered.cmap" \
    --segmenter "$SEGMENTER" --report "$3-filtered.json"
  [[ -s "$4-by_filter.json" ]] || "$carmap" localize "$2" --map "$3-filtered.cmap" \
    --map-truth "$1" --segmenter "$SEGMENTER" --report "$4-by_filter.json" >&2 ||
    [[ -s "$4-by_filter.json" ]]
}

# As ORB-SLAM2 and QuickSketch would, in the named cells.
evaluate_baselines() { # SCENE SEED SIZE MAP_TRAFFIC LANE TRAFFIC LIGHT MAP_DRIVE DRIVE MAP REPORT
  grep -qxF -e "$1 $4 $5 $6 $7" <<<"${CELLS:-$named_cells}" || return 0
  local trace
  trace="$(make_map "$9")"
  [[ -s "${11}-by_appearance.json" ]] || "$carmap" evaluate frames "$9" --by appearance --map "${10}.cfull" \
    --map-truth "$8" --report "${11}-by_appearance.json" >&2
  [[ -s "${11}-by_quicksketch.json" ]] || "$carmap" evaluate frames "$9" --by appearance \
    --trace "$trace.cfull" --map "${10}.cfull" --map-truth "$8" \
    --report "${11}-by_quicksketch.json" >&2
}

# Figure 21: a static map of the freeway, and the landmarks matched of those in sight.
evaluate_matching() { # SEED SIZE
  local map_drive map case lane traffic drive shares
  map_drive="$(simulate freeway "$1" "$2" 0 none sunny map)"
  map="$(make_map "$map_drive")"
  for case in "0 none" "1 none" "0 dense" "1 dense"; do
    read -r lane traffic <<<"$case"
    # The base case of the paper is the map's own drive.
    drive="$map_drive"
    [[ "$case" == "0 none" ]] || drive="$(simulate freeway "$1" "$2" "$lane" "$traffic" sunny)"
    shares="$("$carmap" evaluate matching "$drive" --map "$map.cmap" --map-truth "$map_drive")"
    awk -v name="| $2, seed $1, lane $lane, $traffic |" '
      /^landmarks/ { in_sight = $2 } /^by position/ { position = $3 }
      /^by appearance/ { print name, in_sight, "|", position, "|", $3, "|" }' <<<"$shares"
  done
}

[[ -n "${RESUME:-}" ]] || rm -rf "$out"
mkdir -p "$out/maps" "$out/reports"
if [[ -n "${CELLS:-}" ]]; then
  for size in $sizes; do
    while read -r scene rest; do echo "$scene $size $rest"; done <<<"$CELLS"
  done
else
  awk -v scenes="$scenes" -v sizes="$sizes" -v all="${ALL:-0}" -v named="$named_cells" \
    -f scripts/localization_cells.awk
fi >"$out/cells.txt"
echo "evaluate-localization: $(wc -l <"$out/cells.txt") cells, seeds $seeds" >&2
for seed in $seeds; do
  while read -r scene size map_traffic lane traffic light; do
    evaluate_cell "$scene" "$seed" "$size" "$map_traffic" "$lane" "$traffic" "$light" </dev/null
  done <"$out/cells.txt"
done

"$carmap" evaluate localization "$out"/reports/*.json --out "$out" >"$table"
if [[ " $scenes " == *" freeway "* && -z "${CELLS:-}" ]]; then
  {
    echo
    echo "| landmarks in sight that are matched | in sight a frame | by position | by appearance |"
    echo "|---|---|---|---|"
    for size in $sizes; do
      for seed in $seeds; do evaluate_matching "$seed" "$size"; done
    done
  } >>"$table"
fi
cat "$table"
echo
echo "Reports and pictures: $PWD/$out; table: $PWD/$table"
