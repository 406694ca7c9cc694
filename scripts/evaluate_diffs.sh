#!/usr/bin/env bash
# What a vehicle sends of a road that the base knows, beside a segment of the same drive (§5.2):
# when nothing changed, in other traffic, in other light, and in both. Prints a table, which is also
# left in build/evaluate_diffs.md.
#
#   scripts/evaluate_diffs.sh [SCENE...]
#
# Scenes: suburb, downtown, freeway (default: all). SEED=31 and SIZE=620x188 choose the drives. They
# are kept in $CARMAP_DRIVES, or else in build/drives, for all evaluations; remove them after the
# simulator changed.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

# shellcheck source-path=SCRIPTDIR source=drives.sh
source scripts/drives.sh
out=build/evaluate_diffs
table=build/evaluate_diffs.md
seed="${SEED:-31}"
size="${SIZE:-620x188}"
(($# > 0)) || set -- suburb downtown freeway
rm -rf "$out"
mkdir -p "$out"
{
  echo "Base: the drive without traffic in sunshine; seed $seed, $size, 100 frames."
  echo
  echo "| drive in the base | bytes of a segment | bytes sent | ratio | parts |"
  echo "|---|---|---|---|---|"
} >"$table"

send() { # SCENE NAME DRIVE
  local name="$1-$2" segment sent
  tolerate_lost_frames "$carmap" map "$3" --out "$out/$name.cmap" --segmenter default
  tolerate_lost_frames "$carmap" drive "$3" --base "$out/$1.base" --out "$out/$name.parts" \
    --segmenter default --report "$out/$name.json"
  segment="$(bytes_of "$out/$name.cmap")"
  sent="$(bytes_of "$out/$name.parts"/*)"
  local parts=("$out/$name.parts"/*)
  echo "| $1, $2 | $segment | $sent | $(awk "BEGIN { printf \"%.1f\", $segment / $sent }") | ${#parts[@]} |" >>"$table"
}

for scene in "$@"; do
  first="$(simulate "$scene" "$seed" "$size" 0 none sunny map)"
  tolerate_lost_frames "$carmap" map "$first" --out "$out/$scene.cmap" --segmenter default
  "$carmap" base init "$out/$scene.base" >&2
  "$carmap" base add "$out/$scene.base" "$out/$scene.cmap" >&2
  send "$scene" "nothing changed" "$first"
  send "$scene" "other traffic" "$(simulate "$scene" "$seed" "$size" 0 dense sunny map)"
  send "$scene" "other light" "$(simulate "$scene" "$seed" "$size" 0 none overcast)"
  send "$scene" "other traffic and light" "$(simulate "$scene" "$seed" "$size" 0 dense overcast)"
done
cat "$table"
