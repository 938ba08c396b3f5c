#include "engine/store/dataset.h"

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "engine/fovea/reconstruct.h"
#include "engine/store/dataset_writer.h"
#include "engine/store/read_quote.h"
#include "engine/wavelet/haar.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/engine/store/store_test_util.h"

namespace fovea::store {
namespace {

using ::fovea::testing::FailsWith;
using testing::MakeInfo;
using testing::MakeStep;
using testing::MakeStore;
using testing::StepData;
using testing::TemporaryFolder;
using testing::WholeStep;

struct Shape {
  Int3 dims;
  int64_t edge;
};

class RoundTrip : public ::testing::TestWithParam<Shape> {};

bool SameBits(const std::vector<float>& a, const std::vector<float>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
}

TEST_P(RoundTrip, GivesBackEveryCoefficientBitForBit) {
  const auto [dims, edge] = GetParam();
  TemporaryFolder folder;
  ASSERT_OK(MakeStore(folder.Path("a.zarr"), MakeInfo(dims, edge), 2));
  ASSERT_OK_AND_ASSIGN(const auto dataset, Dataset::Open(folder.Path("a.zarr")));
  for (int step = 0; step < 2; ++step) {
    const StepData data = MakeStep(dims, edge, step);
    MemorySource memory(data.coefficients);
    ASSERT_OK_AND_ASSIGN(const auto source, dataset->OpenStep(step, "density", OnDamage::kFail));
    EXPECT_EQ(source->hierarchy(), data.coefficients.hierarchy);
    std::vector<float> coarse(data.coefficients.coarse.values.size());
    ASSERT_OK(source->ReadCoarse(coarse));
    EXPECT_TRUE(SameBits(coarse, data.coefficients.coarse.values));
    for (int level = 0; level < source->hierarchy().finest(); ++level) {
      ASSERT_OK_AND_ASSIGN(const auto stored, testing::ReadLevel(source.get(), level));
      ASSERT_OK_AND_ASSIGN(const auto wanted, testing::ReadLevel(&memory, level));
      EXPECT_TRUE(SameBits(stored, wanted)) << "level " << level;
    }
    const ReadStats stats = source->read_stats();
    EXPECT_EQ(stats.chunks_read, stats.chunks_total);
    EXPECT_EQ(stats.chunks_damaged, 0U);
  }
}

TEST_P(RoundTrip, GivesBackWindows) {
  const auto [dims, edge] = GetParam();
  TemporaryFolder folder;
  ASSERT_OK(MakeStore(folder.Path("a.zarr"), MakeInfo(dims, edge), 1));
  ASSERT_OK_AND_ASSIGN(const auto dataset, Dataset::Open(folder.Path("a.zarr")));
  ASSERT_OK_AND_ASSIGN(const auto source, dataset->OpenStep(0, "density", OnDamage::kFail));
  const StepData data = MakeStep(dims, edge, 0);
  MemorySource memory(data.coefficients);
  for (int level = 0; level < source->hierarchy().finest(); ++level) {
    const Int3 size = source->hierarchy().DimsAt(level);
    const Box3 windows[] = {
        {{size.x / 3, size.y / 4, 0}, {size.x / 3 + 1, size.y / 4 + 1, 1}},
        {{size.x / 4, size.y / 3, size.z / 2}, {size.x, size.y / 3 + 1, size.z}},
        {{size.x / 2, 0, size.z / 4}, {size.x - size.x / 4, size.y, size.z}},
    };
    for (const Box3& window : windows) {
      std::vector<float> stored(static_cast<size_t>(7 * window.Volume()), -1.0F);
      std::vector<float> wanted(stored.size(), -2.0F);
      ASSERT_OK(source->ReadDetail(level, window, stored));
      ASSERT_OK(memory.ReadDetail(level, window, wanted));
      EXPECT_TRUE(SameBits(stored, wanted)) << "level " << level;
    }
  }
}

TEST_P(RoundTrip, AQuoteIsWhatReadingThenCosts) {
  const auto [dims, edge] = GetParam();
  TemporaryFolder folder;
  ASSERT_OK(MakeStore(folder.Path("a.zarr"), MakeInfo(dims, edge), 1));
  ASSERT_OK_AND_ASSIGN(const auto dataset, Dataset::Open(folder.Path("a.zarr")));
  const Vec3 at{static_cast<double>(dims.x) / 3, static_cast<double>(dims.y),
                static_cast<double>(dims.z) / 2};
  for (const double rate : {1.0, 7.0, 20.0, 500.0}) {
    ASSERT_OK_AND_ASSIGN(const RetainedSet retained,
                         RetainedSet::Make(dataset->info().hierarchy, {at, rate}));
    ASSERT_OK_AND_ASSIGN(const ReadStats quote,
                         QuoteRead(*dataset, 0, "density", OnDamage::kFail, retained));
    ASSERT_OK_AND_ASSIGN(const auto source, dataset->OpenStep(0, "density", OnDamage::kFail));
    ASSERT_OK(Reconstruct(*source, retained, 1));
    const ReadStats read = source->read_stats();
    EXPECT_EQ(quote.chunks_read, read.chunks_read) << rate;
    EXPECT_EQ(quote.chunks_total, read.chunks_total);
    EXPECT_EQ(quote.bytes_read, read.bytes_read);
  }
}

std::string NameOf(const ::testing::TestParamInfo<Shape>& shape) {
  const Int3& dims = shape.param.dims;
  return fmt::format("{}x{}x{}_by_{}", dims.x, dims.y, dims.z, shape.param.edge);
}

INSTANTIATE_TEST_SUITE_P(Shapes, RoundTrip,
                         ::testing::Values(Shape{{64, 64, 64}, 16}, Shape{{37, 50, 81}, 8},
                                           Shape{{103, 30, 61}, 16}, Shape{{70, 45, 33}, 32},
                                           Shape{{17, 1, 1}, 8}, Shape{{1, 3, 200}, 16},
                                           Shape{{16, 16, 16}, 16}, Shape{{5, 1, 9}, 8},
                                           Shape{{150, 9, 11}, 8}),
                         NameOf);

TEST(Dataset, KeepsWhatItIsToldAboutTheData) {
  TemporaryFolder folder;
  DatasetInfo info = MakeInfo({20, 30, 40}, 8, {"temperature", "density"});
  ASSERT_OK(MakeStore(folder.Path("a.zarr"), info, 3));
  ASSERT_OK_AND_ASSIGN(const auto dataset, Dataset::Open(folder.Path("a.zarr/")));
  EXPECT_EQ(dataset->path(), folder.Path("a.zarr"));
  const DatasetInfo read = dataset->info();
  EXPECT_EQ(read.hierarchy, info.hierarchy);
  EXPECT_EQ(read.origin, info.origin);
  EXPECT_EQ(read.index_to_world, info.index_to_world);
  EXPECT_EQ(read.world_unit, "mm");
  EXPECT_EQ(read.clock, info.clock);
  EXPECT_TRUE(read.retention.empty());
  EXPECT_EQ(read.wavelet, "haar");
  EXPECT_EQ(read.default_field, "temperature");
  EXPECT_EQ(read.chunk_edge, 8);
  EXPECT_EQ(read.committed_steps, 3);
  ASSERT_EQ(read.fields.size(), 2U);
  EXPECT_EQ(read.fields[0].name, "density");  // by name
  EXPECT_EQ(read.fields[1].name, "temperature");
  double least = 0;
  double most = 0;
  for (int step = 0; step < 3; ++step) {
    const StepData data = MakeStep({20, 30, 40}, 8, step);
    ASSERT_OK_AND_ASSIGN(const FieldStats stats, dataset->Stats(step, "density"));
    EXPECT_EQ(stats.minimum, data.stats.minimum);
    EXPECT_EQ(stats.maximum, data.stats.maximum);
    EXPECT_EQ(stats.histogram, data.stats.histogram);
    least = std::min(least, stats.minimum);
    most = std::max(most, stats.maximum);
    ASSERT_OK_AND_ASSIGN(const int64_t time, dataset->TimeNs(step));
    EXPECT_EQ(time, int64_t{step} * 1'000'000'000);
    ASSERT_OK_AND_ASSIGN(const auto number, dataset->FrameNumber(step));
    EXPECT_EQ(number, step % 2 == 0 ? std::optional<int64_t>(100 + step) : std::nullopt);
  }
  EXPECT_EQ(read.fields[0].minimum, least);
  EXPECT_EQ(read.fields[0].maximum, most);
}

std::string TextOf(const std::string& path) {
  std::ifstream file(path);
  return {std::istreambuf_iterator<char>(file), {}};
}

/// Stores of format version 1 hold whole numbers as they are; they are read, and appended to so.
TEST(Dataset, ReadsAndAppendsToStoresOfTheFirstFormat) {
  TemporaryFolder folder;
  const Int3 dims{37, 50, 81};
  const StepData data = WholeStep(dims, 8, 0);
  MemorySource memory(data.coefficients);
  for (const int version : {1, kFormatVersion}) {
    DatasetInfo info = MakeInfo(dims, 8);
    info.format_version = version;
    info.fields[0].type = "int16";
    const std::string path = folder.Path(fmt::format("v{}.zarr", version));
    for (int step = 0; step < 2; ++step) {
      ASSERT_OK_AND_ASSIGN(const auto writer, step == 0 ? DatasetWriter::Create(path, info)
                                                        : DatasetWriter::Append(path));
      ASSERT_OK(writer->WriteField("density", data.coefficients, data.stats));
      ASSERT_OK(writer->Commit(step, std::nullopt));
    }
    ASSERT_OK_AND_ASSIGN(const auto dataset, Dataset::Open(path));
    EXPECT_EQ(dataset->info().format_version, version);
    const std::string type = version == 1 ? "\"int16\"" : "\"uint16\"";
    for (const std::string array : {"coarse", "detail_2"}) {
      EXPECT_THAT(TextOf(path + "/density/" + array + "/zarr.json"),
                  ::testing::HasSubstr("\"data_type\": " + type));
    }
    for (int step = 0; step < 2; ++step) {
      ASSERT_OK_AND_ASSIGN(const auto source, dataset->OpenStep(step, "density", OnDamage::kFail));
      std::vector<float> coarse(data.coefficients.coarse.values.size());
      ASSERT_OK(source->ReadCoarse(coarse));
      EXPECT_EQ(coarse, data.coefficients.coarse.values);
      for (int level = 0; level < source->hierarchy().finest(); ++level) {
        ASSERT_OK_AND_ASSIGN(const auto stored, testing::ReadLevel(source.get(), level));
        ASSERT_OK_AND_ASSIGN(const auto wanted, testing::ReadLevel(&memory, level));
        EXPECT_EQ(stored, wanted) << "version " << version << ", level " << level;
      }
    }
  }
}

TEST(Dataset, ReadsOnlyTheChunksOfTheWindow) {
  TemporaryFolder folder;
  const Int3 dims{256, 128, 128};
  DatasetInfo info = MakeInfo(dims, 8);
  // Noise everywhere, so that every chunk is stored.
  BrickGrid voxels(dims, 8, 1, 0.0F);
  std::vector<float> row(256);
  for (int64_t z = 0; z < dims.z; ++z) {
    for (int64_t y = 0; y < dims.y; ++y) {
      for (size_t x = 0; x < row.size(); ++x) {
        row[x] = static_cast<float>((x * 7 + static_cast<size_t>(y * 13 + z * 29)) % 31);
      }
      voxels.CopyIn({{0, y, z}, {256, y + 1, z + 1}}, row);
    }
  }
  const CoefficientSet set = wavelet::ForwardHaar(voxels, info.hierarchy, 1);
  ASSERT_OK_AND_ASSIGN(const auto writer, DatasetWriter::Create(folder.Path("a.zarr"), info));
  ASSERT_OK(writer->WriteField("density", set, ComputeStats(voxels)));
  ASSERT_OK(writer->Commit(0, std::nullopt));
  ASSERT_OK_AND_ASSIGN(const auto dataset, Dataset::Open(folder.Path("a.zarr")));
  ASSERT_OK_AND_ASSIGN(const auto source, dataset->OpenStep(0, "density", OnDamage::kFail));
  // The finest level has 128 x 64 x 64 coefficients: 16 x 8 x 8 chunks of 8 in 2 shards.
  const Box3 window{{60, 9, 10}, {70, 23, 16}};  // chunks 7..8 x 1..2 x 1..1, in both shards
  std::vector<float> values(static_cast<size_t>(7 * window.Volume()));
  ASSERT_OK(source->ReadDetail(info.hierarchy.finest() - 1, window, values));
  const ReadStats stats = source->read_stats();
  EXPECT_EQ(stats.chunks_read, 4U);
  EXPECT_EQ(stats.chunks_total, 1024U + 128 + 16 + 2 + 1);
  uint64_t all_bytes = 0;
  for (const std::string& file : testing::FilesBelow(folder.Path("a.zarr/density"))) {
    all_bytes += std::filesystem::file_size(file);
  }
  EXPECT_LT(stats.bytes_read, all_bytes / 10);
  // Shards that the window does not meet are not even opened.
  std::filesystem::remove(folder.Path("a.zarr/density/detail_2/c.0.0.0.0.1"));
  const Box3 left{{0, 0, 0}, {64, 64, 64}};
  values.resize(static_cast<size_t>(7 * left.Volume()));
  EXPECT_OK(source->ReadDetail(info.hierarchy.finest() - 1, left, values));
}

TEST(Dataset, DoesNotStoreChunksOfZeros) {
  TemporaryFolder folder;
  const Int3 dims{200, 200, 200};
  const DatasetInfo info = MakeInfo(dims, 8);
  BrickGrid voxels(dims, 8, 1, 0.0F);
  voxels.CopyIn({{150, 20, 21}, {151, 21, 22}}, std::vector<float>{3});
  CoefficientSet set = wavelet::ForwardHaar(voxels, info.hierarchy, 1);
  // Past the border lies rubbish that must neither be stored nor make a chunk of zeros be stored:
  // the finest level has 100 coefficients a side, 13 chunks.
  BrickGrid::Brick& corner = set.detail.back().Touch({12, 12, 12});
  corner.back() = 7;
  ASSERT_OK_AND_ASSIGN(const auto writer, DatasetWriter::Create(folder.Path("a.zarr"), info));
  ASSERT_OK(writer->WriteField("density", set, ComputeStats(voxels)));
  ASSERT_OK(writer->Commit(0, std::nullopt));
  ASSERT_OK_AND_ASSIGN(const auto dataset, Dataset::Open(folder.Path("a.zarr")));
  ASSERT_OK_AND_ASSIGN(const auto source, dataset->OpenStep(0, "density", OnDamage::kFail));
  EXPECT_EQ(source->read_stats().chunks_total, 1U + 4);
  for (int level = 0; level < info.hierarchy.finest(); ++level) {
    ASSERT_OK(testing::ReadLevel(source.get(), level).status());
  }
  EXPECT_EQ(source->read_stats().chunks_read, 4U);
  const auto files = testing::FilesBelow(folder.Path("a.zarr/density/detail_2"));
  EXPECT_EQ(files.size(), 2U);  // one shard and zarr.json
}

TEST(Dataset, SaysWhatIsWrongWithARequest) {
  TemporaryFolder folder;
  ASSERT_OK(MakeStore(folder.Path("a.zarr"), MakeInfo({20, 20, 20}, 8), 2));
  ASSERT_OK_AND_ASSIGN(const auto dataset, Dataset::Open(folder.Path("a.zarr")));
  const auto out_of_range = absl::StatusCode::kOutOfRange;
  EXPECT_THAT(dataset->TimeNs(2), FailsWith(out_of_range, "step 2 is outside 0 to 1"));
  EXPECT_THAT(dataset->FrameNumber(-1), FailsWith(out_of_range, "step -1"));
  EXPECT_THAT(dataset->Stats(5, "density"), FailsWith(out_of_range, "step 5"));
  EXPECT_THAT(dataset->OpenStep(2, "density", OnDamage::kFail), FailsWith(out_of_range, "step 2"));
  EXPECT_THAT(dataset->OpenStep(0, "smoke", OnDamage::kFail),
              FailsWith(absl::StatusCode::kNotFound, "it has density"));
  EXPECT_THAT(dataset->Stats(0, "../density"), FailsWith(absl::StatusCode::kNotFound, "no field"));
  EXPECT_THAT(Dataset::Open(folder.Path("b.zarr")),
              FailsWith(absl::StatusCode::kNotFound, "no store at"));
  EXPECT_THAT(Dataset::Open(folder.Path("")),
              FailsWith(absl::StatusCode::kFailedPrecondition, "not a Fovea store"));
  EXPECT_THAT(Dataset::Open("/"), FailsWith(absl::StatusCode::kInvalidArgument, "path"));
}

TEST(Dataset, SeesNewStepsWhenRefreshed) {
  TemporaryFolder folder;
  ASSERT_OK_AND_ASSIGN(const auto writer,
                       DatasetWriter::Create(folder.Path("a.zarr"), MakeInfo({20, 20, 20}, 8)));
  ASSERT_OK_AND_ASSIGN(const auto dataset, Dataset::Open(folder.Path("a.zarr")));
  EXPECT_EQ(dataset->info().committed_steps, 0);
  EXPECT_THAT(dataset->TimeNs(0), FailsWith(absl::StatusCode::kOutOfRange, "no steps yet"));
  ASSERT_OK(testing::WriteSteps(writer.get(), 2));
  EXPECT_EQ(dataset->info().committed_steps, 0);
  EXPECT_THAT(dataset->TimeNs(0), FailsWith(absl::StatusCode::kOutOfRange, "no steps yet"));
  ASSERT_OK(dataset->Refresh());
  EXPECT_EQ(dataset->info().committed_steps, 2);
  ASSERT_OK_AND_ASSIGN(const auto source, dataset->OpenStep(1, "density", OnDamage::kFail));
  EXPECT_OK(testing::ReadEverything(source.get()));
}

TEST(Dataset, IsReadByManyThreadsWhileItGrows) {
  TemporaryFolder folder;
  const Int3 dims{90, 70, 80};
  ASSERT_OK_AND_ASSIGN(const auto writer,
                       DatasetWriter::Create(folder.Path("a.zarr"), MakeInfo(dims, 8)));
  ASSERT_OK(testing::WriteSteps(writer.get(), 1));
  ASSERT_OK_AND_ASSIGN(const auto dataset, Dataset::Open(folder.Path("a.zarr")));
  ASSERT_OK_AND_ASSIGN(const auto source, dataset->OpenStep(0, "density", OnDamage::kFail));
  const StepData data = MakeStep(dims, 8, 0);
  MemorySource memory(data.coefficients);
  ASSERT_OK_AND_ASSIGN(const auto wanted, testing::ReadLevel(&memory, 2));
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i) {
    threads.emplace_back([&] {
      for (int round = 0; round < 3; ++round) {
        EXPECT_OK(dataset->Refresh());
        EXPECT_GE(dataset->info().committed_steps, 1);
        const auto read = testing::ReadLevel(source.get(), 2);
        ASSERT_OK(read);
        EXPECT_TRUE(SameBits(*read, wanted));
        EXPECT_GT(source->read_stats().chunks_total, 1U);
      }
    });
  }
  EXPECT_OK(testing::WriteSteps(writer.get(), 2));
  for (std::thread& thread : threads) {
    thread.join();
  }
}

}  // namespace
}  // namespace fovea::store
