#!/usr/bin/env bash
# Formatting, shell scripts and clang-tidy; fails on the first kind that finds anything.
#
#   scripts/lint.sh [FILE.cc ...]   clang-tidy over these; default: what differs from $BASE
#   scripts/lint.sh --all           clang-tidy over all sources
#   scripts/lint.sh --quick         no clang-tidy; exit code 77 if a tool is missing
#
# BASE is a commit; default: where the branch left main. clang-tidy takes seconds a file, most of
# them for headers of libraries. What passed is remembered in build/lint: --all can be interrupted.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
jobs="${CMAKE_BUILD_PARALLEL_LEVEL:-$(nproc)}"
passed=build/lint/passed

check_style() {
  local unformatted
  unformatted="$(find src tests bench fuzz \( -name '*.h' -o -name '*.cc' \) -print0 |
    xargs -0 --max-procs="$jobs" --max-args=50 clang-format --dry-run 2>&1 |
    sed -n 's/^\([^:]*\):[0-9:]* warning: code should be clang-formatted.*/\1/p' | sort -u)"
  if [[ -n "$unformatted" ]]; then
    echo "lint: not formatted; \`make format\` does it:" >&2
    echo "$unformatted" >&2
    exit 1
  fi
  shellcheck .ci/run scripts/*.sh
}

# A source that shows clang-tidy the file: itself, a header's own, or one that includes the header.
source_of() { # FILE
  local source="${1%.h}.cc" includer
  [[ "$1" != *.cc ]] || source="$1"
  if [[ -f "$source" ]]; then
    echo "$source"
    return
  fi
  includer="$(grep -rlF "\"${1#src/}\"" src bench | sort | sed -n 1p)"
  [[ -z "$includer" ]] || source_of "$includer"
}

# For each file that differs from the base.
changed_sources() { # BASE
  local file sources=('src/*.h' 'src/*.cc' 'bench/*.h' 'bench/*.cc')
  {
    git diff --name-only --diff-filter=d "$1" -- "${sources[@]}"
    git ls-files --others --exclude-standard -- "${sources[@]}"
  } | while read -r file; do source_of "$file"; done | sort -u
}

# By content, so that nothing is looked at twice.
tidy() { # HASH_OF_HEADERS FILE.cc
  local hash
  hash="$(cat "$2" <(echo "$1") | sha256sum | cut -d ' ' -f 1)"
  [[ ! -e "$passed/$hash" ]] || return 0
  clang-tidy -p build/lint --quiet "$2" 2> >(grep -v 'warnings\? generated\.$' >&2)
  touch "$passed/$hash"
}

if [[ "${1:-}" == --quick ]]; then
  for tool in clang-format shellcheck; do
    command -v "$tool" >/dev/null || { echo "lint: $tool: not installed"; exit 77; }
  done
  check_style
  exit
fi
check_style
case "${1:-}" in
  "")
    base="${BASE:-$(git merge-base HEAD origin/main 2>/dev/null || git merge-base HEAD main)}" || {
      echo "lint: no branch main to compare with; name a commit: BASE=COMMIT, or ALL=1" >&2
      exit 1
    }
    mapfile -t sources < <(changed_sources "$base")
    ;;
  --all) mapfile -t sources < <(find src bench -name '*.cc' | sort) ;;
  *) sources=("$@") ;;
esac
if ((${#sources[@]} > 0)); then
  cmake --preset release -B build/lint -DCMAKE_EXPORT_COMPILE_COMMANDS=ON >/dev/null
  mkdir -p "$passed"
  hash="$(find src -name '*.h' -print0 | sort -z | xargs -0 cat .clang-tidy | sha256sum)"
  export passed
  export -f tidy
  printf '%s\0' "${sources[@]}" |
    xargs -0 --max-procs="$jobs" --max-args=1 bash -euo pipefail -c 'tidy "$@"' tidy "$hash"
fi
echo "lint: nothing to say; clang-tidy looked at ${#sources[@]} sources"
