// What a long series costs beside a short one:
//   series_bench FOLDER [STEPS] [ROUNDS]
// Makes FOLDER/short/a.zarr with 10 steps and FOLDER/long/a.zarr with STEPS (10,000), 32^3 each,
// unless they are there; then, in turns: opens each and renders a random step; commits a step to
// each; reads the time, number and statistics of steps. Prints medians, and the long series' over
// the short one's. Stores stay, for `fovea stats`, `fovea serve` and the like.

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include "engine/base/stopwatch.h"
#include "engine/store/dataset.h"
#include "engine/store/dataset_writer.h"
#include "engine/wavelet/haar.h"
#include "service/frames/frames.h"
#include "service/server/catalogue.h"

namespace fovea {
namespace {

constexpr Int3 kDims{32, 32, 32};
constexpr int64_t kShort = 10;
const std::string kField = "density";

template <typename T>
T ValueOf(StatusOr<T> result) {
  if (!result.ok()) {
    std::fprintf(stderr, "series_bench: %s\n", std::string(MessageOf(result.status())).c_str());
    std::exit(1);
  }
  return *std::move(result);
}

void Check(const Status& status) {
  ValueOf(status.ok() ? StatusOr<int>(0) : StatusOr<int>(status));
}

struct Step {
  CoefficientSet coefficients;
  FieldStats stats;
};

Step MakeStep() {
  BrickGrid voxels(kDims, 16, 1, 0.0F);
  std::mt19937 random(1);
  std::uniform_real_distribution<float> noise(0, 1);
  std::vector<float> values(static_cast<size_t>(kDims.Product()));
  std::generate(values.begin(), values.end(), [&] { return noise(random); });
  voxels.CopyIn(Box3::OfSize(kDims), values);
  return {wavelet::ForwardHaar(voxels, *Hierarchy::Make(kDims), 1), ComputeStats(voxels)};
}

std::unique_ptr<store::DatasetWriter> OpenWriter(const std::string& path) {
  if (std::filesystem::exists(path)) {
    return ValueOf(store::DatasetWriter::Append(path));
  }
  store::DatasetInfo info;
  info.hierarchy = *Hierarchy::Make(kDims);
  info.default_field = kField;
  info.fields.push_back({kField});
  return ValueOf(store::DatasetWriter::Create(path, info));
}

void Append(store::DatasetWriter* writer, const Step& step) {
  Check(writer->WriteField(kField, step.coefficients, step.stats));
  const int64_t at = writer->info().committed_steps;
  Check(writer->Commit(at * 1'000'000, at));
}

double TimeMs(const std::function<void()>& work) {
  const Stopwatch watch;
  work();
  return watch.ElapsedMs();
}

/// Both in turns; prints their medians.
void Compare(const char* what, int rounds, const std::function<void(int)>& work) {
  std::vector<double> ms[2];
  for (int round = 0; round < rounds; ++round) {
    for (const int which : {0, 1}) {
      ms[which].push_back(TimeMs([&] { work(which); }));
    }
  }
  for (std::vector<double>& all : ms) {
    std::nth_element(all.begin(), all.begin() + std::ssize(all) / 2, all.end());
  }
  const double brief = ms[0][ms[0].size() / 2];
  const double lengthy = ms[1][ms[1].size() / 2];
  std::printf("%-44s %9.3f ms %9.3f ms  ratio %.2f\n", what, brief, lengthy, lengthy / brief);
}

void Run(const std::string& folder, int64_t steps, int rounds) {
  const std::string paths[2] = {fmt::format("{}/short/a.zarr", folder),
                                fmt::format("{}/long/a.zarr", folder)};
  const int64_t counts[2] = {kShort, steps};
  const Step step = MakeStep();
  std::filesystem::create_directories(std::filesystem::path(folder) / "short");
  std::filesystem::create_directories(std::filesystem::path(folder) / "long");
  for (const int which : {0, 1}) {
    const auto writer = OpenWriter(paths[which]);
    const double ms = TimeMs([&] {
      while (writer->info().committed_steps < counts[which]) {
        Append(writer.get(), step);
      }
    });
    std::printf("%s: %ld steps (made in %.1f s)\n", paths[which].c_str(),
                static_cast<long>(writer->info().committed_steps), ms / 1e3);
  }
  std::mt19937_64 random(3);
  const auto any = [&](int which) {
    return static_cast<int64_t>(random() % static_cast<uint64_t>(counts[which]));
  };
  frames::FrameSpec spec;
  spec.width_px = spec.height_px = 64;
  {
    const auto dataset = ValueOf(store::Dataset::Open(paths[0]));
    spec = ValueOf(frames::ResolveSpec(*dataset, spec, ValueOf(frames::DefaultSpec(*dataset))));
  }
  Compare("open, render a random step", rounds, [&](int which) {
    const auto dataset = ValueOf(store::Dataset::Open(paths[which]));
    ValueOf(frames::RenderFrame(*dataset, "s", any(which), spec, 1));
  });
  Compare("the same with the dataset's defaults", rounds, [&](int which) {
    const auto dataset = ValueOf(store::Dataset::Open(paths[which]));
    const auto own =
        ValueOf(frames::ResolveSpec(*dataset, {}, ValueOf(frames::DefaultSpec(*dataset))));
    ValueOf(frames::RenderFrame(*dataset, "s", any(which), own, 1));
  });
  Compare("open, find a step by its time", rounds, [&](int which) {
    const auto dataset = ValueOf(store::Dataset::Open(paths[which]));
    ValueOf(frames::StepAtTime(*dataset, any(which) * 1'000'000));
  });
  Compare("open, statistics of a random step", rounds, [&](int which) {
    const auto dataset = ValueOf(store::Dataset::Open(paths[which]));
    ValueOf(dataset->Stats(any(which), kField));
  });
  Compare("look for datasets, open what is found", std::min(rounds, 20), [&](int which) {
    const std::string root = std::filesystem::path(paths[which]).parent_path();
    ValueOf(server::Catalogue::Open(root, std::chrono::milliseconds(1000)));
  });
  std::unique_ptr<store::DatasetWriter> writers[2];
  Compare("open a writer", 1, [&](int which) { writers[which] = OpenWriter(paths[which]); });
  Compare("commit a step", std::min(rounds, 60),
          [&](int which) { Append(writers[which].get(), step); });
  const auto dataset = ValueOf(store::Dataset::Open(paths[1]));
  const double all_ms = TimeMs([&] {
    for (int64_t at = 0; at < steps; ++at) {
      ValueOf(dataset->TimeNs(at));
      ValueOf(dataset->FrameNumber(at));
      ValueOf(dataset->Stats(at, kField));
    }
  });
  std::printf("%-44s %22.3f ms\n", "time, number, statistics of all of them", all_ms);
}

}  // namespace
}  // namespace fovea

int main(int argc, char** argv) {
  const int64_t steps = argc > 2 ? std::atoll(argv[2]) : 10'000;
  const int rounds = argc > 3 ? std::atoi(argv[3]) : 200;
  if (argc < 2 || argc > 4 || steps < 20 || rounds < 1) {
    std::fprintf(stderr, "usage: series_bench FOLDER [STEPS] [ROUNDS]\n");
    return 2;
  }
  fovea::Run(argv[1], steps, rounds);
  return 0;
}
