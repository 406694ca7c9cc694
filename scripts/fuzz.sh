#!/usr/bin/env bash
# Builds every fuzzer and feeds each for some seconds; stops at the first that finds a fault.
#
#   scripts/fuzz.sh [SECONDS]
#
# What a fuzzer learnt stays in build/fuzz/corpus/NAME; an input that breaks it is left in build/fuzz.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
seconds="${1:-60}"

cmake --preset fuzz
cmake --build --preset fuzz --target fuzzers

found=0
for fuzzer in build/fuzz/bin/*_fuzz; do
  [[ -x "$fuzzer" ]] || continue
  found=1
  name="$(basename "$fuzzer")"
  corpus="build/fuzz/corpus/$name"
  mkdir -p "$corpus"
  seeds=()
  case "$name" in
    decode_lean_map_fuzz) seeds=(src/carmap/format/testdata) ;;
    decode_tile_fuzz)
      mkdir -p build/fuzz/samples
      build/fuzz/bin/write_tile_samples build/fuzz/samples
      seeds=(build/fuzz/samples)
      ;;
  esac
  echo "== $name for $seconds s"
  "$fuzzer" -max_total_time="$seconds" -print_final_stats=1 -max_len=16384 -rss_limit_mb=1024 \
    -timeout=30 -artifact_prefix="build/fuzz/$name-" "$corpus" "${seeds[@]}"
done
if ((found == 0)); then
  echo "fuzz.sh: no program build/fuzz/bin/*_fuzz was built; see fuzz/CMakeLists.txt" >&2
  exit 1
fi
