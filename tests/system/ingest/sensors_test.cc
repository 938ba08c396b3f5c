#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <random>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <poll.h>

#include "engine/base/stopwatch.h"
#include "engine/sensors/morton.h"
#include "ingest/sensors/sensor_ingest.h"
#include "ingest/sensors/voxel_box.h"
#include "service/frames/frames.h"
#include "tests/support/status_matchers.h"
#include "tests/system/ingest/ingested.h"

namespace fovea::ingest {
namespace {

using ::fovea::testing::FailsWith;
using ::fovea::testing::StoredVoxels;
using ::fovea::testing::TemporaryFolder;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

struct Row {
  float x, y, z, t, value;
};

/// Places in eighths, so that texts and floats are the same numbers; box 0 to 64 on all axes.
std::vector<Row> SomeRows(int count, double seconds) {
  std::mt19937 random(4);
  std::vector<Row> rows;
  for (int i = 0; i < count; ++i) {
    const auto place = [&] { return static_cast<float>(random() % 513) / 8; };
    const auto time = static_cast<float>(std::floor(8 * seconds * i / count) / 8);
    const float x = place(), y = place(), z = place();
    rows.push_back({x, y, z, time, x + static_cast<float>(random() % 8)});
  }
  return rows;
}

std::string Csv(const std::vector<Row>& rows) {
  std::string text = "x,y,z,t,value\n";
  for (const Row& r : rows) {
    text += fmt::format("{},{},{},{},{}\n", r.x, r.y, r.z, r.t, r.value);
  }
  return text;
}

std::string JsonLines(const std::vector<Row>& rows) {
  std::string text;
  for (const Row& r : rows) {
    text += fmt::format("{{\"t\":{},\"x\":{},\"y\":{},\"z\":{},\"value\":{}}}\n", r.t, r.x, r.y,
                        r.z, r.value);
  }
  return text;
}

std::string Records(const std::vector<Row>& rows) {
  return {reinterpret_cast<const char*>(rows.data()), rows.size() * sizeof(Row)};
}

void Write(const std::string& path, const std::string& text) {
  std::ofstream(path, std::ios::binary) << text;
}

class SensorsTest : public ::testing::Test {
 protected:
  /// Options for one input with these contents.
  SensorOptions Options(const std::string& name, const std::string& text) {
    Write(folder_ / name, text);
    SensorOptions options;
    options.inputs = {folder_ / name};
    options.output = folder_ / (name + ".zarr");
    options.box.bounds = {Vec3{0, 0, 0}, Vec3{64, 64, 64}};
    options.box.voxel = Vec3{2, 2, 2};
    return options;
  }
  static StatusOr<SensorReport> Ingest(const SensorOptions& options) {
    return IngestSensors(options, nullptr);
  }
  TemporaryFolder folder_;
};

void ExpectSameStores(const std::string& a, const std::string& b, int64_t steps) {
  ASSERT_OK_AND_ASSIGN(const auto first, store::Dataset::Open(a));
  ASSERT_OK_AND_ASSIGN(const auto second, store::Dataset::Open(b));
  ASSERT_EQ(first->info().committed_steps, steps);
  ASSERT_EQ(second->info().committed_steps, steps);
  EXPECT_EQ(first->info().index_to_world, second->info().index_to_world);
  for (int64_t step = 0; step < steps; ++step) {
    EXPECT_EQ(*first->TimeNs(step), *second->TimeNs(step));
    EXPECT_EQ(*first->FrameNumber(step), *second->FrameNumber(step));
    for (const char* field : {"value", "coverage"}) {
      ASSERT_OK_AND_ASSIGN(const Grid one, StoredVoxels(a, step, field));
      ASSERT_OK_AND_ASSIGN(const Grid two, StoredVoxels(b, step, field));
      EXPECT_EQ(one.values, two.values) << field << " of step " << step;
    }
  }
}

TEST_F(SensorsTest, VoxelsHoldTheMeansOfTheirReadings) {
  const std::vector<Row> rows = SomeRows(3000, 1);
  SensorOptions options = Options("a.f32", Records(rows));
  options.value_unit = "K";
  ASSERT_OK_AND_ASSIGN(const SensorReport report, Ingest(options));
  EXPECT_EQ(report.steps, 1);
  EXPECT_EQ(report.counts.used, 3000);
  EXPECT_THAT(report.fields, ElementsAre("value"));
  ASSERT_OK_AND_ASSIGN(const Grid values, StoredVoxels(options.output, 0, "value"));
  ASSERT_OK_AND_ASSIGN(const Grid coverage, StoredVoxels(options.output, 0, "coverage"));
  std::map<uint64_t, std::pair<double, int>> sums;
  for (const Row& r : rows) {
    const auto index = [](float place) {
      return std::min<int64_t>(static_cast<int64_t>(place / 2), 31);
    };
    auto& sum = sums[sensors::MortonKey({index(r.x), index(r.y), index(r.z)})];
    sum.first += r.value;
    ++sum.second;
  }
  int64_t measured = 0;
  for (int64_t z = 0; z < 32; ++z) {
    for (int64_t y = 0; y < 32; ++y) {
      for (int64_t x = 0; x < 32; ++x) {
        const auto sum = sums.find(sensors::MortonKey({x, y, z}));
        if (sum != sums.end()) {
          ++measured;
          EXPECT_NEAR(values.At(x, y, z), sum->second.first / sum->second.second, 1e-4);
          EXPECT_EQ(coverage.At(x, y, z), 1);
        } else {
          EXPECT_LE(coverage.At(x, y, z), 0.5);
        }
      }
    }
  }
  EXPECT_EQ(report.measured_voxels, measured);
  ASSERT_OK_AND_ASSIGN(const auto dataset, store::Dataset::Open(options.output));
  const Vec3 world = dataset->info().index_to_world.TransformPoint({1, 2, 3});
  EXPECT_EQ(world, (Vec3{2, 4, 6}));
  EXPECT_EQ(dataset->info().fields.at(0).value_unit, "");  // coverage
  EXPECT_EQ(dataset->info().fields.at(1).value_unit, "K");
}

TEST_F(SensorsTest, ThreeFormatsMakeOneStore) {
  const std::vector<Row> rows = SomeRows(2000, 30);
  std::vector<std::string> stores;
  for (const auto& [name, text] :
       {std::pair("a.csv", Csv(rows)), std::pair("b.jsonl", JsonLines(rows)),
        std::pair("c.f32", Records(rows))}) {
    SensorOptions options = Options(name, text);
    options.steps_by = StepsBy::kWindow;
    options.steps.window_s = 10;
    ASSERT_OK_AND_ASSIGN(const SensorReport report, Ingest(options));
    EXPECT_EQ(report.steps, 3);
    stores.push_back(options.output);
  }
  ExpectSameStores(stores[0], stores[1], 3);
  ExpectSameStores(stores[0], stores[2], 3);
}

TEST_F(SensorsTest, AppendGoesOnWhereTheStoreEnds) {
  const std::vector<Row> rows = SomeRows(2000, 40);
  const auto options_of = [&](const std::string& name, const std::vector<Row>& part) {
    SensorOptions options = Options(name, Csv(part));
    options.steps_by = StepsBy::kWindow;
    options.steps.window_s = 10;
    options.steps.start_s = -3;
    return options;
  };
  const SensorOptions whole = options_of("whole.csv", rows);
  ASSERT_OK(Ingest(whole).status());
  // The first part ends inside window 2 and is cut there by hand: no half windows.
  std::vector<Row> first, second;
  for (const Row& row : rows) {
    (row.t < 17 ? first : second).push_back(row);
  }
  const SensorOptions begin = options_of("begin.csv", first);
  ASSERT_OK(Ingest(begin).status());
  second.insert(second.begin(), first.begin(), first.begin() + 7);  // these come too late
  SensorOptions more = options_of("more.csv", second);
  more.output = begin.output;
  more.append = true;
  more.box = {};
  ASSERT_OK_AND_ASSIGN(const SensorReport report, Ingest(more));
  EXPECT_EQ(report.counts.late, 7);
  ExpectSameStores(whole.output, begin.output, 5);
}

TEST_F(SensorsTest, AppendedValuesGoToTheFieldsOfTheirNames) {
  SensorOptions options = Options("two.csv", "x,y,z,t,wind,heat\n1,1,1,0,3,7\n");
  options.columns.values = {"wind", "heat"};
  options.steps_by = StepsBy::kWindow;
  options.steps.window_s = 1;
  ASSERT_OK(Ingest(options).status());
  Write(options.inputs.front(), "x,y,z,t,wind,heat\n1,1,1,1,3,7\n");
  options.append = true;
  options.box = {};
  ASSERT_OK(Ingest(options).status());
  ASSERT_OK_AND_ASSIGN(const auto dataset, store::Dataset::Open(options.output));
  for (int64_t step = 0; step < 2; ++step) {  // a store lists its fields by name
    EXPECT_EQ(dataset->Stats(step, "wind")->maximum, 3);
    EXPECT_EQ(dataset->Stats(step, "heat")->maximum, 7);
  }
}

TEST_F(SensorsTest, AppendedReadingsThatBeginEarlierAreRefusedAndAddNothing) {
  SensorOptions options = Options("today.csv", "x,y,z,t,value\n1,1,1,100,3\n");
  options.clock = "start of the run";
  ASSERT_OK(Ingest(options).status());
  SensorOptions more = Options("yesterday.csv", "x,y,z,t,value\n1,1,1,5,3\n");
  more.output = options.output;
  more.append = true;
  more.box = {};
  const StatusOr<SensorReport> refused = Ingest(more);
  EXPECT_THAT(refused, FailsWith(absl::StatusCode::kFailedPrecondition,
                                 "--append: the readings begin at 5 s, but the last step of"));
  EXPECT_THAT(refused, FailsWith(absl::StatusCode::kFailedPrecondition, "start of the run"));
  ASSERT_OK_AND_ASSIGN(const auto dataset, store::Dataset::Open(options.output));
  EXPECT_EQ(dataset->info().committed_steps, 1);
}

TEST_F(SensorsTest, AStepThatBeginsEarlierThanTheOneBeforeIsToldOf) {
  SensorOptions options = Options(
      "keys.csv", "x,y,z,t,value,k\n1,1,1,100,3,a\n1,1,1,90,3,b\n1,1,1,95,3,c\n1,1,1,200,3,d\n");
  options.steps_by = StepsBy::kKey;
  options.columns.step = "k";
  options.columns.values = {"value"};
  ASSERT_OK_AND_ASSIGN(const SensorReport report, Ingest(options));
  EXPECT_THAT(report.warnings, ElementsAre(HasSubstr("2 steps begin earlier than the step before, "
                                                     "and got its time, first 100 s for 90 s")));
  ASSERT_OK_AND_ASSIGN(const auto dataset, store::Dataset::Open(options.output));
  EXPECT_EQ(*dataset->TimeNs(2), 100'000'000'000);
  EXPECT_EQ(*dataset->TimeNs(3), 200'000'000'000);
}

TEST_F(SensorsTest, EachFileIsAStepAndTheBoxIsChosen) {
  const std::vector<Row> rows = SomeRows(1000, 10);
  SensorOptions options = Options("scan0.f32", Records({rows.begin(), rows.begin() + 500}));
  Write(folder_ / "scan1.f32", Records({rows.begin() + 500, rows.end()}));
  options.inputs = {folder_ / "scan#.f32"};
  options.box = {};
  ASSERT_OK_AND_ASSIGN(const SensorReport report, Ingest(options));
  EXPECT_EQ(report.steps, 2);
  EXPECT_TRUE(report.box_was_chosen);
  EXPECT_EQ(report.counts.outside, 0);
  EXPECT_EQ(report.counts.used, 1000);
  EXPECT_EQ(report.grid.voxel, (Vec3{2, 2, 2}));  // at least 32 voxels along each axis
  EXPECT_THAT(BoxFlags(report.grid), HasSubstr("--voxel 2,2,2"));
  ASSERT_OK_AND_ASSIGN(const auto dataset, store::Dataset::Open(options.output));
  EXPECT_EQ(*dataset->TimeNs(0), 0);
  EXPECT_EQ(*dataset->TimeNs(1), 5'000'000'000);
  // The same again, as said.
  SensorOptions pinned = options;
  pinned.output = folder_ / "pinned.zarr";
  pinned.box.bounds = {report.grid.lower,
                       report.grid.IndexToWorld().TransformPoint(
                           {static_cast<double>(report.grid.hierarchy.dims().x),
                            static_cast<double>(report.grid.hierarchy.dims().y),
                            static_cast<double>(report.grid.hierarchy.dims().z)})};
  pinned.box.voxel = report.grid.voxel;
  ASSERT_OK(Ingest(pinned).status());
  ExpectSameStores(options.output, pinned.output, 2);
}

TEST_F(SensorsTest, SeveralValuesBecomeSeveralFieldsAndAHeldStepHasNoCoverage) {
  SensorOptions options =
      Options("w.csv", "time,lon,lat,T (C),rh\n0,1,1,20,0.5\n1,9,9,10,0.25\n25,1,1,30,0.125\n");
  options.columns.values = {"T (C)", "rh"};
  options.steps_by = StepsBy::kWindow;
  options.steps.window_s = 10;
  options.steps.on_empty = sensors::OnEmpty::kHold;
  ASSERT_OK_AND_ASSIGN(const SensorReport report, Ingest(options));
  EXPECT_EQ(report.steps, 3);
  EXPECT_THAT(report.fields, ElementsAre("T__C_", "rh"));
  EXPECT_THAT(report.warnings, ElementsAre(HasSubstr("'T (C)' becomes field 'T__C_'")));
  ASSERT_OK_AND_ASSIGN(const Grid held, StoredVoxels(options.output, 1, "rh"));
  EXPECT_EQ(held.At(0, 0, 0), 0.5F);
  EXPECT_EQ(held.At(4, 4, 0), 0.25F);
  ASSERT_OK_AND_ASSIGN(const Grid coverage, StoredVoxels(options.output, 1, "coverage"));
  EXPECT_THAT(coverage.values, ::testing::Each(0.0F));
  ASSERT_OK_AND_ASSIGN(const Grid last, StoredVoxels(options.output, 2, "T__C_"));
  EXPECT_THAT(last.values, ::testing::Each(30.0F));
}

/// What nobody said follows the sensors: the default fovea lies where they are dense, although the
/// values that differ most from the background lie elsewhere.
TEST_F(SensorsTest, TheDefaultFoveaIsWhereTheSensorsAre) {
  std::vector<Row> rows = SomeRows(50, 1);
  for (Row& row : rows) {
    row.value = row.x > 48 ? 1000 : 0;
  }
  std::mt19937 random(8);
  for (int i = 0; i < 2000; ++i) {
    const auto place = [&] { return 4 + static_cast<float>(random() % 96) / 8; };
    const float x = place(), y = place(), z = place();
    rows.push_back({x, y, z, 0, 0});
  }
  const SensorOptions options = Options("a.f32", Records(rows));
  ASSERT_OK_AND_ASSIGN(const SensorReport report, Ingest(options));
  ASSERT_OK_AND_ASSIGN(const auto dataset, store::Dataset::Open(options.output));
  ASSERT_OK_AND_ASSIGN(const frames::FrameSpec spec, frames::DefaultSpec(*dataset));
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_NEAR(spec.fovea->at[axis], 5, 2.5);
    EXPECT_NEAR(report.density.fovea[axis], 5, 1);
  }
}

TEST_F(SensorsTest, ReachLeavesBackground) {
  SensorOptions options = Options("a.csv", "x,y,v\n1,1,5\n");
  options.fill = {4, -32};
  ASSERT_OK(Ingest(options).status());
  ASSERT_OK_AND_ASSIGN(const Grid values, StoredVoxels(options.output, 0, "v"));
  EXPECT_EQ(values.At(3, 3, 3), 5);
  EXPECT_EQ(values.At(4, 3, 3), -32);
}

TEST_F(SensorsTest, WhatFailsSaysWhereAndLeavesNothing) {
  SensorOptions options = Options("bad.csv", "x,y,v\n1,1,5\n1,oops,2\n");
  EXPECT_THAT(Ingest(options), FailsWith(absl::StatusCode::kInvalidArgument, "bad.csv:3: 'oops'"));
  EXPECT_FALSE(std::filesystem::exists(options.output));
  options.max_bad = 1;
  ASSERT_OK_AND_ASSIGN(const SensorReport report, Ingest(options));
  EXPECT_EQ(report.bad_lines, 1);
  EXPECT_THAT(Ingest(options), FailsWith(absl::StatusCode::kAlreadyExists, "--append"));

  SensorOptions nowhere = Options("out.csv", "x,y,v\n100,1,5\n");
  EXPECT_THAT(Ingest(nowhere), FailsWith(absl::StatusCode::kFailedPrecondition, "1 outside"));
  EXPECT_FALSE(std::filesystem::exists(nowhere.output));
  nowhere.inputs = {folder_ / "missing.csv"};
  EXPECT_THAT(Ingest(nowhere), FailsWith(absl::StatusCode::kNotFound, "missing.csv"));
  nowhere.inputs = {"-"};
  nowhere.box = {};
  EXPECT_THAT(Ingest(nowhere), FailsWith(absl::StatusCode::kInvalidArgument, "--bounds"));
  SensorOptions fine = Options("fine.csv", "x,y,v\n1,1,5\n");
  fine.box.voxel = Vec3{1e-4, 1, 1};
  EXPECT_THAT(Ingest(fine), FailsWith(absl::StatusCode::kOutOfRange, "--voxel"));
}

TEST_F(SensorsTest, AHugeBoxCostsItsReadings) {
  std::mt19937 random(1);
  std::vector<Row> rows;
  for (int i = 0; i < 12; ++i) {
    const auto place = [&] { return static_cast<float>(random() % 65536); };
    rows.push_back({place(), place(), place(), 0, static_cast<float>(i)});
  }
  SensorOptions options = Options("huge.f32", Records(rows));
  options.box.bounds = {Vec3{0, 0, 0}, Vec3{65536, 65536, 65536}};
  options.box.voxel = Vec3{1, 1, 1};
  options.chunk_edge = 8;
  ASSERT_OK(Ingest(options).status());
  ASSERT_OK_AND_ASSIGN(const auto dataset, store::Dataset::Open(options.output));
  ASSERT_OK_AND_ASSIGN(const auto source, dataset->OpenStep(0, "value", store::OnDamage::kFail));
  for (const Row& row : rows) {
    const Int3 at{static_cast<int64_t>(row.x), static_cast<int64_t>(row.y),
                  static_cast<int64_t>(row.z)};
    ASSERT_OK_AND_ASSIGN(const Grid voxel,
                         ExtractVoxels(*source, {at, {at.x + 1, at.y + 1, at.z + 1}}));
    EXPECT_NEAR(voxel.values[0], row.value, 1e-4);
  }
}

/// Everything within half a minute.
void WaitForSteps(const std::string& store, int64_t steps) {
  const Stopwatch watch;
  int64_t seen = -1;
  while (watch.ElapsedMs() < 30'000) {
    const auto dataset = store::Dataset::Open(store);
    seen = dataset.ok() ? (*dataset)->info().committed_steps : 0;
    if (seen >= steps) {
      break;
    }
    ::poll(nullptr, 0, 5);
  }
  EXPECT_EQ(seen, steps);
}

/// `fovea sensors -` on a pipe: steps appear while it runs, Ctrl-C drops the one that is open.
TEST_F(SensorsTest, AStreamIsCommittedAsItComes) {
  const std::string store = folder_ / "live.zarr";
  int ends[2];
  ASSERT_EQ(::pipe2(ends, O_CLOEXEC), 0);
  const pid_t child = ::fork();
  if (child == 0) {
    ::dup2(ends[0], STDIN_FILENO);
    const int null = ::open((folder_ / "report.json").c_str(), O_WRONLY | O_CREAT, 0666);
    ::dup2(null, STDOUT_FILENO);
    const std::string program = FOVEA_BINARY_DIR "/bin/fovea";
    ::execl(program.c_str(), "fovea", "sensors", "-", "-o", store.c_str(), "--bounds",
            "0,0,0,16,16,16", "--voxel", "1", "--step-seconds", "10", "--json", nullptr);
    ::_exit(127);
  }
  ASSERT_GT(child, 0);
  const auto send = [&](const std::string& text) {
    ASSERT_EQ(::write(ends[1], text.data(), text.size()), static_cast<ssize_t>(text.size()));
  };
  send("x,y,z,t,v\n1,1,1,2,5\n3,3,3,11,");  // the second line is not whole yet
  send("6\n");
  WaitForSteps(store, 1);
  send("1,1,1,25,7\n");
  WaitForSteps(store, 2);
  ::kill(child, SIGINT);
  int status = 0;
  ::waitpid(child, &status, 0);
  ::close(ends[0]);
  ::close(ends[1]);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << status;
  WaitForSteps(store, 2);
  const std::string report = fovea::testing::ReadFile(folder_ / "report.json");
  EXPECT_THAT(report, HasSubstr("\"incomplete\":1"));
  EXPECT_THAT(report, HasSubstr("\"interrupted\":true"));
}

}  // namespace
}  // namespace fovea::ingest
