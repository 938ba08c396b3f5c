#include "engine/store/dataset_writer.h"

#include <unistd.h>

#include <cerrno>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>

#include <gtest/gtest.h>

#include "engine/store/file.h"
#include "engine/store/verify.h"
#include "tests/support/simulated_disk.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/engine/store/store_test_util.h"

namespace fovea::store {
namespace {

namespace fs = std::filesystem;
using ::fovea::testing::FailsWith;
using ::fovea::testing::SimulatedDisk;
using testing::MakeInfo;
using testing::MakeStep;
using testing::StepData;
using testing::TemporaryFolder;
using testing::WriteSteps;

constexpr Int3 kDims{20, 33, 40};
constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
constexpr auto kExists = absl::StatusCode::kAlreadyExists;
constexpr auto kPrecondition = absl::StatusCode::kFailedPrecondition;

void Touch(const std::string& path) {
  std::ofstream(path) << "x";
}

void ExpectSound(const std::string& path, int64_t steps) {
  ASSERT_OK_AND_ASSIGN(const VerifyReport report, Verify(path, 1));
  EXPECT_EQ(report.steps, steps);
  EXPECT_THAT(report.problems, ::testing::IsEmpty());
}

TEST(DatasetWriter, MakesAnEmptyStore) {
  TemporaryFolder folder;
  const std::string path = folder.Path("a.zarr");
  ASSERT_OK_AND_ASSIGN(const auto writer, DatasetWriter::Create(path, MakeInfo(kDims, 8)));
  EXPECT_EQ(writer->info().committed_steps, 0);
  ExpectSound(path, 0);
}

TEST(DatasetWriter, GoesOnWhereTheLastOneStopped) {
  TemporaryFolder folder;
  const std::string path = folder.Path("a.zarr");
  ASSERT_OK(testing::MakeStore(path, MakeInfo(kDims, 8), 15));
  for (int part = 0; part < 3; ++part) {  // across the end of a chunk of histogram
    ASSERT_OK_AND_ASSIGN(const auto writer, DatasetWriter::Append(path));
    EXPECT_EQ(writer->info().committed_steps, 15 + part);
    ASSERT_OK(WriteSteps(writer.get(), 1));
  }
  ExpectSound(path, 18);
  ASSERT_OK_AND_ASSIGN(const auto dataset, Dataset::Open(path));
  for (const int64_t step : {0, 14, 15, 16, 17}) {
    ASSERT_OK_AND_ASSIGN(const FieldStats stats, dataset->Stats(step, "density"));
    EXPECT_EQ(stats.histogram, MakeStep(kDims, 8, static_cast<int>(step)).stats.histogram);
    ASSERT_OK_AND_ASSIGN(const int64_t time, dataset->TimeNs(step));
    EXPECT_EQ(time, step * 1'000'000'000);
  }
}

TEST(DatasetWriter, OneAtATime) {
  TemporaryFolder folder;
  const std::string path = folder.Path("a.zarr");
  ASSERT_OK_AND_ASSIGN(auto writer, DatasetWriter::Create(path, MakeInfo(kDims, 8)));
  const std::string holder = fmt::format("process {} on ", ::getpid());
  EXPECT_THAT(DatasetWriter::Append(path), FailsWith(kPrecondition, holder));
  EXPECT_THAT(DatasetWriter::Append(path), FailsWith(kPrecondition, " since 20"));
  EXPECT_THAT(DatasetWriter::Create(path, MakeInfo(kDims, 8)), FailsWith(kPrecondition, holder));
  writer.reset();
  EXPECT_OK(DatasetWriter::Append(path));
}

TEST(DatasetWriter, DoesNotWriteOverWhatIsThere) {
  TemporaryFolder folder;
  const DatasetInfo info = MakeInfo(kDims, 8);
  ASSERT_OK(testing::MakeStore(folder.Path("a.zarr"), info, 1));
  EXPECT_THAT(DatasetWriter::Create(folder.Path("a.zarr"), info), FailsWith(kExists, "append"));
  ExpectSound(folder.Path("a.zarr"), 1);
  fs::create_directory(folder.Path("b.zarr"));
  EXPECT_OK(DatasetWriter::Create(folder.Path("b.zarr"), info));
  fs::create_directory(folder.Path("c.zarr"));
  Touch(folder.Path("c.zarr/thesis.txt"));
  EXPECT_THAT(DatasetWriter::Create(folder.Path("c.zarr"), info), FailsWith(kExists, "exists"));
  EXPECT_FALSE(fs::exists(folder.Path("c.zarr/" + std::string(kLockName))));
  Touch(folder.Path("d.zarr"));
  EXPECT_THAT(DatasetWriter::Create(folder.Path("d.zarr"), info), FailsWith(kExists, "exists"));
  EXPECT_THAT(DatasetWriter::Create(folder.Path("no/such/e.zarr"), info),
              FailsWith(absl::StatusCode::kNotFound, "cannot make directory"));
  EXPECT_THAT(DatasetWriter::Append(folder.Path("no.zarr")),
              FailsWith(absl::StatusCode::kNotFound, "no store"));
  EXPECT_THAT(DatasetWriter::Append(folder.Path("c.zarr")),
              FailsWith(kPrecondition, "not a Fovea store"));
}

TEST(DatasetWriter, TakesOverAnUnfinishedCreation) {
  TemporaryFolder folder;
  const std::string path = folder.Path("a.zarr");
  ASSERT_OK(DatasetWriter::Create(path, MakeInfo(kDims, 8, {"smoke"})));
  fs::remove(path + "/zarr.json");
  ASSERT_OK(DatasetWriter::Create(path, MakeInfo(kDims, 16)));
  ExpectSound(path, 0);
  EXPECT_FALSE(fs::exists(path + "/smoke"));
  // But not a store that lost its metadata: its steps may still be saved.
  ASSERT_OK_AND_ASSIGN(auto writer, DatasetWriter::Append(path));
  ASSERT_OK(WriteSteps(writer.get(), 1));
  writer.reset();
  fs::remove(path + "/zarr.json");
  EXPECT_THAT(DatasetWriter::Create(path, MakeInfo(kDims, 16)), FailsWith(kExists, "holds"));
  EXPECT_TRUE(fs::exists(path + "/density/coarse/c.0.0.0.0"));
}

TEST(DatasetWriter, SweepsUpAfterAKilledOne) {
  TemporaryFolder folder;
  const std::string path = folder.Path("a.zarr");
  ASSERT_OK(testing::MakeStore(path, MakeInfo(kDims, 8), 2));
  // What a commit of step 2 leaves that was cut off before its last rename.
  fs::copy_file(path + "/zarr.json", path + "/saved");
  {
    ASSERT_OK_AND_ASSIGN(const auto writer, DatasetWriter::Append(path));
    ASSERT_OK(WriteSteps(writer.get(), 1));
  }
  fs::rename(path + "/saved", path + "/zarr.json");
  Touch(path + "/.zarr.json.tmp");
  Touch(path + "/density/detail_2/.c.2.0.0.0.0.tmp");
  const std::string shard = path + "/density/detail_2/c.2.0.0.0.0";
  ASSERT_TRUE(fs::exists(shard));
  ExpectSound(path, 2);
  {
    ASSERT_OK_AND_ASSIGN(const auto writer, DatasetWriter::Append(path));
    EXPECT_EQ(writer->info().committed_steps, 2);
    EXPECT_FALSE(fs::exists(shard));
    for (const std::string& file : testing::FilesBelow(path)) {
      EXPECT_FALSE(IsTemporaryName(fs::path(file).filename().string())) << file;
    }
    ExpectSound(path, 2);
    // A step of zeros: nothing of the step that was lost may shine through.
    StepData zeros = MakeStep(kDims, 8, 1000);
    EXPECT_TRUE(zeros.coefficients.detail.back().bricks().empty());
    ASSERT_OK(writer->WriteField("density", zeros.coefficients, zeros.stats));
    ASSERT_OK(writer->Commit(2'000'000'000, 7));
  }
  ExpectSound(path, 3);
  ASSERT_OK_AND_ASSIGN(const auto dataset, Dataset::Open(path));
  ASSERT_OK_AND_ASSIGN(const auto source, dataset->OpenStep(2, "density", OnDamage::kFail));
  ASSERT_OK_AND_ASSIGN(const auto values, testing::ReadLevel(source.get(), 1));
  EXPECT_THAT(values, ::testing::Each(0.0F));
}

TEST(DatasetWriter, RefusesWhatCannotBeDescribed) {
  TemporaryFolder folder;
  const auto expect_refused = [&](const DatasetInfo& info, const std::string& text) {
    EXPECT_THAT(DatasetWriter::Create(folder.Path("a.zarr"), info), FailsWith(kInvalid, text));
    EXPECT_FALSE(fs::exists(folder.Path("a.zarr")));
  };
  for (const char* name : {"", ".hidden", "a/b", "..", "__x", "time", "zarr.json", "a b", "ü"}) {
    expect_refused(MakeInfo(kDims, 8, {name}), "field name");
  }
  expect_refused(MakeInfo(kDims, 8, {std::string(101, 'a')}), "field name");
  expect_refused(MakeInfo(kDims, 8, {"a", "a"}), "twice");
  expect_refused(MakeInfo(kDims, 7), "chunk edge");
  DatasetInfo info = MakeInfo(kDims, 8);
  info.default_field = "smoke";
  expect_refused(info, "default field");
  info = MakeInfo(kDims, 8);
  info.fields[0].type = "float16";
  expect_refused(info, "float16");
  info = MakeInfo(kDims, 8);
  info.wavelet = "db4";
  expect_refused(info, "haar, cdf53 or cdf97");
  info = MakeInfo(kDims, 8);
  info.index_to_world.m[0] = 0;
  expect_refused(info, "singular");
  info.index_to_world.m[0] = NAN;
  expect_refused(info, "not finite");
  info = MakeInfo(kDims, 8);
  info.clock = "\xff\xfe";
  expect_refused(info, "UTF-8");
}

TEST(DatasetWriter, RefusesCoefficientsThatDoNotFit) {
  TemporaryFolder folder;
  const std::string path = folder.Path("a.zarr");
  ASSERT_OK_AND_ASSIGN(const auto writer,
                       DatasetWriter::Create(path, MakeInfo(kDims, 8, {"a", "b"})));
  const StepData good = MakeStep(kDims, 8, 0);
  const auto write = [&](const StepData& data) {
    return writer->WriteField("a", data.coefficients, data.stats);
  };
  EXPECT_THAT(writer->WriteField("c", good.coefficients, good.stats),
              FailsWith(absl::StatusCode::kNotFound, "no field 'c'"));
  EXPECT_THAT(write(MakeStep(kDims, 16, 0)), FailsWith(kInvalid, "bricks of 8"));
  EXPECT_THAT(write(MakeStep({20, 33, 41}, 8, 0)), FailsWith(kInvalid, "20 x 33 x 40"));
  StepData bad = good;
  bad.coefficients.detail.pop_back();
  EXPECT_THAT(write(bad), FailsWith(kInvalid, "20 x 33 x 40"));
  bad = good;
  bad.coefficients.coarse.values[3] = INFINITY;
  EXPECT_THAT(write(bad), FailsWith(kInvalid, "not finite"));
  bad = good;
  bad.coefficients.detail.back().Touch({0, 0, 0})[5] = NAN;
  EXPECT_THAT(write(bad), FailsWith(kInvalid, "chunk 0,0,0 (x, y, z) of detail_2"));
  bad = good;
  bad.stats.minimum = NAN;
  EXPECT_THAT(write(bad), FailsWith(kInvalid, "range nan"));
  ASSERT_OK(write(good));
  EXPECT_THAT(writer->Commit(0, 1), FailsWith(kPrecondition, "field 'b' of step 0"));
  // The step is gone: it starts anew.
  ASSERT_OK(write(good));
  EXPECT_THAT(write(good), FailsWith(kPrecondition, "already"));
  EXPECT_EQ(testing::FilesBelow(path + "/a/coarse").size(), 1U);  // zarr.json
  ASSERT_OK(WriteSteps(writer.get(), 2));
  ASSERT_OK(write(good));
  ASSERT_OK(writer->WriteField("b", good.coefficients, good.stats));
  EXPECT_THAT(writer->Commit(999'999'999, 1), FailsWith(kInvalid, "before the last step"));
  ExpectSound(path, 2);
}

TEST(DatasetWriter, StepsThatEndTogetherAreThereTogether) {
  SimulatedDisk one_by_one, together;
  const DatasetInfo info = MakeInfo({9, 8, 7}, 8);
  ASSERT_OK(testing::MakeStore("s", info, 40, one_by_one));
  ASSERT_OK_AND_ASSIGN(auto writer, DatasetWriter::Create("s", info, together));
  for (int64_t step = 0; step < 40; ++step) {
    const StepData data = MakeStep({9, 8, 7}, 8, static_cast<int>(step));
    ASSERT_OK(writer->WriteField("density", data.coefficients, data.stats));
    const auto frame_number = step % 2 == 0 ? std::optional(100 + step) : std::nullopt;
    ASSERT_OK(writer->EndStep(step * 1'000'000'000, frame_number));
    if (step == 6) {
      EXPECT_EQ(writer->info().committed_steps, 0);
      EXPECT_THAT(writer->WriteField("density", MakeStep({9, 9, 9}, 8, 0).coefficients, data.stats),
                  FailsWith(kInvalid, "of step 7"));  // and the seven before it stay
      ASSERT_OK(writer->Publish());
      EXPECT_EQ(writer->info().committed_steps, 7);
    }
  }
  ASSERT_OK(writer->Publish());
  writer.reset();  // and with it what it says in the lock
  EXPECT_TRUE(one_by_one.Files() == together.Files());
}

TEST(DatasetWriter, StepsThatCannotBePublishedAreAllGoneAndCanBeMadeAgain) {
  SimulatedDisk disk;
  const DatasetInfo info = MakeInfo({9, 8, 7}, 8);
  ASSERT_OK(testing::MakeStore("s", info, 14, disk));
  const auto before = disk.Files();
  ASSERT_OK_AND_ASSIGN(const auto writer, DatasetWriter::Append("s", disk));
  const auto end_five = [&]() -> Status {  // across the end of a chunk of histogram
    for (int64_t step = 14; step < 19; ++step) {
      const StepData data = MakeStep({9, 8, 7}, 8, static_cast<int>(step));
      FOVEA_RETURN_IF_ERROR(writer->WriteField("density", data.coefficients, data.stats));
      FOVEA_RETURN_IF_ERROR(writer->EndStep(step * 1'000'000'000, {}));
    }
    return writer->Publish();
  };
  disk.set_fault([](const SimulatedDisk::Call& call) {
    return call.operation == SimulatedDisk::Operation::kFlush ? -ENOSPC : 0;
  });
  EXPECT_THAT(end_five(),
              FailsWith(absl::StatusCode::kResourceExhausted, "steps 14 to 18: was not committed"));
  auto files = disk.Files();
  files.erase("s/" + std::string(kLockName));
  auto expected = before;
  expected.erase("s/" + std::string(kLockName));
  EXPECT_TRUE(files == expected);
  disk.set_fault(nullptr);
  ASSERT_OK(end_five());
  ASSERT_OK_AND_ASSIGN(const auto dataset, Dataset::Open("s", disk));
  for (int64_t step = 0; step < 19; ++step) {
    ASSERT_OK_AND_ASSIGN(const FieldStats stats, dataset->Stats(step, "density"));
    EXPECT_EQ(stats.histogram, MakeStep({9, 8, 7}, 8, static_cast<int>(step)).stats.histogram);
  }
}

}  // namespace
}  // namespace fovea::store
