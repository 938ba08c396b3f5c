// On the real volumes of FOVEA_TEST_DATA; registered only where that was set.

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "ingest/ingest.h"
#include "ingest/raw_format.h"
#include "tests/support/status_matchers.h"
#include "tests/system/ingest/ingested.h"

namespace fovea::ingest {
namespace {

using ::fovea::testing::FourUlp;
using ::fovea::testing::ReadFile;
using ::fovea::testing::StoredVoxels;
using ::fovea::testing::TemporaryFolder;
using ::testing::Contains;
using ::testing::HasSubstr;

std::string DataPath(const std::string& name) {
  return std::string(FOVEA_TEST_DATA "/") + name;  // where it was when this was configured
}

TEST(SharedDataTest, BlenderPlumeWithEmptyAndVectorGrids) {
  const TemporaryFolder folder;
  IngestOptions options;
  options.output = folder / "out.zarr";
  for (const int frame : {1, 30, 58, 60}) {  // flame is empty in the last two
    options.inputs.push_back(
        DataPath(fmt::format("vdb/blender_plume_r64/fluid_data_{:04d}.vdb", frame)));
  }
  options.on_missing = OnMissing::kSkip;
  ASSERT_OK_AND_ASSIGN(const IngestReport report, Ingest(options));
  EXPECT_EQ(report.steps, 4);
  EXPECT_EQ(report.fields, (std::vector<std::string>{"density", "shadow", "temperature", "flame"}));
  EXPECT_EQ(report.dims, (Int3{38, 38, 64}));  // shadow is dense
  EXPECT_THAT(report.warnings, Contains(HasSubstr("'velocity' is left out: type vec3s")));
  EXPECT_THAT(report.warnings, Contains(HasSubstr("'flame' is empty (all background) in 2 of 4")));
  ASSERT_OK_AND_ASSIGN(const auto dataset, store::Dataset::Open(options.output));
  ASSERT_OK_AND_ASSIGN(const auto number, dataset->FrameNumber(3));
  EXPECT_EQ(number, 60);
  ASSERT_OK_AND_ASSIGN(const FieldStats shadow, dataset->Stats(0, "shadow"));
  EXPECT_EQ(shadow.minimum, -1);
  EXPECT_EQ(shadow.maximum, -1);
  ASSERT_OK_AND_ASSIGN(const FieldStats flame, dataset->Stats(3, "flame"));
  EXPECT_EQ(flame.maximum, 0);
}

TEST(SharedDataTest, ToothBigEndianWithOddSizes) {
  const TemporaryFolder folder;
  IngestOptions options;
  options.inputs = {DataPath("volumes/tooth_ct_103x94x161_u16be.raw")};
  options.output = folder / "tooth.zarr";
  ASSERT_OK_AND_ASSIGN(options.raw, ParseRawFormat("103x94x161:uint16:be"));
  ASSERT_OK(Ingest(options));
  ASSERT_OK_AND_ASSIGN(const Grid voxels, StoredVoxels(options.output, 0, "density"));
  const std::string bytes = ReadFile(options.inputs[0]);
  ASSERT_EQ(bytes.size(), 2 * voxels.values.size());
  for (size_t i = 0; i < voxels.values.size(); ++i) {
    const int value = static_cast<unsigned char>(bytes[2 * i]) * 256 +
                      static_cast<unsigned char>(bytes[2 * i + 1]);
    ASSERT_NEAR(voxels.values[i], value, FourUlp(1300)) << i;
  }
}

TEST(SharedDataTest, Bonsai) {
  const TemporaryFolder folder;
  IngestOptions options;
  options.inputs = {DataPath("volumes/bonsai_ct_256x256x256_u8.raw")};
  options.output = folder / "bonsai.zarr";
  ASSERT_OK_AND_ASSIGN(options.raw, ParseRawFormat("256x256x256:uint8"));
  ASSERT_OK(Ingest(options));
  ASSERT_OK_AND_ASSIGN(const Grid voxels, StoredVoxels(options.output, 0, "density"));
  const std::string bytes = ReadFile(options.inputs[0]);
  ASSERT_EQ(bytes.size(), voxels.values.size());
  for (size_t i = 0; i < voxels.values.size(); ++i) {
    ASSERT_NEAR(voxels.values[i], static_cast<unsigned char>(bytes[i]), FourUlp(255)) << i;
  }
}

TEST(SharedDataTest, RawFramesAreASequence) {
  const TemporaryFolder folder;
  IngestOptions options;
  options.inputs = {DataPath("fourd/fmri_raw_i16/t00#.raw")};
  options.output = folder / "fmri.zarr";
  options.frames_per_second = 2;
  ASSERT_OK_AND_ASSIGN(options.raw, ParseRawFormat("64x64x21:int16:le"));
  ASSERT_OK_AND_ASSIGN(const IngestReport report, Ingest(options));
  EXPECT_EQ(report.steps, 10);
  ASSERT_OK_AND_ASSIGN(const auto dataset, store::Dataset::Open(options.output));
  ASSERT_OK_AND_ASSIGN(const int64_t time, dataset->TimeNs(9));
  EXPECT_EQ(time, 4'500'000'000);
}

}  // namespace
}  // namespace fovea::ingest
