// Files that are not what they should be. None may take the program down.

#include <filesystem>
#include <fstream>
#include <random>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "ingest/ingest.h"
#include "tests/support/status_matchers.h"
#include "tests/support/vdb_files.h"
#include "tests/system/ingest/ingested.h"

namespace fovea::ingest {
namespace {

using ::fovea::testing::FailsWith;
using ::fovea::testing::ReadFile;
using ::fovea::testing::TemporaryFolder;
using ::fovea::testing::VdbGrid;
using ::fovea::testing::WriteVdb;
using ::testing::HasSubstr;

class DamagedVdbTest : public ::testing::Test {
 protected:
  [[nodiscard]] IngestOptions Options(const std::vector<std::string>& names) const {
    IngestOptions options;
    for (const std::string& name : names) {
      options.inputs.push_back(folder_ / name);
    }
    options.output = folder_ / "out.zarr";
    return options;
  }
  [[nodiscard]] std::string Path(const std::string& name) const { return folder_ / name; }

  TemporaryFolder folder_;
};

TEST_F(DamagedVdbTest, EveryCutOfAFileIsReported) {
  const std::string whole = ReadFile(FOVEA_SOURCE_DIR "/tests/data/plume/plume_0001.vdb");
  ASSERT_GT(whole.size(), 20000U);
  const std::vector<size_t> cuts{
      0, 1, 7, 8, 20, 60, 100, 400, 2000, 5000, 9000, 12500, 13000, 20000, whole.size() - 1};
  for (const size_t cut : cuts) {
    const std::string path = Path("cut.vdb");
    std::ofstream(path, std::ios::binary) << whole.substr(0, cut);
    const auto result = Ingest(Options({"cut.vdb"}));
    EXPECT_THAT(result, FailsWith(absl::StatusCode::kDataLoss, "cut.vdb: ")) << cut;
    EXPECT_FALSE(std::filesystem::exists(Path("out.zarr")));
  }
}

TEST_F(DamagedVdbTest, WhatIsNoVdbIsSaidToBeNone) {
  std::ofstream(Path("text.vdb")) << "These are words, and many of them; but no volume at all.\n";
  EXPECT_THAT(Ingest(Options({"text.vdb"})),
              FailsWith(absl::StatusCode::kDataLoss, "text.vdb: not a VDB file"));
  std::ofstream(Path("empty.vdb")).flush();
  EXPECT_THAT(Ingest(Options({"empty.vdb"})),
              FailsWith(absl::StatusCode::kDataLoss, "empty.vdb: the file is empty"));
}

TEST_F(DamagedVdbTest, OfSeveralTheFirstIsNamed) {
  // They are looked at by several workers at once.
  const std::string whole = ReadFile(FOVEA_SOURCE_DIR "/tests/data/plume/plume_0001.vdb");
  for (int number = 1; number <= 9; ++number) {
    const bool is_cut = number == 4 || number == 5 || number == 8;
    std::ofstream(Path("p_" + std::to_string(number) + ".vdb"), std::ios::binary)
        << whole.substr(0, is_cut ? 400 : whole.size());
  }
  for (int round = 0; round < 5; ++round) {
    EXPECT_THAT(Ingest(Options({"p_#.vdb"})), FailsWith(absl::StatusCode::kDataLoss, "p_4.vdb: "));
  }
  EXPECT_FALSE(std::filesystem::exists(Path("out.zarr")));
}

TEST_F(DamagedVdbTest, ADamagedStepInTheMiddleKeepsTheStepsBefore) {
  // Many flipped bytes in the zipped voxels; the metadata stay right.
  std::string bytes = ReadFile(FOVEA_SOURCE_DIR "/tests/data/plume/plume_0001.vdb");
  for (size_t i = bytes.size() / 4; i < bytes.size() / 2; ++i) {
    bytes[i] = static_cast<char>(~bytes[i]);
  }
  for (const std::string name : {"p_1.vdb", "p_3.vdb"}) {
    std::filesystem::copy(FOVEA_SOURCE_DIR "/tests/data/plume/plume_0001.vdb", Path(name));
  }
  std::ofstream(Path("p_2.vdb"), std::ios::binary) << bytes;
  const auto result = Ingest(Options({"p_#.vdb"}));
  ASSERT_FALSE(result.ok());
  EXPECT_THAT(std::string(MessageOf(result.status())), HasSubstr("p_2.vdb: "));
  EXPECT_THAT(std::string(MessageOf(result.status())), HasSubstr("1 step in"));
  ASSERT_OK_AND_ASSIGN(const auto dataset, store::Dataset::Open(Path("out.zarr")));
  EXPECT_EQ(dataset->info().committed_steps, 1);
}

TEST_F(DamagedVdbTest, TheDeadlineOfAFileIsKept) {
  WriteVdb(Path("a.vdb"), {{.voxels = {{{0, 0, 0}, 1}}}});
  IngestOptions options = Options({"a.vdb"});
  options.worker.seconds_per_file = 0.0001;
  EXPECT_THAT(Ingest(options), FailsWith(absl::StatusCode::kDeadlineExceeded, "a.vdb: "));
}

#ifndef FOVEA_SANITIZED
TEST_F(DamagedVdbTest, TheMemoryLimitIsReportedWithTheFlagThatRaisesIt) {
  VdbGrid grid;  // 384^3 voxels that do not compress to tiles: 216 MB and more
  for (int64_t z = 0; z < 384; z += 8) {
    for (int64_t y = 0; y < 384; y += 8) {
      for (int64_t x = 0; x < 384; x += 8) {
        grid.voxels.push_back({{x, y, z}, 1});
      }
    }
  }
  WriteVdb(Path("a.vdb"), {grid});
  IngestOptions options = Options({"a.vdb"});
  options.worker.memory_bytes = 220 << 20;
  EXPECT_THAT(Ingest(options), FailsWith(absl::StatusCode::kResourceExhausted, "--worker-memory"));
}
#endif

TEST_F(DamagedVdbTest, MutatedFilesEndInVoxelsOrAnErrorThatNamesThem) {
  const std::string whole = ReadFile(FOVEA_SOURCE_DIR "/tests/data/plume/plume_0001.vdb");
  std::mt19937 random(1978);
  for (int round = 0; round < 12; ++round) {
    std::string bytes = whole;
    // Mostly in the metadata and topology at the front, where they do most harm.
    const size_t reach = round % 3 == 0 ? bytes.size() : 3000;
    for (int change = 0; change < 3; ++change) {
      bytes[random() % reach] = static_cast<char>(random());
    }
    std::ofstream(Path("mutated.vdb"), std::ios::binary) << bytes;
    IngestOptions options = Options({"mutated.vdb"});
    options.worker.seconds_per_file = 10;
    const auto result = Ingest(options);
    if (!result.ok()) {
      EXPECT_THAT(std::string(MessageOf(result.status())), HasSubstr("mutated.vdb"));
    }
    std::filesystem::remove_all(options.output);
  }
}

}  // namespace
}  // namespace fovea::ingest
