#!/usr/bin/env bash
# Makes the vocabulary that comes with the program anew, of simulated drives alone. Drives
# that are in build/vocabulary already are used as they are: remove it after the simulator changed.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

carmap=build/release/bin/carmap
if [[ ! -x "$carmap" ]]; then
  echo "train_vocabulary: $carmap: not built yet; run: make vocabulary" >&2
  exit 1
fi
drives=build/vocabulary
out=src/carmap/feature/default.cmvoc

mkdir -p "$drives"
# Scene, seed, light, traffic. Frames lie two metres and more apart: neighbours show the same words.
while read -r scene seed light traffic; do
  "$carmap" simulate --out "$drives/$scene-$seed" --scene "$scene" --seed "$seed" --path curves \
    --length 1500 --speed 25 --frames 100 --size 620x188 --light "$light" --light-seed "$seed" \
    --traffic "$traffic" --traffic-seed "$seed"
done <<'DRIVES'
suburb 101 sunny parked
downtown 102 sunny parked
downtown 103 overcast moving
freeway 104 sunny moving
suburb 105 overcast moving
downtown 106 low-sun parked
DRIVES
"$carmap" vocabulary train "$drives"/* --out "$out" --step 1
