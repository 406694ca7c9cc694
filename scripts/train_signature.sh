#!/usr/bin/env bash
# Chooses the comparisons of the signature anew, of simulated drives alone: the same roads in other
# light, traffic and lanes. Drives that are in build/signature already are used as they are: remove
# it after the simulator changed. Maps and vocabularies of before no longer fit: run
# `make vocabulary` afterwards.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

carmap=build/release/bin/carmap
drives=build/signature
out=src/carmap/feature/signature_tests.inc

cmake --build --preset release --target carmap train_signature
mkdir -p "$drives"

simulate() { # LANE TRAFFIC LIGHT DAY
  drive="$drives/$scene-$seed-day$4-$2-$3"
  "$carmap" simulate --out "$drive" --scene "$scene" --seed "$seed" --length 150 --speed 18 \
    --frames 14 --size 620x188 --lane="$1" --traffic "$2" --traffic-seed "$4" --light "$3" \
    --light-seed "$4"
}

pairs=()
for seed in 61 62; do
  for scene in suburb downtown freeway; do
    simulate 0 parked sunny 1
    mapped="$drive"
    while read -r lane traffic light day; do
      simulate "$lane" "$traffic" "$light" "$day"
      pairs+=("$mapped" "$drive")
    done <<'DRIVES'
0 parked overcast 2
0 moving low-sun 2
1 parked overcast 3
0 none sunny 5
DRIVES
  done
done
build/release/bin/train_signature "${pairs[@]}" --out "$out"
