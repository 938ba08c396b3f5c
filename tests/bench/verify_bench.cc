// What verifying a dataset costs beside reading it:
//   verify_bench DS.zarr [ROUNDS]
// In turns: Verify on one thread and on all; every coefficient of every step read by a StepSource
// (on all threads); every byte of every file read, nothing decoded. Prints minima. The store should
// be in the page cache.

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "engine/base/stopwatch.h"
#include "engine/store/dataset.h"
#include "engine/store/file.h"
#include "engine/store/verify.h"

namespace fovea::store {
namespace {

template <typename T>
T ValueOf(StatusOr<T> result) {
  if (!result.ok()) {
    std::fprintf(stderr, "verify_bench: %s\n", std::string(MessageOf(result.status())).c_str());
    std::exit(1);
  }
  return *std::move(result);
}

void ReadAll(const std::string& path) {
  const auto dataset = ValueOf(Dataset::Open(path));
  const DatasetInfo info = dataset->info();
  std::vector<float> values;
  for (int64_t step = 0; step < info.committed_steps; ++step) {
    for (const FieldInfo& field : info.fields) {
      const auto source = ValueOf(dataset->OpenStep(step, field.name, OnDamage::kFail));
      values.resize(static_cast<size_t>(info.hierarchy.DimsAt(0).Product()));
      ValueOf(source->ReadCoarse(values).ok() ? StatusOr<int>(0) : DataLoss("coarse"));
      for (int level = 0; level < info.hierarchy.finest(); ++level) {
        const Box3 box = Box3::OfSize(info.hierarchy.DimsAt(level));
        values.resize(static_cast<size_t>(7 * box.Volume()));
        ValueOf(source->ReadDetail(level, box, values).ok() ? StatusOr<int>(0)
                                                            : DataLoss("detail"));
      }
    }
  }
}

void ReadBytes(const std::string& path) {
  for (const auto& entry : std::filesystem::recursive_directory_iterator(path)) {
    if (entry.is_regular_file()) {
      ValueOf(ReadWholeFile(RealFileSystem(), entry.path().string(), int64_t{1} << 40));
    }
  }
}

void Run(const std::string& path, int rounds) {
  const std::pair<const char*, std::function<void()>> works[] = {
      {"verify, one thread", [&] { ValueOf(Verify(path, 1)); }},
      {"verify, all threads", [&] { ValueOf(Verify(path, 0)); }},
      {"every coefficient through StepSource", [&] { ReadAll(path); }},
      {"every byte of every file", [&] { ReadBytes(path); }}};
  std::vector<double> least(std::size(works), 1e300);
  for (int round = 0; round < rounds; ++round) {
    for (size_t i = 0; i < std::size(works); ++i) {
      const Stopwatch watch;
      works[i].second();
      least[i] = std::min(least[i], watch.ElapsedMs());
    }
  }
  for (size_t i = 0; i < std::size(works); ++i) {
    std::printf("%-40s %10.1f ms\n", works[i].first, least[i]);
  }
  const VerifyReport report = ValueOf(Verify(path, 0));
  std::printf("%lu chunks, %.1f MB, %zu problems\n", static_cast<unsigned long>(report.chunks),
              static_cast<double>(report.bytes) / 1e6, report.problems.size());
}

}  // namespace
}  // namespace fovea::store

int main(int argc, char** argv) {
  const int rounds = argc > 2 ? std::atoi(argv[2]) : 5;
  if (argc < 2 || argc > 3 || rounds < 1) {
    std::fprintf(stderr, "usage: verify_bench DS.zarr [ROUNDS]\n");
    return 2;
  }
  fovea::store::Run(argv[1], rounds);
  return 0;
}
