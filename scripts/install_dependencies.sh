#!/usr/bin/env bash
# Installs the Debian 12 packages that CarMap is built with; only those missing, so that a machine
# that has them needs neither network nor root.
#
#   scripts/install_dependencies.sh [build] [style] [lint] [fuzz] [segmenter]     (default: build)
set -euo pipefail

build_packages=(
  g++ cmake ninja-build ccache pkg-config
  libeigen3-dev libceres-dev libnanoflann-dev libgeographiclib-dev libs2-dev
  libopencv-core-dev libopencv-imgproc-dev libopencv-imgcodecs-dev
  libopencv-features2d-dev libopencv-calib3d-dev libopencv-dnn-dev
  libhwy-dev libtbb-dev libembree-dev libabsl-dev libfmt-dev libcli11-dev nlohmann-json3-dev
  libzstd-dev libxxhash-dev librocksdb-dev
  libgtest-dev libgmock-dev librapidcheck-dev libbenchmark-dev
)
style_packages=(clang-format shellcheck)
lint_packages=("${style_packages[@]}" clang-tidy)
fuzz_packages=(clang-14 libclang-rt-14-dev)
segmenter_packages=(python3-torch python3-opencv python3-numpy)

fail() {
  echo "install_dependencies.sh: $*" >&2
  exit 1
}

is_installed() {
  [[ "$(dpkg-query --show --showformat='${db:Status-Status}' "$1" 2>/dev/null)" == installed ]]
}

packages=("${build_packages[@]}")
for group in "$@"; do
  case "$group" in
    build) ;;
    style) packages+=("${style_packages[@]}") ;;
    lint) packages+=("${lint_packages[@]}") ;;
    fuzz) packages+=("${fuzz_packages[@]}") ;;
    segmenter) packages+=("${segmenter_packages[@]}") ;;
    *) fail "unknown group '$group'; the groups are build, style, lint, fuzz and segmenter" ;;
  esac
done

if ! command -v apt-get >/dev/null; then
  fail "needs Debian's apt-get; elsewhere install what these packages hold: ${packages[*]}"
fi

missing=()
for package in "${packages[@]}"; do
  is_installed "$package" || missing+=("$package")
done
((${#missing[@]} > 0)) || exit 0

as_root=()
if ((EUID != 0)); then
  command -v sudo >/dev/null || fail "must be root, or have sudo, to install: ${missing[*]}"
  as_root=(sudo)
fi

echo "Installing ${#missing[@]} Debian packages: ${missing[*]}"
if ! "${as_root[@]}" apt-get update --quiet ||
  ! "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
    apt-get install -o DPkg::Lock::Timeout=300 --quiet --yes --no-install-recommends \
    "${missing[@]}"; then
  fail "apt-get failed (see above); needs the network and Debian 12 (bookworm)"
fi
