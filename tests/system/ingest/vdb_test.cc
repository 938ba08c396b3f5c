#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "ingest/ingest.h"
#include "tests/support/status_matchers.h"
#include "tests/support/vdb_files.h"
#include "tests/system/ingest/ingested.h"

namespace fovea::ingest {
namespace {

using ::fovea::testing::FailsWith;
using ::fovea::testing::FourUlp;
using ::fovea::testing::StoredVoxels;
using ::fovea::testing::TemporaryFolder;
using ::fovea::testing::VdbFileOptions;
using ::fovea::testing::VdbGrid;
using ::fovea::testing::WriteVdb;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

class VdbTest : public ::testing::Test {
 protected:
  [[nodiscard]] IngestOptions Options(const std::vector<std::string>& names) const {
    IngestOptions options;
    for (const std::string& name : names) {
      options.inputs.push_back(folder_ / name);
    }
    options.output = folder_ / "out.zarr";
    return options;
  }
  [[nodiscard]] StatusOr<Grid> Voxels(int64_t step = 0,
                                      const std::string& field = "density") const {
    return StoredVoxels(folder_ / "out.zarr", step, field);
  }
  [[nodiscard]] std::string Path(const std::string& name) const { return folder_ / name; }
  [[nodiscard]] store::DatasetInfo Info() const {
    const auto dataset = store::Dataset::Open(folder_ / "out.zarr");
    return dataset.ok() ? (*dataset)->info() : store::DatasetInfo();
  }

  TemporaryFolder folder_;
};

TEST_F(VdbTest, PlumeSampleIsIngestedWhole) {
  IngestOptions options = Options({});
  options.inputs = {FOVEA_SOURCE_DIR "/tests/data/plume/plume_####.vdb"};
  ASSERT_OK_AND_ASSIGN(const IngestReport report, Ingest(options));
  EXPECT_EQ(report.steps, 15);
  EXPECT_EQ(report.dims, (Int3{36, 36, 62}));
  EXPECT_EQ(report.origin, (Int3{1, 1, 1}));
  EXPECT_EQ(report.fields, (std::vector<std::string>{"density", "temperature"}));
  EXPECT_THAT(report.warnings, IsEmpty());
  ASSERT_OK_AND_ASSIGN(const auto dataset, store::Dataset::Open(options.output));
  EXPECT_EQ(dataset->info().committed_steps, 15);
  EXPECT_EQ(dataset->info().default_field, "density");
  ASSERT_OK_AND_ASSIGN(const auto number, dataset->FrameNumber(14));
  EXPECT_EQ(number, 57);
  ASSERT_OK_AND_ASSIGN(const int64_t time, dataset->TimeNs(14));
  EXPECT_EQ(time, 2375000000);
  // Voxel (0, 0, 0) covers half a voxel before the centre of index (1, 1, 1), 0.0625 a voxel.
  const Vec3 corner = dataset->info().index_to_world.TransformPoint({0, 0, 0});
  EXPECT_NEAR(corner.x, 0.03125, 1e-9);
  EXPECT_NEAR(dataset->info().index_to_world.Spacing().z, 0.0625, 1e-9);
}

}  // namespace
}  // namespace fovea::ingest
