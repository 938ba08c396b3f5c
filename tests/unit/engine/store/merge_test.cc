// Parts that several machines made become one dataset, whatever stops the merge and whenever.

#include "engine/store/merge.h"

#include <cerrno>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "engine/store/dataset_writer.h"
#include "engine/store/file.h"
#include "engine/store/verify.h"
#include "tests/support/crash_everywhere.h"
#include "tests/support/simulated_disk.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/engine/store/store_test_util.h"

namespace fovea::store {
namespace {

using ::fovea::testing::CrashEverywhere;
using ::fovea::testing::FailsWith;
using ::fovea::testing::SimulatedDisk;
using ::testing::HasSubstr;
using Files = std::map<std::string, std::vector<std::byte>>;

constexpr Int3 kDims{20, 12, 9};
constexpr const char* kPath = "a.zarr";
constexpr const char* kSeries = "0123456789abcdef";

DatasetInfo InfoOfPart(int64_t part, int64_t parts, int64_t steps) {
  DatasetInfo info = testing::MakeInfo(kDims, 8);
  info.source = SourceInfo{kSeries, steps, part, parts};
  return info;
}

/// Writes the steps `first` to `last` - 1 of the series: a frame number for every other.
Status WriteSteps(DatasetWriter* writer, int64_t first, int64_t last) {
  for (int64_t step = first; step < last; ++step) {
    const testing::StepData data = testing::MakeStep(kDims, 8, static_cast<int>(step));
    FOVEA_RETURN_IF_ERROR(writer->WriteField("density", data.coefficients, data.stats));
    FOVEA_RETURN_IF_ERROR(writer->Commit(step * 1'000'000'000,
                                         step % 2 == 0 ? std::optional(100 + step) : std::nullopt));
  }
  return absl::OkStatus();
}

/// All of a part but for its last `without` steps.
void MakePart(FileSystem* disk, const DatasetInfo& info, int64_t without = 0) {
  const SourceInfo& source = *info.source;
  const std::string path =
      source.parts == 1 ? "single.zarr" : PartPath(kPath, source.part, source.parts);
  ASSERT_OK_AND_ASSIGN(const auto writer, DatasetWriter::Create(path, info, *disk));
  ASSERT_OK(WriteSteps(writer.get(), source.FirstStep(), source.LastStep() - without));
}

void MakeParts(FileSystem* disk, int64_t parts, int64_t steps) {
  for (int64_t part = 0; part < parts; ++part) {
    MakePart(disk, InfoOfPart(part, parts, steps));
  }
}

Files FilesIn(const SimulatedDisk& disk, const std::string& folder) {
  Files files;
  for (const auto& [path, bytes] : disk.Files()) {
    if (path.starts_with(folder + "/") && !path.ends_with(kLockName)) {
      files[path.substr(folder.size())] = bytes;
    }
  }
  return files;
}

/// The files of a single ingest of so many steps.
const Files& Single(int64_t steps) {
  static std::map<int64_t, Files> known;
  if (!known.contains(steps)) {
    SimulatedDisk disk;
    MakePart(&disk, InfoOfPart(0, 1, steps));
    known[steps] = FilesIn(disk, "single.zarr");
  }
  return known[steps];
}

TEST(Merge, PartsAreRunsOfStepsThatCoverTheSeries) {
  for (const auto& [steps, parts] :
       std::vector<std::pair<int64_t, int64_t>>{{18, 4}, {3, 5}, {1, 1}, {1'000'000'000, 7}}) {
    int64_t next = 0;
    for (int64_t part = 0; part < parts; ++part) {
      const SourceInfo source{kSeries, steps, part, parts};
      EXPECT_EQ(source.FirstStep(), next);
      EXPECT_LE(source.LastStep() - source.FirstStep(), (steps + parts - 1) / parts);
      EXPECT_GE(source.LastStep() - source.FirstStep(), steps / parts);
      next = source.LastStep();
    }
    EXPECT_EQ(next, steps);
  }
}

TEST(Merge, MakesTheVeryFilesOfASingleIngest) {
  for (const int64_t steps : {18, 3}) {  // past one chunk of histograms; a part without steps
    SimulatedDisk disk;
    MakeParts(&disk, 4, steps);
    ASSERT_OK_AND_ASSIGN(const MergeReport report, Merge({kPath, {}, false}, nullptr, disk));
    EXPECT_EQ(report.steps, steps);
    EXPECT_EQ(report.parts, 4);
    EXPECT_FALSE(report.was_merged);
    EXPECT_EQ(FilesIn(disk, kPath), Single(steps));
    EXPECT_FALSE(FilesIn(disk, PartPath(kPath, 0, 4)).empty());
    ASSERT_OK_AND_ASSIGN(const VerifyReport verified, Verify(kPath, 1, nullptr, disk));
    EXPECT_THAT(verified.problems, ::testing::IsEmpty());
  }
}

TEST(Merge, CopiesWhereThereAreNoLinks) {
  SimulatedDisk disk;
  MakeParts(&disk, 2, 3);
  disk.set_fault([](const SimulatedDisk::Call& call) {
    return call.operation == SimulatedDisk::Operation::kLink ? -EXDEV : 0;
  });
  ASSERT_OK(Merge({kPath, {}, false}, nullptr, disk));
  EXPECT_EQ(FilesIn(disk, kPath), Single(3));
}

TEST(Merge, PartsMayBeNamedAndLieAnywhere) {
  SimulatedDisk disk;
  MakeParts(&disk, 2, 3);
  ASSERT_GE(disk.Rename("a.part-1-of-2.zarr", "moved.zarr"), 0);
  EXPECT_THAT(Merge({kPath, {}, false}, nullptr, disk),
              FailsWith(absl::StatusCode::kFailedPrecondition, "a.part-1-of-2.zarr is missing"));
  ASSERT_OK(Merge({kPath, {"moved.zarr/", "a.part-0-of-2.zarr"}, false}, nullptr, disk));
  EXPECT_EQ(FilesIn(disk, kPath), Single(3));
}

TEST(Merge, NamesEveryPartThatIsMissingOrNotComplete) {
  SimulatedDisk disk;
  MakePart(&disk, InfoOfPart(1, 4, 18), 2);
  MakePart(&disk, InfoOfPart(2, 4, 18));
  const Status status = Merge({kPath, {}, false}, nullptr, disk).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(std::string(MessageOf(status)),
              ::testing::AllOf(HasSubstr("a.part-0-of-4.zarr is missing"),
                               HasSubstr("a.part-1-of-4.zarr has 3 of 5 steps"),
                               ::testing::Not(HasSubstr("part-2")),
                               HasSubstr("a.part-3-of-4.zarr is missing"), HasSubstr("--shard")));
  EXPECT_TRUE(FilesIn(disk, kPath).empty());
}

TEST(Merge, RefusesWhatAreNoPartsOfOneDataset) {
  constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
  const auto merged_with = [](const std::function<void(DatasetInfo*)>& change) {
    SimulatedDisk disk;
    MakePart(&disk, InfoOfPart(0, 2, 2));
    DatasetInfo other = InfoOfPart(1, 2, 2);
    change(&other);
    MakePart(&disk, other);
    return Merge({kPath, {}, false}, nullptr, disk).status();
  };
  EXPECT_THAT(merged_with([](DatasetInfo* i) { i->source->series[0] = '1'; }),
              FailsWith(kInvalid, "the series or plan"));
  EXPECT_THAT(merged_with([](DatasetInfo* i) {
                *i->source = {kSeries, 3, 1, 2};
              }),
              FailsWith(kInvalid, "the series or plan"));
  EXPECT_THAT(merged_with([](DatasetInfo* i) {
                *i->source = {kSeries, 2, 1, 3};
              }),
              FailsWith(kInvalid, "how many parts there are, 2 and 3"));
  EXPECT_THAT(merged_with([](DatasetInfo* i) { i->origin.x = 9; }), FailsWith(kInvalid, "extent"));
  EXPECT_THAT(merged_with([](DatasetInfo* i) { i->index_to_world.m[3] = 9; }),
              FailsWith(kInvalid, "place in the world"));
  EXPECT_THAT(merged_with([](DatasetInfo* i) {
                i->retention = {{{1, 1, 1}, 4}};
              }),
              FailsWith(kInvalid, "retention"));
  EXPECT_OK(merged_with([](DatasetInfo*) {}));

  SimulatedDisk disk;
  EXPECT_THAT(Merge({kPath, {}, false}, nullptr, disk),
              FailsWith(absl::StatusCode::kNotFound, "a.part-0-of-4.zarr"));
  ASSERT_OK(testing::MakeStore("a.part-0-of-2.zarr", testing::MakeInfo(kDims, 8), 1, disk));
  EXPECT_THAT(Merge({kPath, {}, false}, nullptr, disk),
              FailsWith(absl::StatusCode::kFailedPrecondition, "does not say what series"));
}

TEST(Merge, RefusesTheSamePartTwiceAndADatasetThatIsThere) {
  SimulatedDisk disk;
  MakeParts(&disk, 2, 2);
  const std::string part = PartPath(kPath, 0, 2);
  EXPECT_THAT(Merge({kPath, {part, part}, false}, nullptr, disk),
              FailsWith(absl::StatusCode::kInvalidArgument, "the same part, 0 of 2"));
  ASSERT_OK(testing::MakeStore(kPath, testing::MakeInfo(kDims, 8), 1, disk));
  EXPECT_THAT(Merge({kPath, {}, false}, nullptr, disk),
              FailsWith(absl::StatusCode::kAlreadyExists, kPath));
}

TEST(Merge, AgainSaysThatItWasDoneAndRemovesPartsIfAskedTo) {
  SimulatedDisk disk;
  MakeParts(&disk, 2, 3);
  ASSERT_OK(Merge({kPath, {}, false}, nullptr, disk));
  ASSERT_OK_AND_ASSIGN(const MergeReport again, Merge({kPath, {}, true}, nullptr, disk));
  EXPECT_TRUE(again.was_merged);
  EXPECT_EQ(again.parts_removed, 2);
  ASSERT_OK_AND_ASSIGN(const auto parts, FindParts(kPath, disk));
  EXPECT_TRUE(parts.empty());
  EXPECT_EQ(FilesIn(disk, kPath), Single(3));
  ASSERT_OK_AND_ASSIGN(const MergeReport last, Merge({kPath, {}, true}, nullptr, disk));
  EXPECT_TRUE(last.was_merged);
  EXPECT_EQ(last.steps, 3);
}

TEST(Merge, MayBeStoppedAndGivenAgain) {
  SimulatedDisk disk;
  MakeParts(&disk, 2, 3);
  int calls = 0;
  const auto stop = [&](int64_t, int64_t) { return ++calls < 4; };
  EXPECT_THAT(Merge({kPath, {}, true}, stop, disk),
              FailsWith(absl::StatusCode::kCancelled, "nothing was committed"));
  ASSERT_OK(Merge({kPath, {}, true}, nullptr, disk));
  EXPECT_EQ(FilesIn(disk, kPath), Single(3));
}

TEST(Merge, NoCrashLosesAStep) {
  SimulatedDisk parts;
  MakeParts(&parts, 2, 2);
  // As they are on the disks of machines that have long gone on to other things.
  const auto flushed = parts.AfterPowerCut([](size_t) { return true; }, SimulatedDisk::Kept::kAll);
  CrashEverywhere([&] { return flushed->AfterKill(); },
                  [](SimulatedDisk* disk) {
                    return Merge({kPath, {}, true}, nullptr, *disk).status();
                  },
                  [](SimulatedDisk* disk) {
                    const auto there = Dataset::Open(kPath, *disk);
                    if (there.ok() && (*there)->info().committed_steps > 0) {
                      EXPECT_EQ(FilesIn(*disk, kPath), Single(2));
                    }
                    EXPECT_OK(Merge({kPath, {}, true}, nullptr, *disk));
                    EXPECT_EQ(FilesIn(*disk, kPath), Single(2));
                    EXPECT_TRUE(FindParts(kPath, *disk)->empty());
                  });
}

}  // namespace
}  // namespace fovea::store
