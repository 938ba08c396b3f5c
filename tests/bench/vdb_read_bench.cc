// What OpenVDB alone takes to read the grids of files: the rival of ingest_bench.py. Prints the
// milliseconds of each pass over all files.
//   vdb_read_bench GRID,GRID... PASSES FILE...

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <string>
#include <vector>

#include <openvdb/openvdb.h>

#include "engine/base/stopwatch.h"

namespace {

std::vector<std::string> Split(const std::string& text) {
  std::vector<std::string> parts(1);
  for (const char c : text) {
    if (c == ',') {
      parts.emplace_back();
    } else {
      parts.back() += c;
    }
  }
  return parts;
}

/// Active voxels of the wanted grids of one file, read whole.
uint64_t ReadFile(const std::string& path, const std::vector<std::string>& grids) {
  openvdb::io::File file(path);
  file.open(/*delayLoad=*/false);
  uint64_t voxels = 0;
  for (const std::string& grid : grids) {
    if (file.hasGrid(grid)) {
      voxels += file.readGrid(grid)->activeVoxelCount();
    }
  }
  return voxels;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 4) {
    std::fprintf(stderr, "usage: vdb_read_bench GRID,GRID... PASSES FILE...\n");
    return 2;
  }
  try {
    openvdb::initialize();
    const std::vector<std::string> grids = Split(argv[1]);
    for (int pass = 0; pass < std::atoi(argv[2]); ++pass) {
      const fovea::Stopwatch watch;
      uint64_t voxels = 0;
      for (int i = 3; i < argc; ++i) {
        voxels += ReadFile(argv[i], grids);
      }
      std::printf("%.1f ms, %llu active voxels\n", watch.ElapsedMs(),
                  static_cast<unsigned long long>(voxels));
    }
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
  return 0;
}
