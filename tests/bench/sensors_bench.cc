// From a file of readings to committed steps, on one processor: docs/performance.md.
//   taskset -c 0 sensors_bench READINGS.f32 FOLDER...
// makes and removes a store in each FOLDER in turn; one on a disk and one in memory (/dev/shm) show
// what the flushes of a commit cost. Without READINGS.f32 (-), readings are made up.

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include <time.h>

#include "engine/base/stopwatch.h"
#include "ingest/sensors/sensor_ingest.h"

namespace fovea {
namespace {

constexpr int kRounds = 9;

double ProcessorMs() {
  timespec now{};
  ::clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return 1e3 * static_cast<double>(now.tv_sec) + 1e-6 * static_cast<double>(now.tv_nsec);
}

/// Around a sensor in the middle: ever fewer outwards, as a radar sees.
void MakeReadings(const std::string& path, int64_t count) {
  std::mt19937 random(1);
  std::normal_distribution<float> place(0, 60000), height(2000, 1500);
  std::ofstream file(path, std::ios::binary);
  for (int64_t i = 0; i < count; ++i) {
    const float x = place(random), y = place(random);
    const float record[5] = {x, y, height(random), static_cast<float>(i) * 1e-3F, x * 1e-4F};
    file.write(reinterpret_cast<const char*>(record), sizeof(record));
  }
}

struct Best {
  double wall_ms = std::numeric_limits<double>::infinity(), processor_ms = wall_ms;
  ingest::SensorReport report;  // of the fastest round
};

/// One round; false if it failed, which is said.
bool RunOnce(const std::string& readings, const std::string& folder, Best* best) {
  ingest::SensorOptions options;
  options.inputs = {readings};
  options.output = folder + "/sensors_bench.zarr";
  options.format = ingest::ReadingFormat::kRecords;
  options.box.bounds = {Vec3{-200000, -200000, 0}, Vec3{200000, 200000, 16000}};
  options.box.voxel = Vec3{1000, 1000, 250};
  std::filesystem::remove_all(options.output);
  const double before = ProcessorMs();
  const Stopwatch watch;
  const auto report = ingest::IngestSensors(options, nullptr);
  const double wall = watch.ElapsedMs();
  const double processor = ProcessorMs() - before;
  std::filesystem::remove_all(options.output);
  if (!report.ok()) {
    std::fprintf(stderr, "%s\n", std::string(MessageOf(report.status())).c_str());
    return false;
  }
  best->processor_ms = std::min(best->processor_ms, processor);
  if (wall < best->wall_ms) {
    best->wall_ms = wall;
    best->report = *report;
  }
  return true;
}

int Main(const std::vector<std::string>& arguments) {
  if (arguments.size() < 2) {
    std::fprintf(stderr, "usage: sensors_bench READINGS.f32|- FOLDER...\n");
    return 2;
  }
  std::vector<std::string> inputs = {arguments[0]};
  if (arguments[0] == "-") {
    inputs.clear();
    for (const int64_t count : {250'000, 1'000'000, 4'000'000}) {
      inputs.push_back(arguments[1] + "/sensors_bench_" + std::to_string(count) + ".f32");
      MakeReadings(inputs.back(), count);
    }
  }
  std::printf("%-34s %9s %8s %8s %6s %6s %6s %6s %9s %9s\n", "folder, best of 9", "readings",
              "wall", "process", "read", "bin", "fill", "write", "M/s wall", "M/s proc");
  for (const std::string& input : inputs) {
    std::vector<Best> best(arguments.size() - 1);
    for (int round = 0; round < kRounds; ++round) {
      for (size_t i = 0; i < best.size(); ++i) {
        if (!RunOnce(input, arguments[i + 1], &best[i])) {
          return 1;
        }
      }
    }
    for (size_t i = 0; i < best.size(); ++i) {
      const ingest::SensorReport& r = best[i].report;
      const double millions = static_cast<double>(r.counts.read) / 1e3;
      std::printf("%-34s %9lld %8.1f %8.1f %6.1f %6.1f %6.1f %6.1f %9.2f %9.2f\n",
                  arguments[i + 1].c_str(), static_cast<long long>(r.counts.read), best[i].wall_ms,
                  best[i].processor_ms, r.read_ms, r.bin_ms, r.fill_ms, r.write_ms,
                  millions / best[i].wall_ms, millions / best[i].processor_ms);
    }
    if (arguments[0] == "-") {
      std::filesystem::remove(input);
    }
  }
  return 0;
}

}  // namespace
}  // namespace fovea

int main(int argc, char** argv) {
  return fovea::Main(std::vector<std::string>(argv + 1, argv + argc));
}
