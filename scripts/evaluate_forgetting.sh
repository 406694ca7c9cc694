#!/usr/bin/env bash
# What a base map learns and forgets of streets that change: simulates a drive that founds a base,
# drives of the same street, and then drives of the changed street in other traffic, light and
# lanes; each localizes in the base and publishes, and the base takes it. Prints tables, which are
# also left in build/evaluate_forgetting.md.
#
#   scripts/evaluate_forgetting.sh [SCENE...]
#
# Scenes: suburb, downtown (default: both). SEEDS="31 43 57 71" chooses towns, CHANGE_SEED=2 what
# changes in them, SIZE=620x188 the images, UNCHANGED=3 and CHANGED=6 how many drives come before and
# after the change. Drives are kept in $CARMAP_DRIVES, or else in build/drives; remove them after the
# simulator changed.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

# shellcheck source-path=SCRIPTDIR source=drives.sh
source scripts/drives.sh
out=build/evaluate_forgetting
table=build/evaluate_forgetting.md
seeds="${SEEDS:-31 43 57 71}"
change_seed="${CHANGE_SEED:-2}"
size="${SIZE:-620x188}"
unchanged="${UNCHANGED:-3}"
changed="${CHANGED:-6}"
(($# > 0)) || set -- suburb downtown
rm -rf "$out"
mkdir -p "$out"
: >"$table"
traffics=(parked moving none dense)
lights=(overcast sunny low-sun)
day_s=86400
first_s=1790000000

# Prints the folder of the n-th drive of the town, before the change or after.
pass_of() { # SCENE SEED NUMBER [changed]
  local name="$1-s$2-$size-curves-pass$3${4:+-change$change_seed}" n="$3"
  if ! is_complete "$drives/$name"; then
    "$carmap" simulate --out "$drives/$name" --scene "$1" --path curves --length 125 --seed "$2" \
      --size "$size" --frames "$drive_frames" --speed 11 --gps urban --lane $((n / 2 % 2)) \
      --traffic "${traffics[n % 4]}" --traffic-seed $((n + 3)) --light "${lights[n % 3]}" \
      --light-seed $((n + 7)) ${4:+--change-seed "$change_seed"} >&2
  fi
  echo "$drives/$name"
}

# One drive localizes in the base, publishes, and is added; its reports are left in $out.
drive_and_add() { # BASE DRIVE DAY NAME
  tolerate_lost_frames "$carmap" drive "$2" --base "$1" --out "$out/$4.parts" --segmenter default \
    --start-time $((first_s + $3 * day_s)) --report "$out/$4.drive.json"
  tolerate_lost_frames "$carmap" map "$2" --out "$out/$4.cmap" --segmenter default
  tolerate_lost_frames "$carmap" base add "$1" "$out/$4.parts"/*.cmdiff --report "$out/$4.add.json"
  "$carmap" base export "$1" --out "$out/after.cmap" >&2
}

for scene in "$@"; do
  for seed in $seeds; do
    base="$out/$scene-s$seed.base"
    first="$(pass_of "$scene" "$seed" 0)"
    truth="$(pass_of "$scene" "$seed" $((unchanged + 1)) changed)"
    tolerate_lost_frames "$carmap" map "$first" --out "$out/first.cmap" --segmenter default \
      --start-time "$first_s"
    "$carmap" base init "$base" >&2
    "$carmap" base add "$base" "$out/first.cmap" >&2
    "$carmap" base export "$base" --out "$out/before.cmap" >&2
    {
      echo
      echo "$scene, seed $seed, change $change_seed, $size; $unchanged drives as it was, then $changed of the changed street"
      echo
      echo "| drive | bytes of a segment | bytes sent | of removed things left | things gone | standing lost | on new things, of a fresh map's |"
      echo "|---|---|---|---|---|---|---|"
    } >>"$table"
    for ((n = 1; n <= unchanged + changed; ++n)); do
      state=""
      ((n <= unchanged)) || state=changed
      drive="$(pass_of "$scene" "$seed" "$n" $state)"
      name="$scene-s$seed-$n"
      drive_and_add "$base" "$drive" "$n" "$name"
      row="$("$carmap" evaluate forgetting "$out/before.cmap" "$out/after.cmap" --truth "$first" \
        --changed "$truth" --fresh "$out/$name.cmap" --fresh-truth "$drive" \
        --report "$out/$name.json" --row)"
      echo "| $n $state | $(bytes_of "$out/$name.cmap") | $(bytes_of "$out/$name.parts"/*) $row" >>"$table"
    done
  done
done
cat "$table"
