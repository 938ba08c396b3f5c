// On the weather radar of FOVEA_TEST_DATA; registered only where that was set.

#include <algorithm>
#include <cmath>
#include <fstream>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "ingest/sensors/sensor_ingest.h"
#include "tests/support/status_matchers.h"
#include "tests/system/ingest/ingested.h"

namespace fovea::ingest {
namespace {

using ::fovea::testing::ReadFile;
using ::fovea::testing::StoredVoxels;
using ::fovea::testing::TemporaryFolder;
using ::testing::ElementsAre;

const char* const kRadar = FOVEA_TEST_DATA "/sensors/radar_helchteren_points/";

SensorOptions Options(const std::string& input, const std::string& output) {
  SensorOptions options;
  options.inputs = {input};
  options.output = output;
  options.fields = {"dbz"};
  options.box.bounds = {Vec3{-200000, -200000, 0}, Vec3{200000, 200000, 16000}};
  options.box.voxel = Vec3{4000, 4000, 1000};
  return options;
}

/// Every fourth reading as text, rounded to a decimal or two, is every fourth record: but for
/// readings that rounding moved into the next voxel, the same voxels.
TEST(RadarTest, TextAndRecordsAgree) {
  const TemporaryFolder folder;
  const std::string all = ReadFile(std::string(kRadar) + "scan00.f32");
  std::string some;
  for (size_t at = 0; at + 20 <= all.size(); at += 80) {
    some += all.substr(at, 20);
  }
  std::ofstream(folder / "every4th.f32", std::ios::binary) << some;
  const SensorOptions records = Options(folder / "every4th.f32", folder / "records.zarr");
  const SensorOptions text =
      Options(std::string(kRadar) + "scan00_every4th.csv", folder / "text.zarr");
  ASSERT_OK_AND_ASSIGN(const SensorReport of_records, IngestSensors(records, nullptr));
  ASSERT_OK_AND_ASSIGN(const SensorReport of_text, IngestSensors(text, nullptr));
  EXPECT_EQ(of_records.counts.read, of_text.counts.read);
  EXPECT_NEAR(static_cast<double>(of_records.measured_voxels),
              static_cast<double>(of_text.measured_voxels), 20);
  ASSERT_OK_AND_ASSIGN(const Grid a, StoredVoxels(records.output, 0, "dbz"));
  ASSERT_OK_AND_ASSIGN(const Grid b, StoredVoxels(text.output, 0, "dbz"));
  double sum = 0;
  for (size_t i = 0; i < a.values.size(); ++i) {
    sum += std::abs(a.values[i] - b.values[i]);
  }
  EXPECT_LT(sum / static_cast<double>(a.values.size()), 0.02);  // dBZ, of a range of 85
}

TEST(RadarTest, FourScansAreFourStepsAroundTheRadar) {
  const TemporaryFolder folder;
  const SensorOptions options = Options(std::string(kRadar) + "scan##.f32", folder / "r.zarr");
  ASSERT_OK_AND_ASSIGN(const SensorReport report, IngestSensors(options, nullptr));
  EXPECT_EQ(report.steps, 4);
  EXPECT_EQ(report.counts.read, 242953 + 245344 + 247822 + 248206);
  EXPECT_EQ(report.counts.read, report.counts.used + report.counts.outside);
  // Densest near the radar, which stands at 0, 0: voxel 50, 50.
  EXPECT_NEAR(report.density.fovea.x, 50, 8);
  EXPECT_NEAR(report.density.fovea.y, 50, 8);
}

}  // namespace
}  // namespace fovea::ingest
