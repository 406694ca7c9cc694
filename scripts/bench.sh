#!/usr/bin/env bash
# Builds and runs the benchmarks; arguments go to the program.
#
#   scripts/bench.sh [--benchmark_filter=REGEX ...]
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

cmake --preset release
cmake --build --preset release --target carmap_bench
build/release/bin/carmap_bench "$@"
