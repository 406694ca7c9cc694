#!/usr/bin/env bash
# Formatting, shellcheck and clang-tidy over all sources; fails on the first kind that finds anything.
#
#   scripts/lint.sh [FILE.cc ...]     (clang-tidy over these alone; default: all)
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
jobs="${CMAKE_BUILD_PARALLEL_LEVEL:-$(nproc)}"

unformatted="$(find src tests bench fuzz \( -name '*.h' -o -name '*.cc' \) -print0 |
  xargs -0 clang-format --dry-run 2>&1 |
  sed -n 's/^\([^:]*\):[0-9:]* warning: code should be clang-formatted.*/\1/p' | sort -u)"
if [[ -n "$unformatted" ]]; then
  echo "lint: not formatted; \`make format\` does it:" >&2
  echo "$unformatted" >&2
  exit 1
fi

shellcheck .ci/run scripts/*.sh

cmake --preset release -B build/lint -DCMAKE_EXPORT_COMPILE_COMMANDS=ON >/dev/null
sources=("$@")
(($# > 0)) || mapfile -t sources < <(find src bench -name '*.cc' | sort)
printf '%s\0' "${sources[@]}" |
  xargs -0 --max-procs="$jobs" --max-args=1 clang-tidy -p build/lint --quiet \
    2> >(grep -v 'warnings\? generated\.$' >&2)
echo "lint: nothing to say"
