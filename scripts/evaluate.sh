#!/usr/bin/env bash
# Maps every real drive that is present, localizes it in its own map, and prints the figures as a
# table. Maps and reports are left in build/evaluate.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
# shellcheck source-path=SCRIPTDIR source=report.sh
source scripts/report.sh

carmap=build/release/bin/carmap
data="${CARMAP_DATA:-../shared/data}"
out=build/evaluate
mkdir -p "$out"

rows=()
for calibration in "$data"/*/calib.txt; do
  [[ -f "$calibration" ]] || continue
  drive="$(dirname "$calibration")"
  name="$(basename "$drive")"
  "$carmap" map "$drive" --out "$out/$name.cmap" --report "$out/$name.map.json"
  truth=()
  [[ ! -f "$drive/poses.txt" ]] || truth=(--map-truth "$drive")
  "$carmap" localize "$drive" --map "$out/$name.cmap" "${truth[@]}" \
    --report "$out/$name.localize.json"

  map="$out/$name.map.json"
  localize="$out/$name.localize.json"
  rows+=("| $name | $(json_number "$map" tracked_frames)/$(json_number "$map" frames) |\
 $(rounded "$(json_number "$map" ate_rmse_m)" 3) |\
 $(rounded "$(json_number "$map" frame_ms median)" 1) |\
 $(json_number "$map" landmarks) | $(json_number "$map" lean_bytes) |\
 $(json_number "$localize" localized_frames)/$(json_number "$localize" frames) |\
 $(rounded "$(json_number "$localize" position_error_m median)" 3) |\
 $(rounded "$(json_number "$localize" position_error_m max)" 3) |")
done

if ((${#rows[@]} == 0)); then
  echo "evaluate: $data: no drive in it; name a folder of drives: CARMAP_DATA=FOLDER make evaluate" >&2
  exit 1
fi
echo
echo "| drive | tracked | ATE m | ms a frame | landmarks | bytes | localized | error m, median | max |"
echo "|---|---|---|---|---|---|---|---|---|"
printf '%s\n' "${rows[@]}"
echo
echo "Reports: $PWD/$out"
