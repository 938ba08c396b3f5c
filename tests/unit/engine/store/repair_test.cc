#include "engine/store/repair.h"

#include <algorithm>
#include <functional>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "engine/store/dataset.h"
#include "engine/store/dataset_writer.h"
#include "engine/store/file.h"
#include "engine/store/verify.h"
#include "tests/support/simulated_disk.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/engine/store/store_test_util.h"

namespace fovea::store {
namespace {

using ::fovea::testing::FailsWith;
using ::fovea::testing::SimulatedDisk;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::MakeInfo;

constexpr Int3 kDims{45, 38, 40};
constexpr int64_t kSteps = 3;
const std::string kPath = "a.zarr";

using Bytes = std::vector<std::byte>;

/// All that a reader can see of a store.
struct Contents {
  std::map<std::pair<int64_t, int>, std::vector<float>> values;  // by step and level; -1: coarse
  std::vector<int64_t> times;
  std::vector<std::optional<int64_t>> numbers;
  std::vector<FieldStats> stats;
};

Contents ReadContents(SimulatedDisk* disk, const std::string& path) {
  Contents contents;
  const auto dataset = Dataset::Open(path, *disk);
  EXPECT_OK(dataset.status());
  for (int64_t step = 0; dataset.ok() && step < (*dataset)->info().committed_steps; ++step) {
    const auto source = (*dataset)->OpenStep(step, "density", OnDamage::kCount);
    EXPECT_OK(source.status());
    std::vector<float> coarse(static_cast<size_t>((*source)->hierarchy().DimsAt(0).Product()));
    EXPECT_OK((*source)->ReadCoarse(coarse));
    contents.values[{step, -1}] = coarse;
    for (int level = 0; level < (*source)->hierarchy().finest(); ++level) {
      contents.values[{step, level}] = *testing::ReadLevel(source->get(), level);
    }
    contents.times.push_back((*dataset)->TimeNs(step).value_or(-1));
    contents.numbers.push_back((*dataset)->FrameNumber(step).value_or(std::nullopt));
    contents.stats.push_back(*(*dataset)->Stats(step, "density"));
  }
  return contents;
}

class Repairing : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    sound_ = std::make_unique<SimulatedDisk>();
    ASSERT_OK(testing::MakeStore(kPath, MakeInfo(kDims, 8), kSteps, *sound_));
    contents_ = ReadContents(sound_.get(), kPath);
  }
  static void TearDownTestSuite() { sound_.reset(); }

  void SetUp() override { disk_ = sound_->AfterKill(); }

  void Write(const std::string& path, const Bytes& bytes) {
    ASSERT_OK_AND_ASSIGN(WritableFile file, WritableFile::Create(*disk_, path));
    ASSERT_OK(file.Append(bytes));
  }
  /// Changes the byte at `part` (0 to 1) of a file.
  void Flip(const std::string& path, double part) {
    Bytes bytes = disk_->Files().at(path);
    const auto at = static_cast<size_t>(part * static_cast<double>(bytes.size() - 1));
    bytes[at] ^= std::byte{0x10};
    Write(path, bytes);
  }
  std::string Find(const std::string& part) {
    for (const auto& [path, bytes] : disk_->Files()) {
      if (path.find(part) != std::string::npos) {
        return path;
      }
    }
    ADD_FAILURE() << "no file is like " << part;
    return "";
  }

  StatusOr<RepairReport> RepairTo(const std::string& output) {
    return Repair(kPath, {output, 2}, nullptr, nullptr, *disk_);
  }

  /// That the store at `path` is sound, and that what it has is what was written, or gone where
  /// the report says that something is.
  void ExpectTruth(const std::string& path, const RepairReport& report) {
    ASSERT_OK_AND_ASSIGN(const VerifyReport verified, Verify(path, 1, nullptr, *disk_));
    EXPECT_THAT(verified.problems, IsEmpty());
    EXPECT_EQ(verified.steps, kSteps);
    const Contents now = ReadContents(disk_.get(), path);
    EXPECT_EQ(now.times.size(), static_cast<size_t>(kSteps));
    bool same = now.times == contents_.times && now.numbers == contents_.numbers;
    for (const auto& [where, values] : now.values) {
      const std::vector<float>& before = contents_.values.at(where);
      for (size_t i = 0; i < values.size(); ++i) {
        ASSERT_TRUE(values[i] == before[i] || values[i] == 0) << "made up";
      }
      same = same && values == before;
    }
    // Invented times may be right, and nobody may have put attributes anywhere.
    const bool lost_data =
        std::any_of(report.lost.begin(), report.lost.end(), [](const auto& line) {
          return !line.starts_with("time of") &&
                 line.find("attributes others") == std::string::npos;
        });
    EXPECT_TRUE(same ? !lost_data : !report.lost.empty()) << ::testing::PrintToString(report.lost);
    for (size_t step = 0; step < now.stats.size() && same; ++step) {
      EXPECT_EQ(now.stats[step].histogram, contents_.stats[step].histogram);
      EXPECT_FLOAT_EQ(static_cast<float>(now.stats[step].maximum),
                      static_cast<float>(contents_.stats[step].maximum));
    }
  }

  static std::unique_ptr<SimulatedDisk> sound_;
  static Contents contents_;
  std::unique_ptr<SimulatedDisk> disk_;
};

std::unique_ptr<SimulatedDisk> Repairing::sound_;
Contents Repairing::contents_;

TEST_F(Repairing, WhateverIsDamagedTheRestIsSavedAndTheReportIsTrue) {
  using Harm = std::function<void(const std::string&)>;
  const std::map<std::string, Harm> harms = {
      {"start", [&](const std::string& path) { Flip(path, 0); }},
      {"middle", [&](const std::string& path) { Flip(path, 0.5); }},
      {"end", [&](const std::string& path) { Flip(path, 1); }},
      {"cut",
       [&](const std::string& path) {
         Bytes bytes = disk_->Files().at(path);
         bytes.resize(bytes.size() / 2);
         Write(path, bytes);
       }},
      {"empty", [&](const std::string& path) { Write(path, {}); }},
      {"gone", [&](const std::string& path) { ASSERT_OK(RemoveFile(*disk_, path)); }}};
  for (const auto& [path, bytes] : sound_->Files()) {
    if (path.ends_with(kLockName) || path.ends_with(".fovea.group.json")) {
      continue;
    }
    for (const auto& [name, harm] : harms) {
      for (const std::string output : {"", "b.zarr"}) {
        SCOPED_TRACE(path + ", " + name + (output.empty() ? ", in place" : ", new"));
        disk_ = sound_->AfterKill();
        harm(path);
        const auto report = RepairTo(output);
        ASSERT_OK(report.status());
        EXPECT_FALSE(report->lost.empty() && report->rebuilt.empty());
        ExpectTruth(output.empty() ? kPath : output, *report);
        if (HasFailure()) {
          return;
        }
      }
    }
  }
}

TEST_F(Repairing, TheCopyOfTheGroupIsMetadataToo) {
  Flip(kPath + "/.fovea.group.json", 0.5);
  ASSERT_OK_AND_ASSIGN(const VerifyReport found, Verify(kPath, 1, nullptr, *disk_));
  EXPECT_THAT(found.problems, ::testing::ElementsAre(HasSubstr(".fovea.group.json")));
  ASSERT_OK_AND_ASSIGN(const RepairReport report, RepairTo(""));
  EXPECT_THAT(report.lost, IsEmpty());
  EXPECT_THAT(report.rebuilt, ::testing::ElementsAre(HasSubstr(".fovea.group.json")));
  EXPECT_EQ(disk_->Files(), sound_->Files());
}

TEST_F(Repairing, ASoundStoreStaysAsItIs) {
  ASSERT_OK_AND_ASSIGN(const RepairReport report, RepairTo(""));
  EXPECT_THAT(report.lost, IsEmpty());
  EXPECT_THAT(report.rebuilt, IsEmpty());
  EXPECT_GT(report.chunks_kept, 0U);
  EXPECT_EQ(disk_->Files(), sound_->Files());
  ASSERT_OK(RepairTo("b.zarr"));
  for (const auto& [path, bytes] : sound_->Files()) {
    if (!path.ends_with(kLockName)) {
      EXPECT_EQ(disk_->Files().at("b.zarr" + path.substr(kPath.size())), bytes) << path;
    }
  }
  EXPECT_THAT(RepairTo("b.zarr"), FailsWith(absl::StatusCode::kAlreadyExists, "b.zarr"));
}

TEST_F(Repairing, ChunksAreFoundAgainWithoutTheirIndex) {
  const std::string shard = Find("detail_2/c.1.");
  Flip(shard, 1);  // the checksum of the index
  ASSERT_OK_AND_ASSIGN(const RepairReport report, RepairTo(""));
  EXPECT_THAT(report.lost, IsEmpty());
  EXPECT_THAT(report.rebuilt, Contains(HasSubstr("its index")));
  ExpectTruth(kPath, report);
}

TEST_F(Repairing, OfAShardThatIsDamagedTwiceTheOtherChunksAreSaved) {
  const std::string shard = Find("detail_2/c.1.");
  Flip(shard, 1);
  Flip(shard, 0.01);
  ASSERT_OK_AND_ASSIGN(const RepairReport report, RepairTo(""));
  EXPECT_EQ(report.lost.size(), 1U) << ::testing::PrintToString(report.lost);
  EXPECT_THAT(report.lost, Contains(HasSubstr("step 1")));
  ExpectTruth(kPath, report);
}

TEST_F(Repairing, AStepWithoutItsCoarseLevelIsLostAndKeepsItsNumber) {
  Flip(Find("coarse/c.1."), 0.5);
  ASSERT_OK_AND_ASSIGN(const RepairReport report, RepairTo(""));
  EXPECT_THAT(report.lost, ::testing::ElementsAre(HasSubstr("step 1 of 'density': all of it")));
  ExpectTruth(kPath, report);
  ASSERT_OK_AND_ASSIGN(const auto dataset, Dataset::Open(kPath, *disk_));
  EXPECT_EQ(dataset->info().fields[0].lost_steps, std::vector<int64_t>{1});
  std::vector<float> coarse(static_cast<size_t>(dataset->info().hierarchy.DimsAt(0).Product()), 1);
  ASSERT_OK_AND_ASSIGN(const auto source, dataset->OpenStep(1, "density", OnDamage::kCount));
  ASSERT_OK(source->ReadCoarse(coarse));
  EXPECT_THAT(coarse, ::testing::Each(0.0F));
  EXPECT_EQ(source->read_stats().chunks_damaged, 1U);
  ASSERT_OK_AND_ASSIGN(const auto strict, dataset->OpenStep(1, "density", OnDamage::kFail));
  EXPECT_THAT(strict->ReadCoarse(coarse),
              FailsWith(absl::StatusCode::kDataLoss, "step 1 of field 'density'"));
  EXPECT_OK(dataset->Stats(1, "density").status());
  // A writer goes on, and the mark stays; another repair loses nothing.
  {
    ASSERT_OK_AND_ASSIGN(const auto writer, DatasetWriter::Append(kPath, *disk_));
    ASSERT_OK(testing::WriteSteps(writer.get(), 1));
  }
  ASSERT_OK_AND_ASSIGN(const RepairReport again, RepairTo(""));
  EXPECT_THAT(again.lost, IsEmpty());
  EXPECT_THAT(again.rebuilt, IsEmpty());
  ASSERT_OK_AND_ASSIGN(const auto longer, Dataset::Open(kPath, *disk_));
  EXPECT_EQ(longer->info().committed_steps, kSteps + 1);
  EXPECT_TRUE(longer->info().IsLost("density", 1));
}

TEST_F(Repairing, LostTimesStandBetweenThoseThatAreKnown) {
  Flip(Find("a.zarr/time/c.0"), 0.5);
  ASSERT_OK_AND_ASSIGN(const RepairReport report, RepairTo(""));
  EXPECT_THAT(report.lost, ::testing::ElementsAre(HasSubstr("time of steps 0 to 2")));
  const Contents now = ReadContents(disk_.get(), kPath);
  EXPECT_TRUE(std::is_sorted(now.times.begin(), now.times.end()));
}

TEST_F(Repairing, WithoutTheGroupAndItsCopyItSaysWhatIsMissing) {
  ASSERT_OK(RemoveFile(*disk_, kPath + "/zarr.json"));
  ASSERT_OK(RemoveFile(*disk_, kPath + "/.fovea.group.json"));
  const auto before = disk_->Files();
  EXPECT_THAT(RepairTo(""), FailsWith(absl::StatusCode::kFailedPrecondition, "nobody knows"));
  EXPECT_THAT(RepairTo("b.zarr"), FailsWith(absl::StatusCode::kFailedPrecondition, "zarr.json"));
  EXPECT_EQ(disk_->Files(), before);
  EXPECT_THAT(Repair("none.zarr", {"", 1}, nullptr, nullptr, *disk_),
              FailsWith(absl::StatusCode::kNotFound, "none.zarr"));
}

TEST_F(Repairing, IsNotDoneBesideAWriterNorAgainstOnesWill) {
  Flip(Find("detail_2/c.1."), 0.2);
  const auto before = disk_->Files();
  {
    ASSERT_OK_AND_ASSIGN(const auto lock, WriterLock::Take(*disk_, kPath));
    EXPECT_THAT(RepairTo(""),
                FailsWith(absl::StatusCode::kFailedPrecondition, "is being written by"));
  }
  for (const std::string output : {"", "b.zarr"}) {
    EXPECT_THAT(Repair(
                    kPath, {output, 1},
                    [](const RepairReport& report) {
                      EXPECT_FALSE(report.lost.empty());
                      return false;
                    },
                    nullptr, *disk_),
                FailsWith(absl::StatusCode::kCancelled, kPath));
    EXPECT_THAT(Repair(
                    kPath, {output, 1}, nullptr, [](int64_t, int64_t) { return false; }, *disk_),
                FailsWith(absl::StatusCode::kCancelled, kPath));
  }
  EXPECT_EQ(disk_->Files(), before);
}

}  // namespace
}  // namespace fovea::store
