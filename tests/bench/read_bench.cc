// Random windows of a store against reading and decompressing the same bytes in order:
//   read_bench [EDGE] [FOLDER]
// Makes stores of EDGE^3 voxels (default 512: waves and noise) below FOLDER (default: the working
// directory), as float32 and as int16 of the reversible Haar transform, reads the windows of random
// foveas at rate 40, and beside each a file with the same chunks one behind another. "Cold": what
// is read was dropped from the page cache before. Processor time is of all threads.

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <functional>
#include <random>
#include <span>
#include <string>
#include <vector>

#include "engine/base/parallel.h"
#include "engine/base/stopwatch.h"
#include "engine/fovea/retained_set.h"
#include "engine/store/chunk_file.h"
#include "engine/store/codec.h"
#include "engine/store/dataset.h"
#include "engine/store/dataset_writer.h"
#include "engine/store/layout.h"
#include "engine/wavelet/transform.h"

namespace fovea::store {
namespace {

namespace fs = std::filesystem;

constexpr int kFoveas = 15;
constexpr double kRate = 40;

void Check(const Status& status) {
  if (!status.ok()) {
    std::fprintf(stderr, "read_bench: %s\n", std::string(MessageOf(status)).c_str());
    std::exit(1);
  }
}

template <typename T>
T ValueOf(StatusOr<T> result) {
  Check(result.status());
  return *std::move(result);
}

/// Waves and noise, from 0 to 255.
BrickGrid MakeVoxels(int64_t edge, bool whole) {
  BrickGrid voxels({edge, edge, edge}, 16, 1, 0.0F);
  std::mt19937 random(1);
  std::normal_distribution<float> noise(0, 2);
  std::vector<float> slice(static_cast<size_t>(edge * edge));
  for (int64_t z = 0; z < edge; ++z) {
    for (int64_t y = 0; y < edge; ++y) {
      for (int64_t x = 0; x < edge; ++x) {
        const auto at = [&](int64_t i) {
          return static_cast<float>(i) * 8 / static_cast<float>(edge);
        };
        const float wave = std::sin(at(x) + at(y) * at(z) / 4) * std::cos(2 * at(y) - at(z));
        const float value = std::clamp(128 + 100 * wave + noise(random), 0.0F, 255.0F);
        slice[static_cast<size_t>(y * edge + x)] = whole ? std::round(value) : value;
      }
    }
    voxels.CopyIn({{0, 0, z}, {edge, edge, z + 1}}, slice);
  }
  return voxels;
}

void MakeStore(const std::string& path, int64_t edge, const std::string& type) {
  const bool whole = type != "float32";
  const BrickGrid voxels = MakeVoxels(edge, whole);
  const CoefficientSet set =
      wavelet::Forward(voxels, ValueOf(Hierarchy::Make(voxels.dims())), {Wavelet::kHaar, whole}, 0);
  DatasetInfo info;
  info.hierarchy = set.hierarchy;
  info.default_field = "voxels";
  info.fields.push_back({"voxels", type});
  fs::remove_all(path);
  const auto writer = ValueOf(DatasetWriter::Create(path, info));
  Check(writer->WriteField("voxels", set, ComputeStats(voxels)));
  Check(writer->Commit(0, std::nullopt));
}

void DropFromPageCache(const std::string& path) {
  const int fd = ::open(path.c_str(), O_RDONLY);
  ::fsync(fd);  // what was not written to the disk yet would stay
  ::posix_fadvise(fd, 0, 0, POSIX_FADV_DONTNEED);
  ::close(fd);
}

void DropStore(const std::string& path) {
  for (const auto& entry : fs::recursive_directory_iterator(path)) {
    if (entry.is_regular_file()) {
      DropFromPageCache(entry.path());
    }
  }
}

struct Times {
  double wall_ms = 0, cpu_ms = 0;
};

Times Measure(const std::function<void()>& work) {
  const Stopwatch watch;
  const std::clock_t cpu = std::clock();
  work();
  return {watch.ElapsedMs(), 1e3 * static_cast<double>(std::clock() - cpu) / CLOCKS_PER_SEC};
}

/// What a picture of this fovea needs; the windows' memory is there already.
void ReadFovea(Dataset* dataset, const RetainedSet& retained,
               std::vector<std::vector<float>>* values) {
  const auto source = ValueOf(dataset->OpenStep(0, "voxels", OnDamage::kFail));
  Check(source->ReadCoarse(values->back()));
  for (int level = 0; level < source->hierarchy().finest(); ++level) {
    Check(source->ReadDetail(level, retained.window(level), (*values)[static_cast<size_t>(level)]));
  }
}

/// The chunks of the windows, one behind another.
struct InOrder {
  std::string path;
  std::vector<size_t> sizes;
  Coding coding;
  size_t chunk_values = 0;
};

InOrder Gather(const Dataset& dataset, const RetainedSet& retained, const std::string& path) {
  InOrder order{path, {}, {}, 0};
  std::ofstream out(path, std::ios::binary);
  const DatasetInfo info = dataset.info();
  FileSystem& files = RealFileSystem();
  for (int level = 0; level < info.hierarchy.finest(); ++level) {
    const LevelLayout layout = LevelLayout::Make(info, info.FieldOf("voxels"), level);
    order.coding = layout.coding;
    order.chunk_values = static_cast<size_t>(layout.ChunkValues());
    for (int64_t z = 0; z < layout.chunks.z; ++z) {
      for (int64_t y = 0; y < layout.chunks.y; ++y) {
        for (int64_t x = 0; x < layout.chunks.x; ++x) {
          const Int3 at{x, y, z};
          if (Intersect(layout.ChunkBox(at), retained.window(level)).IsEmpty()) {
            continue;
          }
          const std::string shard =
              fmt::format("{}/{}/{}", dataset.path(), DetailPath("voxels", layout.width),
                          SpaceChunkName(0, layout.ShardOf(at), true));
          const ReadableFile file = ValueOf(ReadableFile::Open(files, shard));
          const ShardIndex index = ValueOf(
              ReadShardIndex(file, static_cast<size_t>(layout.shard_chunks.Product()), 1 << 24));
          const auto& entry = index[layout.IndexInShard(at)];
          if (entry) {
            std::vector<std::byte> bytes(entry->bytes);
            Check(file.ReadAt(static_cast<int64_t>(entry->offset), bytes));
            out.write(reinterpret_cast<const char*>(bytes.data()), std::ssize(bytes));
            order.sizes.push_back(bytes.size());
          }
        }
      }
    }
  }
  return order;
}

void ReadInOrder(const InOrder& order, std::vector<std::byte>* bytes) {
  const ReadableFile file = ValueOf(ReadableFile::Open(RealFileSystem(), order.path));
  bytes->resize(static_cast<size_t>(file.size()));
  Check(file.ReadAt(0, *bytes));
  std::vector<size_t> starts;
  size_t end = 0;
  for (const size_t size : order.sizes) {
    starts.push_back(end);
    end += size;
  }
  ParallelFor(0, std::ssize(starts), 16, 0, [&](int64_t first, int64_t last) {
    Decoder decoder;
    std::vector<float> values(order.chunk_values);
    for (auto i = static_cast<size_t>(first); i < static_cast<size_t>(last); ++i) {
      Check(decoder.DecodeValues(std::span(*bytes).subspan(starts[i], order.sizes[i]), order.coding,
                                 values));
    }
  });
}

double Median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + std::ssize(values) / 2, values.end());
  return values[values.size() / 2];
}

void MeasureType(const std::string& folder, int64_t edge, const std::string& type) {
  const std::string path = fmt::format("{}/read_bench_{}_{}.zarr", folder, edge, type);
  if (!fs::exists(path)) {
    MakeStore(path, edge, type);
  }
  const auto dataset = ValueOf(Dataset::Open(path));
  const Hierarchy hierarchy = dataset->info().hierarchy;
  std::mt19937 random(1);
  std::vector<double> columns[8];
  for (int i = 0; i < kFoveas; ++i) {
    Fovea fovea{{}, kRate};
    for (int axis = 0; axis < 3; ++axis) {
      fovea.at[axis] = std::uniform_real_distribution<double>(0.1, 0.9)(random) *
                       static_cast<double>(hierarchy.dims()[axis]);
    }
    const RetainedSet retained = ValueOf(RetainedSet::Make(hierarchy, fovea));
    std::vector<std::vector<float>> values;
    for (int level = 0; level < hierarchy.finest(); ++level) {
      values.emplace_back(static_cast<size_t>(7 * retained.window(level).Volume()));
    }
    values.emplace_back(static_cast<size_t>(hierarchy.DimsAt(0).Product()));
    const InOrder order = Gather(*dataset, retained, folder + "/read_bench.order");
    std::vector<std::byte> bytes;
    DropStore(path);
    DropFromPageCache(order.path);
    Times window = Measure([&] { ReadFovea(dataset.get(), retained, &values); });
    Times in_order = Measure([&] { ReadInOrder(order, &bytes); });
    columns[0].push_back(window.wall_ms);
    columns[1].push_back(in_order.wall_ms);
    columns[2].push_back(window.wall_ms / in_order.wall_ms);
    std::vector<double> cpu, wall, cpu0, wall0;
    for (int round = 0; round < 7; ++round) {  // by turns: the machine is shared
      window = Measure([&] { ReadFovea(dataset.get(), retained, &values); });
      in_order = Measure([&] { ReadInOrder(order, &bytes); });
      cpu.push_back(window.cpu_ms);
      wall.push_back(window.wall_ms);
      cpu0.push_back(in_order.cpu_ms);
      wall0.push_back(in_order.wall_ms);
    }
    const auto least = [](const std::vector<double>& v) {
      return *std::min_element(v.begin(), v.end());
    };
    columns[3].push_back(least(wall));
    columns[4].push_back(least(wall) / least(wall0));
    columns[5].push_back(least(cpu));
    columns[6].push_back(least(cpu) / least(cpu0));
    columns[7].push_back(static_cast<double>(order.sizes.size()));
    fs::remove(order.path);
  }
  std::printf("| %s | %3.0f | %6.1f | %6.1f | %5.2f | %6.1f | %5.2f | %6.1f | %5.2f |\n",
              type.c_str(), Median(columns[7]), Median(columns[0]), Median(columns[1]),
              Median(columns[2]), Median(columns[3]), Median(columns[4]), Median(columns[5]),
              Median(columns[6]));
}

}  // namespace
}  // namespace fovea::store

int main(int argc, char** argv) {
  const int64_t edge = argc > 1 ? std::atoi(argv[1]) : 512;
  const std::string folder = argc > 2 ? argv[2] : ".";
  std::printf(
      "| type | chunks | cold ms | in order | ratio | warm ms | ratio | CPU ms | ratio |\n"
      "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |\n");
  for (const char* type : {"float32", "int16"}) {
    fovea::store::MeasureType(folder, edge, type);
  }
  return 0;
}
