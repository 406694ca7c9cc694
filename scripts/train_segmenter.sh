#!/usr/bin/env bash
# Makes the segmentation network that comes with the program anew, of simulated drives alone, and
# measures it in worlds that it has not seen. Drives that are in build/segmenter already are used as
# they are: remove it after the simulator changed.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

carmap=build/release/bin/carmap
if [[ ! -x "$carmap" ]]; then
  echo "train_segmenter: $carmap: not built yet; run: make segmenter" >&2
  exit 1
fi
drives=build/segmenter
network=src/carmap/semantics/default.onnx

# Short drives through a world of their own for each scene, light and traffic.
render() {  # SET FIRST_SEED SIZE FRAMES [OPTION...]
  local scene light traffic seed="$2"
  for scene in suburb downtown freeway; do
    for light in sunny overcast low-sun; do
      for traffic in parked moving dense; do
        "$carmap" simulate --out "$drives/$1/$seed" --scene "$scene" --seed "$seed" \
          --length 400 --speed 30 --size "$3" --frames "$4" --labels --light "$light" \
          --light-seed "$seed" --traffic "$traffic" --traffic-seed "$seed" "${@:5}"
        seed=$((seed + 1))
      done
    done
  done
}

mkdir -p "$drives"/{train,validation,test} "$(dirname "$network")"
render train 2001 1241x376 5
render train 2101 1241x376 5 --path straight --lane 1
render train 2201 620x188 5 --path curves --reverse
render train 2301 620x188 6 --path straight
render train 2401 620x188 6 --path curves --lane 1
render train 2501 620x188 6 --path straight --reverse --lane 1
render train 2601 620x188 6 --path curves
render validation 3001 620x188 3 --path straight
render test 4001 1241x376 3
render test 4101 620x188 3 --path straight --lane 1
render test 4201 304x126 3 --path curves

python=/usr/bin/python3  # Debian's, whose packages were installed
"$python" scripts/train_segmenter.py train --drives "$drives"/train/* \
  --validation "$drives"/validation/* --out "$network"
"$python" scripts/train_segmenter.py evaluate --network "$network" --drives "$drives"/test/*
