// Ingest of a sparse VDB against the same voxels packed together: cost must follow active voxels,
// not the box that they lie in. A million voxels in cubes of some edge, scattered through EXTENT^3
// or side by side; `fovea ingest` as a process, runs taking turns.
//   sparse_bench [--extent 4096] [--voxels 1000000] [--rounds 5] [--folder DIR]

#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <random>
#include <set>
#include <string>
#include <tuple>
#include <vector>

#include "engine/base/stopwatch.h"
#include "ingest/program_path.h"
#include "tests/support/vdb_files.h"

namespace fovea {
namespace {

struct Settings {
  int64_t extent = 4096, voxels = 1'000'000, rounds = 5;
  std::string folder = "/tmp";
};

/// One cube of voxels whose values vary.
void AddCube(const Int3& at, int64_t edge, testing::VdbGrid* grid) {
  for (int64_t z = 0; z < edge; ++z) {
    for (int64_t y = 0; y < edge; ++y) {
      for (int64_t x = 0; x < edge; ++x) {
        const double value = 1 + std::sin(0.3 * static_cast<double>(x + 2 * y)) * 0.5 +
                             0.01 * static_cast<double>((x * 7 + y * 13 + z * 29) % 11);
        grid->voxels.push_back({{at.x + x, at.y + y, at.z + z}, value});
      }
    }
  }
}

/// Cubes whose corners are multiples of their edge; the first and the last corner of the box are
/// taken, so that its extent is what was asked for.
void WriteCubes(const std::string& path, const Settings& settings, int64_t edge, bool scattered) {
  testing::VdbGrid grid;
  const int64_t cubes = settings.voxels / (edge * edge * edge);
  const auto packed = static_cast<int64_t>(std::ceil(std::cbrt(static_cast<double>(cubes)) - 1e-9));
  const int64_t places = scattered ? settings.extent / edge : packed;
  std::set<std::tuple<int64_t, int64_t, int64_t>> taken{{0, 0, 0}};
  if (scattered) {
    taken.insert({places - 1, places - 1, places - 1});
  }
  std::mt19937 random(7);
  std::uniform_int_distribution<int64_t> any(0, places - 1);
  while (static_cast<int64_t>(taken.size()) < cubes) {
    taken.insert({any(random), any(random), any(random)});
  }
  for (const auto& [x, y, z] : taken) {
    AddCube({x * edge, y * edge, z * edge}, edge, &grid);
  }
  testing::WriteVdb(path, {grid});
}

struct Cost {
  double seconds = 1e30, processor_seconds = 1e30, megabytes = 0;
};

void Ingest(const std::string& program, const std::string& input, const std::string& output,
            Cost* least) {
  std::filesystem::remove_all(output);
  const Stopwatch watch;
  const pid_t child = ::fork();
  if (child == 0) {
    static_cast<void>(std::freopen("/dev/null", "w", stdout));
    ::execl(program.c_str(), program.c_str(), "ingest", input.c_str(), "-o", output.c_str(), "-q",
            nullptr);
    ::_exit(127);
  }
  int status = 0;
  rusage used{};
  if (::wait4(child, &status, 0, &used) != child || status != 0) {
    std::fprintf(stderr, "sparse_bench: fovea ingest failed\n");
    std::exit(1);
  }
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  least->seconds = std::min(least->seconds, watch.ElapsedMs() / 1000);
  least->processor_seconds =
      std::min(least->processor_seconds, seconds(used.ru_utime) + seconds(used.ru_stime));
  least->megabytes = std::max(least->megabytes, static_cast<double>(used.ru_maxrss) / 1024);
}

void Compare(const Settings& settings, const std::string& program, int64_t edge) {
  const std::string base = settings.folder + "/sparse_bench";
  Cost packed, scattered;
  WriteCubes(base + "_packed.vdb", settings, edge, false);
  WriteCubes(base + "_scattered.vdb", settings, edge, true);
  for (int64_t round = 0; round < settings.rounds; ++round) {
    Ingest(program, base + "_packed.vdb", base + ".zarr", &packed);
    Ingest(program, base + "_scattered.vdb", base + ".zarr", &scattered);
  }
  std::filesystem::remove_all(base + ".zarr");
  std::filesystem::remove(base + "_packed.vdb");
  std::filesystem::remove(base + "_scattered.vdb");
  std::printf("| %lld | %.3f | %.3f | %.2f | %.3f | %.3f | %.2f | %.0f | %.0f | %.2f |\n",
              static_cast<long long>(edge), packed.seconds, scattered.seconds,
              scattered.seconds / packed.seconds, packed.processor_seconds,
              scattered.processor_seconds, scattered.processor_seconds / packed.processor_seconds,
              packed.megabytes, scattered.megabytes, scattered.megabytes / packed.megabytes);
  std::fflush(stdout);
}

int Main(int argc, char** argv) {
  Settings settings;
  for (int i = 1; i + 1 < argc; i += 2) {
    const std::string name = argv[i];
    if (name == "--extent") {
      settings.extent = std::atoll(argv[i + 1]);
    } else if (name == "--voxels") {
      settings.voxels = std::atoll(argv[i + 1]);
    } else if (name == "--rounds") {
      settings.rounds = std::atoll(argv[i + 1]);
    } else if (name == "--folder") {
      settings.folder = argv[i + 1];
    } else {
      std::fprintf(stderr, "sparse_bench: unknown option %s\n", name.c_str());
      return 2;
    }
  }
  const auto program = ingest::FindProgram("fovea");
  if (!program.ok()) {
    std::fprintf(stderr, "%s\n", std::string(MessageOf(program.status())).c_str());
    return 1;
  }
  std::printf("%lld active voxels in cubes, packed or scattered in %lld^3; least of %lld rounds\n",
              static_cast<long long>(settings.voxels), static_cast<long long>(settings.extent),
              static_cast<long long>(settings.rounds));
  std::printf(
      "| edge | packed s | scattered s | ratio | packed cpu s | scattered cpu s | ratio | "
      "packed MB | scattered MB | ratio |\n");
  for (const int64_t edge : {64, 32, 16, 8}) {
    Compare(settings, *program, edge);
  }
  return 0;
}

}  // namespace
}  // namespace fovea

int main(int argc, char** argv) {
  return fovea::Main(argc, argv);
}
