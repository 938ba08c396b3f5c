#!/usr/bin/env bash
# Installs what Fovea needs on Debian 12: compiler, libraries, and the programs its tests use.
# Run as root, or as a user with sudo. Safe to run again: what is there already is left alone.
#   deploy/install-deps.sh            everything (build, run, test)
#   deploy/install-deps.sh --build    build and run only, no test tools
set -euo pipefail

build_packages=(
  g++ cmake ninja-build pkg-config ccache git ca-certificates
  libabsl-dev libprotobuf-dev protobuf-compiler libgrpc++-dev protobuf-compiler-grpc libssl-dev
  libtbb-dev libhwy-dev libzstd-dev libisal-dev libspdlog-dev libcli11-dev nlohmann-json3-dev
  prometheus-cpp-dev libcpp-httplib-dev
  libpng-dev libjpeg62-turbo-dev zlib1g-dev libsqlite3-dev libnifti-dev
  libopenvdb-dev libboost-iostreams-dev libopenimageio-dev
  ffmpeg
)
test_packages=(
  libgtest-dev libgmock-dev libblosc-dev
  python3 python3-numpy openssl
)

packages=("${build_packages[@]}")
case "${1:-}" in
  "") packages+=("${test_packages[@]}") ;;
  --build) ;;
  -h | --help) sed -n '2,5s/^# //p' "$0"; exit 0 ;;
  *) echo "install-deps.sh: unknown option '$1' (only --build is known)" >&2; exit 2 ;;
esac
# Node is only for the test in which an independent Zarr library opens the store. Debian's npm
# conflicts with a Node from elsewhere, so it is installed only where there is none.
if [ "${1:-}" != --build ] && ! command -v npm >/dev/null 2>&1; then
  packages+=(nodejs npm)
fi

missing=()
for package in "${packages[@]}"; do
  dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q '^install ok installed$' || missing+=("$package")
done
if [ "${#missing[@]}" -eq 0 ]; then
  echo "install-deps: all ${#packages[@]} packages are there"
  exit 0
fi

as_root=()
if [ "$(id -u)" -ne 0 ]; then
  command -v sudo >/dev/null 2>&1 || {
    echo "install-deps: needs root to install: ${missing[*]}" >&2
    echo "install-deps: run it as root, or install sudo first" >&2
    exit 1
  }
  as_root=(sudo)
fi
echo "install-deps: installing ${#missing[@]} packages (about 100 MB on a fresh system): ${missing[*]}"
"${as_root[@]}" apt-get update -q
"${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends "${missing[@]}"
echo "install-deps: done"
