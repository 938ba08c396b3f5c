#!/usr/bin/env bash
# Installs, builds and runs every test; ends with ctest's summary. As root, or with sudo.
#   tests/run.sh                    everything, in build/release
#   tests/run.sh -R thick           further arguments go to ctest
# FOVEA_TEST_DATA names a folder of real volumes, where there is one; tests on them are added then.
set -euo pipefail
cd "$(dirname "$0")/.."
deploy/install-deps.sh
cmake --preset release
cmake --build --preset release
exec ctest --preset release "$@"
