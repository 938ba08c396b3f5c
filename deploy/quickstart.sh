#!/usr/bin/env bash
# From a bare Debian 12 to pictures: installs what is needed, builds, ingests the sample sequence of
# OpenVDB files, serves it, and exports it as PNG and EXR frames and as a movie.
#   deploy/quickstart.sh        as root, or as a user with sudo; safe to run again
# Everything it makes lies in build/ and out/quickstart/.
set -euo pipefail
cd "$(dirname "$0")/.."
case "${1:-}" in
  "") ;;
  -h | --help) sed -n '2,5s/^# //p' "$0"; exit 0 ;;
  *) echo "quickstart: there are no options, but '$1' was given" >&2; exit 2 ;;
esac

out=out/quickstart
server=
times=()
fail() { echo "quickstart: $*" >&2; exit 1; }
now_ms() { local t=${EPOCHREALTIME/[.,]/}; echo $((t / 1000)); }

# part NAME COMMAND...: runs one part, and remembers how long it took.
part() {
  local name=$1 start took
  shift
  echo "== $name"
  start=$(now_ms)
  "$@"
  took=$(($(now_ms) - start))
  times+=("$(printf '%6d.%d s  %s' $((took / 1000)) $((took % 1000 / 100)) "$name")")
}

build() {
  # tests/run.sh builds build/release with the tests; where that was done it is used, elsewhere a
  # folder without tests is enough (ccache then spares tests/run.sh most of the work).
  local folder=build/release
  if [ ! -e build/release/build.ninja ]; then
    folder=build/quickstart
    cmake --preset release -B "$folder" -DFOVEA_BUILD_TESTS=OFF -DFOVEA_BUILD_BENCH=OFF > "$out/configure.log" ||
      fail "cmake failed; its output is in $out/configure.log"
  fi
  cmake --build "$folder" --target fovea fovead fovea-worker fovea-vdb-worker --parallel "$(nproc)"
  fovea=$folder/bin/fovea
  "$fovea" --version
}

ingest() {
  "$fovea" ingest 'tests/data/plume/plume_####.vdb' -o "$out/plume.zarr"
  "$fovea" info "$out/plume.zarr"
}

start_server() {
  "$fovea" serve "$out" --listen 127.0.0.1:0 > "$out/serve.out" 2> "$out/serve.log" &
  server=$!
  trap 'kill "$server" 2>/dev/null || true' EXIT
  for _ in $(seq 200); do
    address=$(sed -n '1s/^fovead listening on grpc //p' "$out/serve.out")
    [ -z "$address" ] || break
    kill -0 "$server" 2>/dev/null || fail "the server did not start; $out/serve.log says why"
    sleep 0.1
  done
  [ -n "$address" ] || fail "the server said nothing for 20 s; see $out/serve.log"
  echo "serving $out on $address"
}

stop_server() {
  local status=0
  kill -TERM "$server"
  wait "$server" || status=$?
  trap - EXIT
  [ "$status" -eq 0 ] || fail "the server ended with status $status; see $out/serve.log"
  echo "the server stopped cleanly"
}

serve() {
  start_server
  "$fovea" info --server "$address"
  "$fovea" render --server "$address" plume --step 8 --fovea-marker -o "$out/served.png"
  "$fovea" export --server "$address" plume -o "$out/served/f.####.png"
  stop_server
}

export_frames() { "$fovea" export "$out/plume.zarr" -o "$out/$1/f.####.$1"; }
export_movie() { "$fovea" export "$out/plume.zarr" -o "$out/plume.mp4"; }

# The server must have sent the very pictures that are made without it.
compare() {
  local frame
  for frame in "$out"/png/f.*.png; do
    cmp "$frame" "$out/served/${frame##*/}" || fail "served and local pictures differ"
  done
}

mkdir -p "$out"
# What an earlier run left, and nothing else.
rm -rf "$out"/{plume.zarr,served,png,exr,plume.mp4,served.png,.plume.mp4.fovea-export.json}
part "install packages" deploy/install-deps.sh --build
part "build" build
part "ingest 15 OpenVDB files" ingest
part "serve, render and stream over gRPC" serve
part "export PNG frames" export_frames png
part "export EXR frames" export_frames exr
part "export a movie" export_movie
compare

echo
echo "Pictures:"
echo "  $out/served.png           one step, from the server, with a red dot at the fovea"
echo "  $out/served/f.####.png    the sequence, streamed from the server"
echo "  $out/png/f.####.png       the same, made without it (byte for byte alike)"
echo "  $out/exr/f.####.exr       linear, half floats"
echo "  $out/plume.mp4            the movie"
echo "Time:"
printf '%s\n' "${times[@]}"
echo "Next, on your own files (fovea is $fovea):"
echo "  $fovea export 'smoke.####.vdb' -o smoke.mp4"
echo "  $fovea render volume.raw --raw 256x256x256:uint8 --view 30,20 --rate 64 -o volume.png"
echo "  $fovea ingest 'smoke.####.vdb' -o data/smoke.zarr && $fovea serve data"
