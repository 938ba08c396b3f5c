// Stores cut down to windows: what is kept, what readers see meanwhile, and what a crash leaves.

#include "engine/store/retain.h"

#include <atomic>
#include <map>
#include <memory>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "engine/store/dataset_writer.h"
#include "engine/store/file.h"
#include "engine/store/retention.h"
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
using Files = std::map<std::string, std::vector<std::byte>>;
using Windows = std::vector<RetainedWindow>;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
constexpr Int3 kDims{40, 33, 50};
constexpr const char* kPath = "a.zarr";
const Windows kWindows = {{{20, 16, 20}, 6}, {{31, 20, 28}, {4, 2, 8}}};

DatasetInfo InfoWith(const Windows& windows) {
  DatasetInfo info = testing::MakeInfo(kDims, 8);
  info.retention = windows;
  return info;
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

/// What the files are of a store that dropped the rest as its steps were written.
const Files& WrittenSo(const Windows& windows, int64_t steps) {
  static std::map<int64_t, Files> known;
  if (!known.contains(steps)) {
    SimulatedDisk disk;
    EXPECT_OK(testing::MakeStore(kPath, InfoWith(windows), steps, disk));
    known[steps] = FilesIn(disk, kPath);
  }
  return known[steps];
}

/// Reads all of a step. Every coefficient is as it was made; or 0, where it may have been dropped.
/// Returns how many were dropped.
int64_t ExpectStep(Dataset* dataset, int64_t step, const RetainedChunks& retained,
                   bool must_be_dropped = false) {
  static std::map<int64_t, testing::StepData> made;
  if (!made.contains(step)) {
    made[step] = testing::MakeStep(kDims, 8, static_cast<int>(step));
  }
  MemorySource memory(made[step].coefficients);
  const auto source = dataset->OpenStep(step, "density", OnDamage::kFail);
  EXPECT_OK(source.status());
  int64_t dropped = 0;
  for (int level = 0; level < memory.hierarchy().finest(); ++level) {
    const auto stored = testing::ReadLevel(source->get(), level);
    EXPECT_OK(stored.status());
    const auto wanted = testing::ReadLevel(&memory, level);
    const Int3 dims = memory.hierarchy().DimsAt(level);
    for (size_t i = 0; stored.ok() && i < wanted->size(); ++i) {
      const auto at = static_cast<int64_t>(i);
      const Int3 chunk{at % dims.x / 8, at / dims.x % dims.y / 8,
                       at / dims.x / dims.y % dims.z / 8};
      const bool is_dropped = (*stored)[i] == 0 && (*wanted)[i] != 0;
      dropped += is_dropped ? 1 : 0;
      const bool may_drop = !retained.Keeps(level, chunk);
      if ((*stored)[i] != (is_dropped ? 0 : (*wanted)[i]) || (is_dropped && !may_drop) ||
          (must_be_dropped && may_drop && (*stored)[i] != 0)) {
        ADD_FAILURE() << "step " << step << " level " << level << " chunk " << chunk.x << ","
                      << chunk.y << "," << chunk.z << ": " << (*stored)[i] << ", made "
                      << (*wanted)[i];
        return dropped;
      }
    }
  }
  EXPECT_EQ((*source)->read_stats().chunks_damaged, 0U);
  return dropped;
}

TEST(Retention, UnionsOfBoxesAreTakenExactly) {
  std::mt19937 random(3);
  const auto some = [&](int64_t most) { return static_cast<int64_t>(random() % (most + 1)); };
  const auto box = [&] {
    const Int3 lo{some(4), some(4), some(4)};
    return Box3{lo, {lo.x + some(4), lo.y + some(4), lo.z + some(4)}};
  };
  int contained = 0;
  for (int round = 0; round < 2000; ++round) {
    std::vector<Box3> boxes(1 + random() % 6);
    std::generate(boxes.begin(), boxes.end(), box);
    const Box3 asked = box();
    bool expected = true;
    for (int64_t i = 0; i < 9 * 9 * 9; ++i) {
      const Int3 p{i % 9, i / 9 % 9, i / 81};
      expected = expected && (!asked.Contains(p) ||
                              std::any_of(boxes.begin(), boxes.end(),
                                          [&](const Box3& one) { return one.Contains(p); }));
    }
    EXPECT_EQ(UnionContains(boxes, asked), expected);
    contained += expected && !asked.IsEmpty() ? 1 : 0;
  }
  EXPECT_GT(contained, 10);
}

TEST(Retention, EveryCoefficientOfAWindowIsKept) {
  ASSERT_OK_AND_ASSIGN(const RetainedChunks retained, RetainedChunks::Make(InfoWith(kWindows)));
  const Hierarchy hierarchy = *Hierarchy::Make(kDims);
  for (const RetainedWindow& window : kWindows) {
    const auto set = *RetainedSet::Make(hierarchy, {window.at, window.rate});
    EXPECT_TRUE(retained.Covers(set));
    EXPECT_FALSE(retained.Covers(*RetainedSet::Make(hierarchy, {window.at, 40})));
  }
  EXPECT_TRUE(retained.Covers(retained));
  ASSERT_OK_AND_ASSIGN(const RetainedChunks one, RetainedChunks::Make(InfoWith({kWindows[0]})));
  ASSERT_OK_AND_ASSIGN(const RetainedChunks all, RetainedChunks::Make(InfoWith({})));
  EXPECT_TRUE(retained.Covers(one));
  EXPECT_FALSE(one.Covers(retained));
  EXPECT_TRUE(all.Covers(retained));
  EXPECT_FALSE(retained.Covers(all));
}

TEST(Retain, InPlaceACopyAndAnIngestGiveTheSameFiles) {
  SimulatedDisk disk;
  ASSERT_OK(testing::MakeStore(kPath, testing::MakeInfo(kDims, 8), 3, disk));
  const Files before = FilesIn(disk, kPath);
  ASSERT_OK_AND_ASSIGN(const RetainReport copied,
                       RetainCopy(kPath, "b.zarr", kWindows, nullptr, disk));
  EXPECT_EQ(FilesIn(disk, kPath), before);
  EXPECT_EQ(FilesIn(disk, "b.zarr"), WrittenSo(kWindows, 3));
  ASSERT_OK_AND_ASSIGN(const RetainReport cut, RetainInPlace(kPath, kWindows, nullptr, disk));
  EXPECT_EQ(FilesIn(disk, kPath), WrittenSo(kWindows, 3));
  EXPECT_EQ(cut.steps, 3);
  EXPECT_GT(cut.counts.chunks_kept, 0U);
  EXPECT_GT(cut.counts.chunks_dropped, 0U);
  EXPECT_EQ(cut.counts.bytes_dropped, copied.counts.bytes_dropped);
}

TEST(Retain, WhatIsKeptReadsAsBeforeAndTheRestAsZero) {
  SimulatedDisk disk;
  ASSERT_OK(testing::MakeStore(kPath, testing::MakeInfo(kDims, 8), 2, disk));
  ASSERT_OK_AND_ASSIGN(const auto before, Dataset::Open(kPath, disk));
  ASSERT_OK_AND_ASSIGN(const FieldStats stats, before->Stats(1, "density"));
  ASSERT_OK(RetainInPlace(kPath, kWindows, nullptr, disk));
  ASSERT_OK_AND_ASSIGN(const auto dataset, Dataset::Open(kPath, disk));
  EXPECT_EQ(dataset->info().retention, kWindows);
  EXPECT_EQ(dataset->info().fields, before->info().fields);
  ASSERT_OK_AND_ASSIGN(const FieldStats same, dataset->Stats(1, "density"));
  EXPECT_EQ(same.histogram, stats.histogram);
  EXPECT_EQ(same.maximum, stats.maximum);
  ASSERT_OK_AND_ASSIGN(const auto retained, RetainedChunks::Make(dataset->info()));
  EXPECT_GT(ExpectStep(dataset.get(), 1, retained, true), 0);
  ASSERT_OK_AND_ASSIGN(const VerifyReport report, Verify(kPath, 1, nullptr, disk));
  EXPECT_THAT(report.problems, ::testing::IsEmpty());
  ASSERT_OK_AND_ASSIGN(const auto writer, DatasetWriter::Append(kPath, disk));
  ASSERT_OK(testing::WriteSteps(writer.get(), 1));  // new steps are cut as they are written
  EXPECT_EQ(FilesIn(disk, kPath), WrittenSo(kWindows, 3));
}

TEST(Retain, NothingIsDoneThatCannotBe) {
  SimulatedDisk disk;
  ASSERT_OK(testing::MakeStore(kPath, InfoWith({kWindows[0]}), 1, disk));
  const Files before = FilesIn(disk, kPath);
  const auto in_place = [&](const Windows& windows) {
    return RetainInPlace(kPath, windows, nullptr, disk).status();
  };
  EXPECT_THAT(in_place(kWindows), FailsWith(kInvalid, "reach outside what a.zarr retains"));
  EXPECT_THAT(in_place({}), FailsWith(kInvalid, "--retain"));
  EXPECT_THAT(in_place({{{41, 0, 0}, 4}}), FailsWith(kInvalid, "41"));
  EXPECT_THAT(in_place({{{4, 0, 0}, 0.5}}), FailsWith(kInvalid, "rate"));
  EXPECT_THAT(in_place(Windows(65, {{4, 4, 4}, 4})), FailsWith(kInvalid, "65 windows"));
  EXPECT_THAT(RetainCopy(kPath, kPath, {kWindows[0]}, nullptr, disk),
              FailsWith(absl::StatusCode::kAlreadyExists, kPath));
  EXPECT_EQ(FilesIn(disk, kPath), before);
  EXPECT_OK(in_place({kWindows[0]}));
  EXPECT_EQ(FilesIn(disk, kPath), before);
  const auto writer = DatasetWriter::Append(kPath, disk);
  EXPECT_THAT(in_place({kWindows[0]}),
              FailsWith(absl::StatusCode::kFailedPrecondition, "is being written by"));
}

TEST(Retain, MetadataThatCannotBeIsRefused) {
  SimulatedDisk disk;
  EXPECT_THAT(testing::MakeStore(kPath, InfoWith({{{0, 0, 99}, 4}}), 0, disk),
              FailsWith(kInvalid, "99"));
  DatasetInfo info = testing::MakeInfo(kDims, 8);
  info.source = SourceInfo{"0123456789abcdeX", 1, 0, 1};
  EXPECT_THAT(testing::MakeStore(kPath, info, 0, disk), FailsWith(kInvalid, "hex"));
  info.source = SourceInfo{"0123456789abcdef", 1, 2, 2};
  EXPECT_THAT(testing::MakeStore(kPath, info, 0, disk), FailsWith(kInvalid, "part 2 of 2"));
}

TEST(Retain, AReaderThatKnewMoreSeesZerosAndNoError) {
  SimulatedDisk disk;
  ASSERT_OK(testing::MakeStore(kPath, testing::MakeInfo(kDims, 8), 1, disk));
  ASSERT_OK_AND_ASSIGN(const auto dataset, Dataset::Open(kPath, disk));
  ASSERT_OK_AND_ASSIGN(const auto source, dataset->OpenStep(0, "density", OnDamage::kFail));
  ASSERT_OK(testing::ReadEverything(source.get()));  // knows the tables of all levels now
  ASSERT_OK(RetainInPlace(kPath, kWindows, nullptr, disk));
  EXPECT_OK(testing::ReadEverything(source.get()));
  EXPECT_EQ(source->read_stats().chunks_damaged, 0U);
  EXPECT_EQ(dataset->info().retention, Windows{});
}

TEST(Retain, WorksWhileOthersRead) {
  testing::TemporaryFolder folder;
  const std::string path = folder.Path("a.zarr");
  constexpr int64_t kSteps = 4;
  ASSERT_OK(testing::MakeStore(path, testing::MakeInfo(kDims, 8), kSteps));
  ASSERT_OK_AND_ASSIGN(const auto retained, RetainedChunks::Make(InfoWith(kWindows)));
  ASSERT_OK_AND_ASSIGN(const auto dataset, Dataset::Open(path));
  std::atomic<bool> done = false;
  std::atomic<int> reads = 0;
  std::thread reader([&] {
    for (int64_t i = 0; !done || i < kSteps; ++i, ++reads) {
      ExpectStep(dataset.get(), i % kSteps, retained);
    }
  });
  // Goes on as the reader does: a few reads for each step that is cut.
  const auto wait = [&](int64_t step, int64_t) {
    while (reads < 2 * step && !::testing::Test::HasFailure()) {
      std::this_thread::yield();
    }
    return true;
  };
  EXPECT_OK(RetainInPlace(path, kWindows, wait));
  done = true;
  reader.join();
  EXPECT_GT(ExpectStep(dataset.get(), 0, retained, true), 0);
}

TEST(Retain, NoCrashLeavesAStoreThatCannotBeReadOrFinished) {
  SimulatedDisk full;
  ASSERT_OK(testing::MakeStore(kPath, testing::MakeInfo(kDims, 8), 2, full));
  const auto flushed = full.AfterPowerCut([](size_t) { return true; }, SimulatedDisk::Kept::kAll);
  ASSERT_OK_AND_ASSIGN(const auto retained, RetainedChunks::Make(InfoWith(kWindows)));
  int mixtures = 0;
  CrashEverywhere(
      [&] { return flushed->AfterKill(); },
      [](SimulatedDisk* disk) { return RetainInPlace(kPath, kWindows, nullptr, *disk).status(); },
      [&](SimulatedDisk* disk) {
        const auto dataset = Dataset::Open(kPath, *disk);
        ASSERT_OK(dataset.status());
        const bool first = ExpectStep(dataset->get(), 0, retained) > 0;
        const bool second = ExpectStep(dataset->get(), 1, retained) > 0;
        mixtures += first != second ? 1 : 0;
        EXPECT_TRUE(!first || (*dataset)->info().retention == kWindows);
        ASSERT_OK_AND_ASSIGN(const VerifyReport report, Verify(kPath, 1, nullptr, *disk));
        EXPECT_THAT(report.problems, ::testing::IsEmpty());
        EXPECT_OK(RetainInPlace(kPath, kWindows, nullptr, *disk));
        EXPECT_EQ(FilesIn(*disk, kPath), WrittenSo(kWindows, 2));
      });
  EXPECT_GT(mixtures, 0);
}

}  // namespace
}  // namespace fovea::store
