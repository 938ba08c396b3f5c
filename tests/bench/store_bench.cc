// What a store costs on disk and to read, by chunk edge and by codec:
//   store_bench VOLUME.raw NX NY NZ [FOLDER]
// VOLUME.raw holds NX x NY x NZ voxels, uint8 or float32, x fastest. Stores are written below
// FOLDER (default: the working directory) and removed again. "Cold" reads drop the store's pages
// from the page cache first; the disk's own cache is not emptied.

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <random>
#include <span>
#include <string>
#include <vector>

#include "engine/base/stopwatch.h"
#include "engine/fovea/retained_set.h"
#include "engine/store/blosc.h"
#include "engine/store/codec.h"
#include "engine/store/dataset.h"
#include "engine/store/dataset_writer.h"
#include "engine/store/stored_type.h"
#include "engine/wavelet/transform.h"

namespace fovea::store {
namespace {

namespace fs = std::filesystem;

constexpr int kFoveas = 15;

void Check(const Status& status) {
  if (!status.ok()) {
    std::fprintf(stderr, "store_bench: %s\n", std::string(MessageOf(status)).c_str());
    std::exit(1);
  }
}

template <typename T>
T ValueOf(StatusOr<T> result) {
  Check(result.status());
  return *std::move(result);
}

/// uint8 or float32 voxels, by how long the file is.
std::vector<float> ReadVolume(const std::string& path, const Int3& dims) {
  std::ifstream file(path, std::ios::binary);
  const std::vector<char> bytes{std::istreambuf_iterator<char>(file), {}};
  std::vector<float> values(static_cast<size_t>(dims.Product()));
  if (bytes.size() == values.size() * sizeof(float)) {
    std::memcpy(values.data(), bytes.data(), bytes.size());
  } else if (bytes.size() == values.size()) {
    std::transform(bytes.begin(), bytes.end(), values.begin(),
                   [](char byte) { return static_cast<float>(static_cast<unsigned char>(byte)); });
  } else {
    Check(InvalidArgument("{} has {} bytes: neither 1 nor 4 a voxel", path, bytes.size()));
  }
  return values;
}

struct Volume {
  Int3 dims;
  std::vector<float> values;
  bool is_whole = false;  // all values are whole numbers
};

CoefficientSet Transform(const Volume& volume, int64_t edge, const Basis& basis,
                         FieldStats* stats) {
  BrickGrid voxels(volume.dims, edge, 1, 0.0F);
  voxels.CopyIn(Box3::OfSize(volume.dims), volume.values);
  *stats = ComputeStats(voxels);
  return wavelet::Forward(voxels, ValueOf(Hierarchy::Make(volume.dims)), basis, 0);
}

void DropFromPageCache(const std::string& folder) {
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    const int fd = ::open(entry.path().c_str(), O_RDONLY);
    ::posix_fadvise(fd, 0, 0, POSIX_FADV_DONTNEED);
    ::close(fd);
  }
}

struct Reading {
  double ms = 0;      // wall clock
  double cpu_ms = 0;  // of all threads: what a busy machine changes least
  ReadStats stats;
};

/// Reads what a picture of this fovea needs.
Reading ReadFovea(Dataset* dataset, const Fovea& fovea) {
  const Hierarchy hierarchy = dataset->info().hierarchy;
  const RetainedSet retained = ValueOf(RetainedSet::Make(hierarchy, fovea));
  std::vector<std::vector<float>> values;
  for (int level = 0; level < hierarchy.finest(); ++level) {
    values.emplace_back(static_cast<size_t>(7 * retained.window(level).Volume()));
  }
  std::vector<float> coarse(static_cast<size_t>(hierarchy.DimsAt(0).Product()));
  const Stopwatch watch;
  const std::clock_t cpu = std::clock();
  const auto source = ValueOf(dataset->OpenStep(0, "voxels", OnDamage::kFail));
  Check(source->ReadCoarse(coarse));
  for (int level = 0; level < hierarchy.finest(); ++level) {
    Check(source->ReadDetail(level, retained.window(level), values[static_cast<size_t>(level)]));
  }
  const double cpu_ms = 1e3 * static_cast<double>(std::clock() - cpu) / CLOCKS_PER_SEC;
  return {watch.ElapsedMs(), cpu_ms, source->read_stats()};
}

double Median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + std::ssize(values) / 2, values.end());
  return values[values.size() / 2];
}

void MeasureRate(Dataset* dataset, int64_t edge, double rate) {
  const Int3 dims = dataset->info().hierarchy.dims();
  std::mt19937 random(1);  // the same foveas for every edge
  std::vector<double> cold;
  std::vector<double> warm;
  std::vector<double> cpu;
  std::vector<double> bytes;
  std::vector<double> chunks;
  uint64_t total = 0;
  for (int i = 0; i < kFoveas; ++i) {
    Fovea fovea{{}, rate};
    for (int axis = 0; axis < 3; ++axis) {
      fovea.at[axis] = std::uniform_real_distribution<double>(0.15, 0.85)(random) *
                       static_cast<double>(dims[axis]);
    }
    DropFromPageCache(dataset->path());
    const Reading first = ReadFovea(dataset, fovea);
    cold.push_back(first.ms);
    bytes.push_back(static_cast<double>(first.stats.bytes_read));
    chunks.push_back(static_cast<double>(first.stats.chunks_read));
    total = first.stats.chunks_total;
    const Reading second = ReadFovea(dataset, fovea);
    warm.push_back(second.ms);
    cpu.push_back(second.cpu_ms);
  }
  std::printf("| %2d | %3.0f | %6.0f of %6lu | %8.2f | %7.1f | %7.1f | %7.1f |\n",
              static_cast<int>(edge), rate, Median(chunks), total, Median(bytes) / 1e6,
              Median(cold), Median(warm), Median(cpu));
}

void MeasureEdge(const Volume& volume, const std::string& folder, int64_t edge) {
  FieldStats stats;
  Stopwatch watch;
  const CoefficientSet set = Transform(volume, edge, {}, &stats);
  const double transform_ms = watch.ElapsedMs();
  DatasetInfo info;
  info.hierarchy = set.hierarchy;
  info.chunk_edge = edge;
  info.default_field = "voxels";
  info.fields.push_back({"voxels"});
  const std::string path = fmt::format("{}/store_bench_{}.zarr", folder, edge);
  fs::remove_all(path);
  {
    const auto writer = ValueOf(DatasetWriter::Create(path, info));
    watch.RestartMs();
    Check(writer->WriteField("voxels", set, stats));
    Check(writer->Commit(0, std::nullopt));
  }
  const double write_ms = watch.ElapsedMs();
  uint64_t bytes = 0;
  for (const auto& entry : fs::recursive_directory_iterator(path)) {
    bytes += entry.is_regular_file() ? entry.file_size() : 0;
  }
  std::printf("| %2d | | transformed in %.0f ms, written in %.0f ms: %.2f MB | | | | |\n",
              static_cast<int>(edge), transform_ms, write_ms, static_cast<double>(bytes) / 1e6);
  const auto dataset = ValueOf(Dataset::Open(path));
  for (const double rate : {25.0, 40.0, 70.0, 100.0}) {
    MeasureRate(dataset.get(), edge, rate);
  }
  fs::remove_all(path);
}

/// What is stored of all chunks of a set, as `coding`.
std::vector<std::vector<std::byte>> StoredChunks(const CoefficientSet& set, const Coding& coding) {
  std::vector<std::vector<std::byte>> chunks;
  for (const BrickGrid& level : set.detail) {
    for (const auto& [at, brick] : level.bricks()) {
      chunks.emplace_back(brick.size() * static_cast<size_t>(BytesOfType(coding.type)));
      Check(ToStored(brick, coding, chunks.back()));
      if (coding.is_folded) {
        FoldSigns(chunks.back(), coding.type, chunks.back());
      }
    }
  }
  return chunks;
}

using Coder = std::function<std::vector<std::byte>(std::span<const std::byte>)>;
using Uncoder = std::function<void(std::span<const std::byte>, std::span<std::byte>)>;

/// All chunks through one codec, on one thread.
void MeasureCodec(const char* name, const std::vector<std::vector<std::byte>>& chunks,
                  const Coder& encode, const Uncoder& decode) {
  std::vector<std::vector<std::byte>> encoded;
  double raw_bytes = 0;
  double encoded_bytes = 0;
  Stopwatch watch;
  for (const auto& chunk : chunks) {
    encoded.push_back(encode(chunk));
    raw_bytes += static_cast<double>(chunk.size());
    encoded_bytes += static_cast<double>(encoded.back().size());
  }
  const double encode_ms = watch.RestartMs();
  std::vector<std::byte> decoded(chunks.front().size());
  for (const auto& chunk : encoded) {
    decode(chunk, decoded);
  }
  const double decode_ms = watch.ElapsedMs();
  std::printf("| %-38s | %7.2f | %5.2f | %6.0f | %6.0f |\n", name, encoded_bytes / 1e6,
              raw_bytes / encoded_bytes, raw_bytes / 1e3 / encode_ms, raw_bytes / 1e3 / decode_ms);
}

void MeasureCodecs(const CoefficientSet& set, const Coding& coding) {
  const auto chunks = StoredChunks(set, coding);
  const auto width = static_cast<int>(BytesOfType(coding.type));
  const std::string type = fmt::format("{}, {}{}", WaveletName(set.basis.wavelet), coding.type,
                                       coding.is_folded ? " folded" : "");
  MeasureCodec((type + ", zstd").c_str(), chunks,
               [](std::span<const std::byte> raw) { return ValueOf(Encoder().Encode(raw)); },
               [](std::span<const std::byte> encoded, std::span<std::byte> raw) {
                 Check(Decoder().Decode(encoded, raw));
               });
  const ValueKind kind = IsIntegerType(coding.type) ? ValueKind::kWhole : ValueKind::kFloat;
  BloscEncoder encoder;
  BloscDecoder decoder;
  MeasureCodec((type + ", Blosc").c_str(), chunks,
               [&](std::span<const std::byte> raw) {
                 const auto chunk = ValueOf(encoder.Encode(raw, width, kind));
                 return std::vector<std::byte>(chunk.begin(), chunk.end());
               },
               [&](std::span<const std::byte> encoded, std::span<std::byte> raw) {
                 Check(decoder.Decode(encoded, width, raw));
               });
}

void Run(const Volume& volume, const std::string& folder) {
  std::printf("| edge | rate | chunks read | MB read | cold ms | warm ms | warm CPU ms |\n");
  std::printf("| ---: | ---: | ---: | ---: | ---: | ---: | ---: |\n");
  for (const int64_t edge : {8, 16, 32}) {
    MeasureEdge(volume, folder, edge);
  }
  FieldStats stats;
  std::printf("\n| stored as | MB | ratio | encode MB/s | decode MB/s |\n");
  std::printf("| --- | ---: | ---: | ---: | ---: |\n");
  const CoefficientSet floats = Transform(volume, 16, {}, &stats);
  MeasureCodecs(floats, {});
  for (const Wavelet wavelet : {Wavelet::kHaar, Wavelet::kCdf53}) {
    if (volume.is_whole) {
      const CoefficientSet whole = Transform(volume, 16, {wavelet, true}, &stats);
      MeasureCodecs(whole, {"int16", 1});
      MeasureCodecs(whole, {"int16", 1, true});
      MeasureCodecs(whole, {"int32", 1, true});
    }
  }
}

}  // namespace
}  // namespace fovea::store

int main(int argc, char** argv) {
  if (argc != 5 && argc != 6) {
    std::fprintf(stderr, "usage: store_bench VOLUME.raw NX NY NZ [FOLDER]\n");
    return 2;
  }
  using fovea::store::ReadVolume;
  const fovea::Int3 dims{std::atoi(argv[2]), std::atoi(argv[3]), std::atoi(argv[4])};
  fovea::store::Volume volume{dims, ReadVolume(argv[1], dims)};
  volume.is_whole = std::all_of(volume.values.begin(), volume.values.end(),
                                [](float value) { return value == std::floor(value); });
  fovea::store::Run(volume, argc == 6 ? argv[5] : ".");
  return 0;
}
