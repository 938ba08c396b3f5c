#include <sys/stat.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <limits>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "engine/store/codec.h"
#include "engine/store/dataset.h"
#include "engine/store/dataset_writer.h"
#include "engine/store/verify.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/engine/store/store_test_util.h"

namespace fovea::store {
namespace {

namespace fs = std::filesystem;
using ::fovea::testing::FailsWith;
using nlohmann::json;
using testing::FlipByte;
using testing::MakeInfo;
using testing::TemporaryFolder;

constexpr auto kDataLoss = absl::StatusCode::kDataLoss;
constexpr auto kPrecondition = absl::StatusCode::kFailedPrecondition;

std::string ReadText(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

void WriteBytes(const std::string& path, std::string_view text) {
  std::ofstream(path, std::ios::binary | std::ios::trunc) << text;
}

/// Opens the store and reads all there is to read.
Status ReadAll(const std::string& path) {
  FOVEA_ASSIGN_OR_RETURN(const auto dataset, Dataset::Open(path));
  const DatasetInfo info = dataset->info();
  for (int64_t step = 0; step < info.committed_steps; ++step) {
    FOVEA_RETURN_IF_ERROR(dataset->TimeNs(step).status());
    FOVEA_RETURN_IF_ERROR(dataset->FrameNumber(step).status());
    for (const FieldInfo& field : info.fields) {
      FOVEA_RETURN_IF_ERROR(dataset->Stats(step, field.name).status());
      FOVEA_ASSIGN_OR_RETURN(const auto source,
                             dataset->OpenStep(step, field.name, OnDamage::kFail));
      FOVEA_RETURN_IF_ERROR(testing::ReadEverything(source.get()));
    }
  }
  return absl::OkStatus();
}

class DamagedStore : public ::testing::Test {
 protected:
  void SetUp() override {
    ASSERT_OK(testing::MakeStore(path_, MakeInfo({45, 38, 70}, 8), 2));
    ASSERT_OK(ReadAll(path_));
  }
  [[nodiscard]] std::string File(const std::string& name) const { return path_ + "/" + name; }
  void ExpectProblem(const std::string& text) {
    ASSERT_OK_AND_ASSIGN(const VerifyReport report, Verify(path_, 2));
    EXPECT_THAT(report.problems, ::testing::Contains(::testing::HasSubstr(text)));
  }

  TemporaryFolder folder_;
  const std::string path_ = folder_.Path("a.zarr");
};

TEST_F(DamagedStore, AFlippedByteInAnyFileIsFoundByVerifyAndByReads) {
  for (const std::string& file : testing::FilesBelow(path_)) {
    const auto size = static_cast<int64_t>(fs::file_size(file));
    for (const int64_t offset : {int64_t{0}, size / 3, size / 2, size - 1}) {
      FlipByte(file, offset);
      const StatusOr<VerifyReport> report = Verify(path_, 2);
      EXPECT_TRUE(!report.ok() || !report->problems.empty()) << file << " at " << offset;
      const Status read = ReadAll(path_);
      EXPECT_TRUE(absl::IsDataLoss(read) || absl::IsFailedPrecondition(read))
          << file << " at " << offset << ": " << MessageOf(read);
      EXPECT_NE(MessageOf(read).find(path_), std::string_view::npos) << MessageOf(read);
      FlipByte(file, offset);
    }
  }
  EXPECT_OK(ReadAll(path_));
}

TEST_F(DamagedStore, AMissingFileIsFoundByVerifyAndByReads) {
  for (const std::string& file : testing::FilesBelow(path_)) {
    const bool table = file.find("/chunk_max_") != std::string::npos && !file.ends_with(".json");
    fs::rename(file, folder_.Path("aside"));
    const StatusOr<VerifyReport> report = Verify(path_, 2);
    EXPECT_TRUE(!report.ok() || !report->problems.empty()) << file;
    // The chunks are all there without their table.
    EXPECT_EQ(ReadAll(path_).ok(), table) << file;
    fs::rename(folder_.Path("aside"), file);
  }
}

TEST_F(DamagedStore, ACutFileIsFoundByVerifyAndByReads) {
  for (const std::string& file : testing::FilesBelow(path_)) {
    const std::string whole = ReadText(file);
    for (const size_t size : {size_t{0}, size_t{3}, whole.size() / 2, whole.size() - 2}) {
      fs::resize_file(file, size);
      const StatusOr<VerifyReport> report = Verify(path_, 2);
      EXPECT_TRUE(!report.ok() || !report->problems.empty()) << file << " cut to " << size;
      EXPECT_FALSE(ReadAll(path_).ok()) << file << " cut to " << size;
    }
    WriteBytes(file, whole);
  }
}

TEST_F(DamagedStore, NoFlippedByteOfMetadataChangesWhatIsRead) {
  ASSERT_OK_AND_ASSIGN(const auto sound, Dataset::Open(path_));
  for (const char* name : {"zarr.json", "density/detail_4/zarr.json"}) {
    const auto size = static_cast<int64_t>(fs::file_size(File(name)));
    for (int64_t offset = 0; offset < size; ++offset) {
      for (const int mask : {1, 0x20}) {
        FlipByte(File(name), offset, mask);
        const auto dataset = Dataset::Open(path_);
        if (dataset.ok()) {
          const DatasetInfo info = (*dataset)->info();
          EXPECT_EQ(info.committed_steps, 2);
          EXPECT_EQ(info.index_to_world, sound->info().index_to_world);
          EXPECT_EQ(info.fields, sound->info().fields);
          EXPECT_EQ(info.clock, sound->info().clock);
        }
        FlipByte(File(name), offset, mask);
      }
    }
  }
}

TEST_F(DamagedStore, ErrorsNameFieldStepArrayAndChunk) {
  const std::string shard = File("density/detail_2/c.1.0.0.0.0");
  FlipByte(shard, 40);  // in its first chunk
  EXPECT_THAT(ReadAll(path_), FailsWith(kDataLoss, "of detail_2 of field 'density', step 1"));
  EXPECT_THAT(ReadAll(path_), FailsWith(kDataLoss, "chunk 0,0,0 (x, y, z)"));
  EXPECT_THAT(ReadAll(path_), FailsWith(kDataLoss, shard));
  ExpectProblem(shard + ": chunk 0,0,0 (x, y, z): checksum");
  FlipByte(shard, 40);
  FlipByte(shard, -1);
  EXPECT_THAT(ReadAll(path_), FailsWith(kDataLoss, "its index: checksum"));
  FlipByte(shard, -1);
  FlipByte(File("density/coarse/c.1.0.0.0"), 10);
  EXPECT_THAT(ReadAll(path_), FailsWith(kDataLoss, "coarse level of field 'density', step 1"));
}

/// Reads all of level `level` of step 1 with kCount: values and statistics.
void ReadCounting(const std::string& path, int level, std::vector<float>* values,
                  ReadStats* stats) {
  ASSERT_OK_AND_ASSIGN(const auto dataset, Dataset::Open(path));
  ASSERT_OK_AND_ASSIGN(const auto source, dataset->OpenStep(1, "density", OnDamage::kCount));
  ASSERT_OK_AND_ASSIGN(*values, testing::ReadLevel(source.get(), level));
  *stats = source->read_stats();
}

TEST_F(DamagedStore, DamagedChunksAreReadAsZerosAndCountedIfWanted) {
  std::vector<float> sound;
  std::vector<float> damaged;
  ReadStats before;
  ReadStats after;
  const std::string shard = File("density/detail_2/c.1.0.0.0.0");
  ReadCounting(path_, 2, &sound, &before);
  EXPECT_EQ(before.chunks_damaged, 0U);
  FlipByte(shard, 40);
  ReadCounting(path_, 2, &damaged, &after);
  EXPECT_EQ(after.chunks_damaged, 1U);
  EXPECT_EQ(after.chunks_read, before.chunks_read - 1);
  size_t changed = 0;
  for (size_t i = 0; i < sound.size(); ++i) {
    if (sound[i] != damaged[i]) {
      ++changed;
      EXPECT_EQ(damaged[i], 0.0F);
    }
  }
  EXPECT_GT(changed, 0U);
  EXPECT_LE(changed, 7U * 8 * 8 * 8);
  FlipByte(shard, -1);  // the index: all of its chunks
  ReadCounting(path_, 2, &damaged, &after);
  EXPECT_EQ(after.chunks_damaged, before.chunks_read);
  EXPECT_THAT(damaged, ::testing::Each(0.0F));
  fs::remove(shard);
  ReadCounting(path_, 2, &damaged, &after);
  EXPECT_EQ(after.chunks_damaged, before.chunks_read);
}

TEST_F(DamagedStore, ADamagedTableCostsNoChunkIfDamageIsCounted) {
  std::vector<float> sound;
  std::vector<float> damaged;
  ReadStats stats;
  ReadCounting(path_, 2, &sound, &stats);
  FlipByte(File("density/chunk_max_2/c.1.0.0.0"), 10);
  ReadCounting(path_, 2, &damaged, &stats);
  EXPECT_EQ(stats.chunks_damaged, 1U);
  EXPECT_EQ(sound, damaged);
}

TEST_F(DamagedStore, AnIndexThatPointsOutsideItsFileIsRefused) {
  const std::string shard = File("density/detail_2/c.1.0.0.0.0");
  const std::string whole = ReadText(shard);
  constexpr size_t kChunks = 3 * 3 * 5;  // detail_2 has 23 x 19 x 35 coefficients
  const size_t index = whole.size() - kChunks * 16 - 4;
  const uint64_t huge = std::numeric_limits<uint64_t>::max();
  for (const auto& [offset, bytes] : {std::pair<uint64_t, uint64_t>{huge, 1},
                                      {0, huge},
                                      {huge - 3, 10},
                                      {0, whole.size()},
                                      {index, 1},
                                      {uint64_t{1} << 63, uint64_t{1} << 63}}) {
    std::string changed = whole;
    std::memcpy(changed.data() + index + 16, &offset, 8);
    std::memcpy(changed.data() + index + 24, &bytes, 8);
    const auto content = std::as_bytes(std::span(changed)).subspan(index, kChunks * 16);
    const uint32_t crc = Crc32c(content);
    std::memcpy(changed.data() + index + kChunks * 16, &crc, 4);
    WriteBytes(shard, changed);
    EXPECT_THAT(ReadAll(path_), FailsWith(kDataLoss, "its index says"));
    ExpectProblem("its index says that chunk 1");
  }
}

TEST_F(DamagedStore, VerifyFindsAStoredChunkThatNobodyKnowsOf) {
  fs::copy_file(File("density/detail_2/c.1.0.0.0.0"), File("density/detail_2/c.1.0.0.0.7"));
  ExpectProblem("c.1.0.0.0.7 lies outside its array");
  fs::remove(File("density/detail_2/c.1.0.0.0.7"));
  fs::copy_file(File("density/chunk_max_2/c.0.0.0.0"), File("density/chunk_max_2/c.1.0.0.0"),
                fs::copy_options::overwrite_existing);
  ExpectProblem("chunk_max_2 says");
}

/// Rewrites the fovea attributes with a right checksum.
void EditAttributes(const std::string& path, const std::function<void(json&)>& edit) {
  json group = json::parse(ReadText(path));
  json& attributes = group["attributes"]["fovea"];
  attributes.erase("crc32c");
  edit(attributes);
  const std::string text = attributes.dump();
  attributes["crc32c"] = fmt::format("{:08x}", Crc32c(std::as_bytes(std::span(text))));
  WriteBytes(path, group.dump());
}

TEST_F(DamagedStore, AttributesThatCannotBeAreRefused) {
  const std::string file = File("zarr.json");
  const std::string sound = ReadText(file);
  const auto expect = [&](absl::StatusCode code, const std::string& key, const json& value) {
    WriteBytes(file, sound);
    EditAttributes(file, [&](json& attributes) { attributes[json::json_pointer(key)] = value; });
    EXPECT_THAT(Dataset::Open(path_), FailsWith(code, file)) << key << " " << value;
    EXPECT_FALSE(Verify(path_, 1).ok());
    EXPECT_FALSE(DatasetWriter::Append(path_).ok());
  };
  expect(kPrecondition, "/format_version", kFormatVersion + 1);
  expect(kDataLoss, "/format_version", 0);
  expect(kDataLoss, "/dims_xyz/0", 0);
  expect(kDataLoss, "/dims_xyz/1", 65537);
  expect(kDataLoss, "/dims_xyz/2", 1e300);
  expect(kDataLoss, "/dims_xyz", {1, 2});
  expect(kDataLoss, "/dims_xyz", "45x38x70");
  expect(kDataLoss, "/origin_xyz/0", std::numeric_limits<uint64_t>::max() - 5);
  expect(kDataLoss, "/committed_steps", -1);
  expect(kDataLoss, "/committed_steps", 2'000'000'000);
  expect(kDataLoss, "/committed_steps", nullptr);
  expect(kDataLoss, "/chunk_edge", 64);
  expect(kPrecondition, "/chunk_edge", 12);
  expect(kPrecondition, "/index_to_world", json::array({1, 2, 3}));
  expect(kPrecondition, "/index_to_world/0", 0.0);
  expect(kDataLoss, "/index_to_world/0", "one");
  expect(kPrecondition, "/time_unit", "s");
  expect(kPrecondition, "/wavelet", "db4");
  expect(kPrecondition, "/default_field", "smoke");
  expect(kPrecondition, "/fields", json::object());
  expect(kDataLoss, "/fields", 3);
  expect(kPrecondition, "/fields/..~1..~1x", {{"type", "float32"}, {"minimum", 0}, {"maximum", 1}});
  expect(kDataLoss, "/fields/density/minimum", nullptr);
  expect(kPrecondition, "/fields/density/minimum", 1e9);
}

TEST_F(DamagedStore, AttributesThatTheArraysContradictAreRefused) {
  const std::string sound = ReadText(File("zarr.json"));
  EditAttributes(File("zarr.json"), [](json& fovea) { fovea["committed_steps"] = 999'999'999; });
  EXPECT_THAT(Dataset::Open(path_), FailsWith(kDataLoss, "time has 2 steps"));
  EXPECT_THAT(DatasetWriter::Append(path_), FailsWith(kDataLoss, "time has 2 steps"));
  ExpectProblem("time has 2 steps");
  ExpectProblem("nothing is there of steps 1024 to 999999998");
  WriteBytes(File("zarr.json"), sound);
  EditAttributes(File("zarr.json"), [](json& fovea) { fovea["chunk_edge"] = 16; });
  EXPECT_THAT(Dataset::Open(path_), FailsWith(kDataLoss, "does not describe the array"));
  EXPECT_THAT(DatasetWriter::Append(path_), FailsWith(kDataLoss, "does not describe the array"));
  ExpectProblem("does not describe the array");
}

TEST_F(DamagedStore, MetadataThatIsNoMetadataIsRefused) {
  const std::string file = File("zarr.json");
  const std::string sound = ReadText(file);
  const auto expect = [&](const std::string& text, absl::StatusCode code, const std::string& why) {
    WriteBytes(file, text);
    EXPECT_THAT(Dataset::Open(path_), FailsWith(code, file));
    EXPECT_THAT(Dataset::Open(path_), FailsWith(code, why));
  };
  expect("", kDataLoss, "not valid JSON");
  expect("{}", kPrecondition, "not that of a Fovea store");
  expect("[1, 2]", kPrecondition, "not that of a Fovea store");
  expect(R"({"attributes": {"fovea": 3}})", kDataLoss, "damaged");
  expect(std::string(100000, '['), kDataLoss, "not valid JSON");
  expect(R"({"attributes":{"fovea":)" + std::string(100, '[') + std::string(100, ']') + "}}",
         kDataLoss, "not valid JSON");
  expect(std::string((1 << 20) + 1, ' '), kDataLoss, "at most 1048576");
  json other = json::parse(sound);
  other["node_type"] = "array";
  expect(other.dump(), kDataLoss, "not a Zarr v3 group");
  other = json::parse(sound);
  other["attributes"]["fovea"]["clock"] = "another";
  expect(other.dump(), kDataLoss, "crc32c");
  // What others add beside our attributes is theirs.
  other = json::parse(sound);
  other["attributes"]["note"] = "mine";
  WriteBytes(file, other.dump());
  EXPECT_OK(ReadAll(path_));
}

TEST_F(DamagedStore, TheGroupOfAFieldIsChecked) {
  const std::string file = File("density/zarr.json");
  json group = json::parse(ReadText(file));
  group["attributes"]["note"] = "mine";  // these are free for others to use
  WriteBytes(file, group.dump());
  EXPECT_OK(ReadAll(path_));
  group["node_type"] = "array";
  WriteBytes(file, group.dump());
  EXPECT_THAT(ReadAll(path_), FailsWith(kDataLoss, file));
  ExpectProblem(file);
}

TEST_F(DamagedStore, APipeInPlaceOfAFileIsRefused) {
  fs::remove(File("time/c.0"));
  ASSERT_EQ(::mkfifo(File("time/c.0").c_str(), 0600), 0);
  EXPECT_THAT(ReadAll(path_), FailsWith(kPrecondition, "not a regular file"));
  ExpectProblem("not a regular file");
}

TEST(Verify, CanBeStopped) {
  TemporaryFolder folder;
  ASSERT_OK(testing::MakeStore(folder.Path("a.zarr"), MakeInfo({20, 20, 20}, 8), 3));
  std::vector<std::pair<int64_t, int64_t>> calls;
  const auto progress = [&](int64_t done, int64_t total) {
    calls.emplace_back(done, total);
    return done < 2;
  };
  EXPECT_THAT(Verify(folder.Path("a.zarr"), 1, progress),
              FailsWith(absl::StatusCode::kCancelled, "2 of 3"));
  EXPECT_THAT(calls, ::testing::ElementsAre(std::pair(1, 3), std::pair(2, 3)));
  EXPECT_THAT(Verify(folder.Path("b.zarr"), 1), FailsWith(absl::StatusCode::kNotFound, "no store"));
}

}  // namespace
}  // namespace fovea::store
