// The machine stops, or one call fails, at every single call that a writer makes to the disk.

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <random>
#include <set>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "engine/store/dataset.h"
#include "engine/store/dataset_writer.h"
#include "engine/store/file.h"
#include "engine/store/repair.h"
#include "engine/store/verify.h"
#include "tests/support/crash_everywhere.h"
#include "tests/support/simulated_disk.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/engine/store/store_test_util.h"

namespace fovea::store {
namespace {

using ::fovea::testing::CrashEverywhere;
using ::fovea::testing::SimulatedDisk;
using testing::MakeInfo;
using testing::MakeStep;
using Call = SimulatedDisk::Call;

constexpr Int3 kDims{20, 12, 9};
constexpr int64_t kEdge = 8;
constexpr const char* kPath = "a.zarr";
const std::vector<std::string> kFields = {"p"};

/// Every value that a step should have, coarse first.
using Values = std::vector<std::vector<float>>;

StatusOr<Values> AllValues(CoefficientSource* source) {
  Values values(1);
  values[0].resize(static_cast<size_t>(source->hierarchy().DimsAt(0).Product()));
  FOVEA_RETURN_IF_ERROR(source->ReadCoarse(values[0]));
  for (int level = 0; level < source->hierarchy().finest(); ++level) {
    FOVEA_ASSIGN_OR_RETURN(std::vector<float> detail, testing::ReadLevel(source, level));
    values.push_back(std::move(detail));
  }
  return values;
}

const Values& Expected(int64_t step) {
  static std::map<int64_t, Values> known;
  if (!known.contains(step)) {
    const testing::StepData data = MakeStep(kDims, kEdge, static_cast<int>(step));
    MemorySource memory(data.coefficients);
    known[step] = *AllValues(&memory);
  }
  return known[step];
}

/// That every committed step is whole and has its row; how many there are.
int64_t ExpectWholeSteps(SimulatedDisk* disk) {
  const auto dataset = Dataset::Open(kPath, *disk);
  EXPECT_OK(dataset.status());
  if (!dataset.ok()) {
    return -1;
  }
  const int64_t steps = (*dataset)->info().committed_steps;
  for (int64_t step = 0; step < steps; ++step) {
    for (const std::string& field : kFields) {
      const auto source = (*dataset)->OpenStep(step, field, OnDamage::kFail);
      EXPECT_OK(source.status());
      const StatusOr<Values> values = AllValues(source->get());
      EXPECT_OK(values.status());
      EXPECT_TRUE(values.ok() && *values == Expected(step)) << field << ", step " << step;
      EXPECT_OK((*dataset)->Stats(step, field).status());
    }
    EXPECT_EQ((*dataset)->TimeNs(step).value_or(-1), step * 1'000'000'000);
  }
  const auto report = Verify(kPath, 1, nullptr, *disk);
  EXPECT_OK(report.status());
  EXPECT_THAT(report->problems, ::testing::IsEmpty());
  return steps;
}

void ExpectNothingLeftOver(const SimulatedDisk& disk, int64_t steps) {
  for (const auto& [path, bytes] : disk.Files()) {
    EXPECT_FALSE(IsTemporaryName(std::filesystem::path(path).filename().string())) << path;
    EXPECT_EQ(path.find(fmt::format("coarse/c.{}.", steps)), std::string::npos) << path;
    EXPECT_EQ(path.find(fmt::format("detail_2/c.{}.", steps)), std::string::npos) << path;
  }
}

/// A disk found after an accident: it has `least` to `most` whole steps, and a new writer goes on.
void ExpectRecovers(SimulatedDisk* disk, int64_t least, int64_t most) {
  const int64_t steps = ExpectWholeSteps(disk);
  ASSERT_GE(steps, least);
  ASSERT_LE(steps, most);
  auto writer = DatasetWriter::Append(kPath, *disk);
  ASSERT_OK(writer.status());
  EXPECT_EQ((*writer)->info().committed_steps, steps);
  ExpectNothingLeftOver(*disk, steps);
  ASSERT_OK(testing::WriteSteps(writer->get(), 1));
  ExpectNothingLeftOver(*disk, steps + 1);
  EXPECT_EQ(ExpectWholeSteps(disk), steps + 1);
}

std::unique_ptr<SimulatedDisk> DiskWithSteps(int64_t steps) {
  static std::map<int64_t, std::unique_ptr<SimulatedDisk>> known;
  if (!known.contains(steps)) {
    known[steps] = std::make_unique<SimulatedDisk>();
    EXPECT_OK(testing::MakeStore(kPath, MakeInfo(kDims, kEdge, kFields), steps, *known[steps]));
  }
  return known[steps]->AfterKill();
}

Status AppendSteps(SimulatedDisk* disk, int64_t steps) {
  FOVEA_ASSIGN_OR_RETURN(const auto writer, DatasetWriter::Append(kPath, *disk));
  return testing::WriteSteps(writer.get(), steps);
}

TEST(StoreCrash, AtEveryCallOfACommitNoStepIsDamaged) {
  CrashEverywhere([] { return DiskWithSteps(2); },
                  [](SimulatedDisk* disk) { return AppendSteps(disk, 1); },
                  [](SimulatedDisk* disk) { ExpectRecovers(disk, 2, 3); });
}

TEST(StoreCrash, AtEveryCallOfStepsThatArePublishedTogetherNoneIsDamaged) {
  CrashEverywhere(
      [] { return DiskWithSteps(1); },
      [](SimulatedDisk* disk) -> Status {
        FOVEA_ASSIGN_OR_RETURN(const auto writer, DatasetWriter::Append(kPath, *disk));
        for (int64_t step = 1; step < 3; ++step) {
          const testing::StepData data = MakeStep(kDims, kEdge, static_cast<int>(step));
          FOVEA_RETURN_IF_ERROR(writer->WriteField(kFields[0], data.coefficients, data.stats));
          FOVEA_RETURN_IF_ERROR(writer->EndStep(step * 1'000'000'000, {}));
        }
        return writer->Publish();
      },
      [](SimulatedDisk* disk) {
        const auto dataset = Dataset::Open(kPath, *disk);
        ASSERT_OK(dataset.status());
        EXPECT_NE((*dataset)->info().committed_steps, 2) << "all or none";
        ExpectRecovers(disk, 1, 3);
      });
}

TEST(StoreCrash, AtEveryCallOfTheSweepNoStepIsDamaged) {
  // What a writer leaves that dies as late as it can without having committed.
  const auto dead = [] {
    std::unique_ptr<SimulatedDisk> disk = DiskWithSteps(1);
    disk->set_fault([gone = false](const Call& call) mutable {
      gone = gone || (call.operation == SimulatedDisk::Operation::kRename &&
                      call.path == std::string(kPath) + "/zarr.json");
      return gone ? -EIO : 0;
    });
    EXPECT_FALSE(AppendSteps(disk.get(), 1).ok());
    return disk->AfterKill();
  };
  CrashEverywhere(
      dead, [](SimulatedDisk* disk) { return DatasetWriter::Append(kPath, *disk).status(); },
      [](SimulatedDisk* disk) { ExpectRecovers(disk, 1, 1); });
}

TEST(StoreCrash, AtEveryCallOfTheCreationItCanBeRepeated) {
  const DatasetInfo info = MakeInfo(kDims, kEdge, kFields);
  CrashEverywhere(
      [] { return std::make_unique<SimulatedDisk>(); },
      [&](SimulatedDisk* disk) { return DatasetWriter::Create(kPath, info, *disk).status(); },
      [&](SimulatedDisk* disk) {
        if (!Dataset::Open(kPath, *disk).ok()) {
          ASSERT_OK(DatasetWriter::Create(kPath, info, *disk).status());
        }
        ExpectRecovers(disk, 0, 0);
      });
}

/// Two steps; of the second a chunk of detail is damaged.
std::unique_ptr<SimulatedDisk> DamagedDisk() {
  std::unique_ptr<SimulatedDisk> disk = DiskWithSteps(2);
  const std::string shard = std::string(kPath) + "/p/detail_2/c.1.0.0.0.0";
  std::vector<std::byte> bytes = disk->Files().at(shard);
  bytes[bytes.size() / 3] ^= std::byte{1};
  auto file = WritableFile::Create(*disk, shard);
  EXPECT_OK(file.status());
  EXPECT_OK(file->Append(bytes));
  const auto all = [](size_t) { return true; };
  return disk->AfterPowerCut(all, SimulatedDisk::Kept::kAll);  // it is on the disk like that
}

TEST(StoreCrash, AtEveryCallOfARepairWhatIsSoundStays) {
  CrashEverywhere(
      DamagedDisk,
      [](SimulatedDisk* disk) {
        return Repair(kPath, {"", 1}, nullptr, nullptr, *disk).status();
      },
      [](SimulatedDisk* disk) {
        ASSERT_OK(Repair(kPath, {"", 1}, nullptr, nullptr, *disk).status());
        ASSERT_OK_AND_ASSIGN(const VerifyReport report, Verify(kPath, 1, nullptr, *disk));
        EXPECT_THAT(report.problems, ::testing::IsEmpty());
        ASSERT_OK_AND_ASSIGN(const auto dataset, Dataset::Open(kPath, *disk));
        ASSERT_EQ(dataset->info().committed_steps, 2);
        for (int64_t step = 0; step < 2; ++step) {
          ASSERT_OK_AND_ASSIGN(const auto source, dataset->OpenStep(step, "p", OnDamage::kFail));
          ASSERT_OK_AND_ASSIGN(const Values values, AllValues(source.get()));
          EXPECT_EQ(values == Expected(step), step == 0);
          EXPECT_EQ(values[0], Expected(step)[0]);
          EXPECT_TRUE(std::any_of(values[1].begin(), values[1].end(), [](float value) {
            return value != 0;
          })) << "the other chunk of the level";
        }
      });
}

TEST(StoreCrash, AtEveryCallOfARepairIntoANewStoreTheOldOneIsUntouched) {
  const auto before = DamagedDisk()->Files();
  CrashEverywhere(
      DamagedDisk,
      [](SimulatedDisk* disk) {
        return Repair(kPath, {"b.zarr", 1}, nullptr, nullptr, *disk).status();
      },
      [&](SimulatedDisk* disk) {
        for (const auto& [path, bytes] : before) {
          ASSERT_EQ(disk->Files().at(path), bytes) << path;
        }
        const Status again = Repair(kPath, {"b.zarr", 1}, nullptr, nullptr, *disk).status();
        if (!again.ok()) {  // it was done
          ASSERT_THAT(again, ::fovea::testing::FailsWith(absl::StatusCode::kAlreadyExists, "b"));
        }
        ASSERT_OK_AND_ASSIGN(const VerifyReport report, Verify("b.zarr", 1, nullptr, *disk));
        EXPECT_THAT(report.problems, ::testing::IsEmpty());
        EXPECT_EQ(report.steps, 2);
      });
}

/// One call of a commit fails, and the disk goes on: the writer says so; what it wrote before is
/// whole; it, or a new one, goes on.
void FailEverywhere(int error) {
  bool disturbed = true;
  for (int64_t at = 0; disturbed; ++at) {
    const std::unique_ptr<SimulatedDisk> disk = DiskWithSteps(2);
    auto writer = DatasetWriter::Append(kPath, *disk);
    ASSERT_OK(writer.status());
    disturbed = false;
    Call failed;
    const int64_t start = disk->calls();
    disk->set_fault([&](const Call& call) {
      if (call.index != start + at) {
        return 0;
      }
      disturbed = true;
      failed = call;
      return error;
    });
    const Status status = testing::WriteSteps(writer->get(), 1);
    disk->set_fault(nullptr);
    SCOPED_TRACE(fmt::format("call {} ({}) fails with {}", at, failed.path, error));
    const int64_t steps = ExpectWholeSteps(disk.get());
    if (status.ok()) {
      EXPECT_EQ(steps, 3);  // a call that may fail, or none did
    } else {
      const auto code =
          error == -EIO ? absl::StatusCode::kDataLoss : absl::StatusCode::kResourceExhausted;
      EXPECT_THAT(status, ::fovea::testing::FailsWith(code, "step 2"));
      EXPECT_NE(MessageOf(status).find(kPath), std::string::npos) << MessageOf(status);
      const bool says_not = MessageOf(status).find("was not committed") != std::string::npos;
      EXPECT_TRUE(steps == 2 || !says_not) << MessageOf(status);
    }
    if (const Status again = testing::WriteSteps(writer->get(), 1); !again.ok()) {
      EXPECT_THAT(again, ::fovea::testing::FailsWith(absl::StatusCode::kFailedPrecondition,
                                                     "open the store again"));
    }
    writer->reset();
    ExpectRecovers(disk.get(), 2, 4);
    if (::testing::Test::HasFailure()) {
      return;
    }
  }
}

TEST(StoreCrash, EveryCallOfACommitMayFailWithAnIoError) {
  FailEverywhere(-EIO);
}

TEST(StoreCrash, EveryCallOfACommitMayFailWithAFullDisk) {
  FailEverywhere(-ENOSPC);
}

TEST(StoreCrash, EveryCallOfACommitMayFailForWantOfDescriptors) {
  FailEverywhere(-EMFILE);
}

TEST(StoreCrash, EveryCallOfAReaderMayFail) {
  const std::unique_ptr<SimulatedDisk> disk = DiskWithSteps(2);
  int64_t opened = 0;  // calls until then
  const auto read = [&]() -> Status {
    FOVEA_ASSIGN_OR_RETURN(const auto dataset, Dataset::Open(kPath, *disk));
    opened = disk->calls();
    FOVEA_RETURN_IF_ERROR(dataset->Refresh());
    FOVEA_RETURN_IF_ERROR(dataset->TimeNs(1).status());
    FOVEA_RETURN_IF_ERROR(dataset->Stats(1, "p").status());
    FOVEA_ASSIGN_OR_RETURN(const auto source, dataset->OpenStep(1, "p", OnDamage::kFail));
    return testing::ReadEverything(source.get());
  };
  // A call that fails is told; but that of opening which fails alone may be made again.
  for (const int64_t many : {int64_t{1}, std::numeric_limits<int64_t>::max()}) {
    for (const int error : {-EIO, -EMFILE, -ENOMEM}) {
      const auto code =
          error == -EIO ? absl::StatusCode::kDataLoss : absl::StatusCode::kResourceExhausted;
      bool disturbed = true;
      for (int64_t at = 0; disturbed; ++at) {
        disturbed = false;
        const int64_t start = disk->calls() + at;
        disk->set_fault([&](const Call& call) {
          const bool fails = call.index >= start && call.index - start < many;
          disturbed = disturbed || fails;
          return fails ? error : 0;
        });
        const Status status = read();
        if (!disturbed || (many == 1 && start < opened && status.ok())) {
          EXPECT_OK(status);
        } else {
          EXPECT_THAT(status, ::fovea::testing::FailsWith(code, kPath)) << at;
        }
      }
    }
  }
  EXPECT_EQ(disk->open_handles(), 0U);
}

}  // namespace
}  // namespace fovea::store
