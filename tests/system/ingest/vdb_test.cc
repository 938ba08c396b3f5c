#include <filesystem>
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

struct ScalarType {
  std::string type;
  double background;
  std::vector<double> values;  // as stored
};

class ScalarTypeTest : public VdbTest, public ::testing::WithParamInterface<ScalarType> {};

TEST_P(ScalarTypeTest, VoxelsComeBack) {
  const ScalarType& param = GetParam();
  VdbGrid grid;
  grid.type = param.type;
  grid.background = param.background;
  for (size_t i = 0; i < param.values.size(); ++i) {
    const auto at = static_cast<int64_t>(i);
    grid.voxels.push_back({{-20 + 7 * at, 3 * at, 2 - 5 * at}, param.values[i]});
  }
  WriteVdb(Path("a.vdb"), {grid});
  ASSERT_OK_AND_ASSIGN(const IngestReport report, Ingest(Options({"a.vdb"})));
  EXPECT_THAT(report.warnings, IsEmpty());
  EXPECT_EQ(report.origin.x, -20);
  ASSERT_OK_AND_ASSIGN(const Grid voxels, Voxels());
  Grid expected(voxels.box, static_cast<float>(param.background));
  for (const auto& voxel : grid.voxels) {
    expected.At(voxel.at.x - report.origin.x, voxel.at.y - report.origin.y,
                voxel.at.z - report.origin.z) = static_cast<float>(voxel.value);
  }
  const double range = 2000;  // no value of any type is beyond +-1000
  for (size_t i = 0; i < voxels.values.size(); ++i) {
    ASSERT_NEAR(voxels.values[i], expected.values[i], FourUlp(range)) << i;
  }
}

INSTANTIATE_TEST_SUITE_P(All, ScalarTypeTest,
                         ::testing::Values(ScalarType{"float", 0.25, {1, 2.5, -3, 1000}},
                                           ScalarType{"half", 0, {1, 2.5, -3, 1000}},
                                           ScalarType{"double", -1, {1, 2.5, -3, 1000}},
                                           ScalarType{"int32", 7, {1, -2, 3, 1000}},
                                           ScalarType{"int64", 0, {1, -2, 3, -1000}},
                                           ScalarType{"bool", 0, {1, 1, 1}},
                                           ScalarType{"mask", 0, {1, 1, 1}}),
                         [](const auto& tested) { return tested.param.type; });

TEST_F(VdbTest, ValuesThatFloatCannotHoldAreCountedAndSaid) {
  WriteVdb(Path("a.vdb"),
           {{.name = "i", .type = "int32", .voxels = {{{0, 0, 0}, 16777217}, {{1, 0, 0}, 5}}},
            {.name = "l", .type = "int64", .voxels = {{{0, 0, 0}, 9007199254740991.0}}},
            {.name = "d", .type = "double", .voxels = {{{0, 0, 0}, 0.1}, {{0, 1, 0}, 0.5}}}});
  ASSERT_OK_AND_ASSIGN(const IngestReport report, Ingest(Options({"a.vdb"})));
  ASSERT_EQ(report.warnings.size(), 3U);
  for (const std::string& warning : report.warnings) {
    EXPECT_THAT(warning, HasSubstr(": 1 values are not exact in float32"));
  }
}

TEST_F(VdbTest, TilesAndInactiveValuesAreTheGridsOwn) {
  // Like a level set: a shell of active voxels, inside it inactive tiles of minus the background.
  VdbGrid grid;
  grid.background = 3;
  grid.fills = {{{{0, 0, 0}, {64, 64, 64}}, 1, true}, {{{8, 8, 8}, {56, 56, 56}}, -3, false}};
  grid.voxels = {{{20, 20, 20}, -2, false}, {{5, 5, 5}, 0.5, true}};
  WriteVdb(Path("a.vdb"), {grid});
  ASSERT_OK_AND_ASSIGN(const IngestReport report, Ingest(Options({"a.vdb"})));
  EXPECT_EQ(report.dims, (Int3{64, 64, 64}));
  ASSERT_OK_AND_ASSIGN(const Grid voxels, Voxels());
  EXPECT_NEAR(voxels.At(0, 0, 0), 1, FourUlp(6));
  EXPECT_NEAR(voxels.At(63, 10, 40), 1, FourUlp(6));
  EXPECT_NEAR(voxels.At(8, 8, 8), -3, FourUlp(6));
  EXPECT_NEAR(voxels.At(40, 40, 40), -3, FourUlp(6));
  EXPECT_NEAR(voxels.At(20, 20, 20), -2, FourUlp(6));
  EXPECT_NEAR(voxels.At(5, 5, 5), 0.5, FourUlp(6));
}

TEST_F(VdbTest, HugeConstantTilesCostNothing) {
  // A box of 16384^3 voxels, one tile for each 4096^3: dense it would be 16 TB.
  VdbGrid grid;
  grid.fills = {{{{0, 0, 0}, {16384, 16384, 16384}}, -1, true}};
  WriteVdb(Path("a.vdb"), {grid});
  ASSERT_OK_AND_ASSIGN(const IngestReport report, Ingest(Options({"a.vdb"})));
  EXPECT_EQ(report.dims, (Int3{16384, 16384, 16384}));
  ASSERT_OK_AND_ASSIGN(const auto dataset, store::Dataset::Open(Path("out.zarr")));
  EXPECT_EQ(dataset->info().fields[0].minimum, -1);
  EXPECT_EQ(dataset->info().fields[0].maximum, -1);
}

TEST_F(VdbTest, AVolumeLargerThanMemoryIsRefused) {
  VdbGrid grid;
  grid.fills = {{{{0, 0, 0}, {8192, 4096, 4096}}, 1, true},
                {{{8192, 0, 0}, {16384, 4096, 4096}}, 2, true}};
  WriteVdb(Path("a.vdb"), {grid});
  EXPECT_THAT(Ingest(Options({"a.vdb"})),
              FailsWith(absl::StatusCode::kResourceExhausted, "a.vdb: one time step needs more"));
  EXPECT_FALSE(std::filesystem::exists(Path("out.zarr")));
}

TEST_F(VdbTest, FieldsHaveTheirOwnBackgroundsAndShareTheUnion) {
  WriteVdb(Path("a_1.vdb"), {{.name = "density", .background = 0, .voxels = {{{0, 0, 0}, 1}}},
                             {.name = "heat", .background = 20, .voxels = {{{-4, 5, 6}, 21}}}});
  WriteVdb(Path("a_2.vdb"), {{.name = "density", .background = 0, .voxels = {{{9, 9, 9}, 1}}},
                             {.name = "heat", .background = 30, .voxels = {{{1, 1, 1}, 31}}}});
  ASSERT_OK_AND_ASSIGN(const IngestReport report, Ingest(Options({"a_#.vdb"})));
  EXPECT_EQ(report.origin, (Int3{-4, 0, 0}));
  EXPECT_EQ(report.dims, (Int3{14, 10, 10}));
  ASSERT_OK_AND_ASSIGN(const Grid density, Voxels(1, "density"));
  ASSERT_OK_AND_ASSIGN(const Grid heat0, Voxels(0, "heat"));
  ASSERT_OK_AND_ASSIGN(const Grid heat1, Voxels(1, "heat"));
  EXPECT_NEAR(density.At(13, 9, 9), 1, FourUlp(1));
  EXPECT_NEAR(density.At(0, 0, 0), 0, FourUlp(1));
  EXPECT_NEAR(heat0.At(0, 5, 6), 21, FourUlp(31));
  EXPECT_NEAR(heat0.At(13, 9, 9), 20, FourUlp(31));
  EXPECT_NEAR(heat1.At(13, 9, 9), 30, FourUlp(31));
}

TEST_F(VdbTest, EmptyGridsAreStepsOfBackground) {
  WriteVdb(Path("a_1.vdb"), {{.voxels = {{{3, 3, 3}, 1}, {{12, 12, 12}, 2}}}});
  WriteVdb(Path("a_2.vdb"), {{.background = 0.5}});
  WriteVdb(Path("a_3.vdb"), {{.background = 0.5}});
  ASSERT_OK_AND_ASSIGN(const IngestReport report, Ingest(Options({"a_#.vdb"})));
  EXPECT_EQ(report.steps, 3);
  ASSERT_EQ(report.warnings.size(), 1U);
  EXPECT_THAT(report.warnings[0], HasSubstr("empty (all background) in 2 of 3 steps"));
  ASSERT_OK_AND_ASSIGN(const Grid voxels, Voxels(2));
  EXPECT_NEAR(voxels.At(4, 4, 4), 0.5, FourUlp(2));
}

TEST_F(VdbTest, NanAndInfinityBecomeBackground) {
  WriteVdb(Path("a.vdb"),
           {{.background = 2,
             .voxels = {{{0, 0, 0}, std::nan("")}, {{1, 0, 0}, INFINITY}, {{2, 2, 2}, 1}}},
            {.name = "d", .type = "double", .voxels = {{{0, 0, 0}, 1e300}}}});
  ASSERT_OK_AND_ASSIGN(const IngestReport report, Ingest(Options({"a.vdb"})));
  EXPECT_EQ(report.nonfinite_values, 3U);
  EXPECT_THAT(report.warnings, Contains(HasSubstr("'density': 2 NaN or infinite values")));
  ASSERT_OK_AND_ASSIGN(const Grid voxels, Voxels());
  EXPECT_NEAR(voxels.At(0, 0, 0), 2, FourUlp(2));
  EXPECT_NEAR(voxels.At(1, 0, 0), 2, FourUlp(2));
}

TEST_F(VdbTest, GridsThatAreNotScalarAreLeftOutOrRefusedByName) {
  WriteVdb(Path("a.vdb"), {{.voxels = {{{0, 0, 0}, 1}}},
                           {.name = "velocity", .type = "vec3s"},
                           {.name = "spray", .type = "points"},
                           {.name = "camera", .voxels = {{{0, 0, 0}, 1}}, .frustum = true}});
  IngestOptions options = Options({"a.vdb"});
  options.grids = {"spray"};
  EXPECT_THAT(Ingest(options), FailsWith(absl::StatusCode::kInvalidArgument, "particles"));
  options.grids = {"camera"};
  EXPECT_THAT(Ingest(options), FailsWith(absl::StatusCode::kInvalidArgument, "not linear"));
  options.grids = {"nothing"};
  EXPECT_THAT(Ingest(options), FailsWith(absl::StatusCode::kNotFound, "velocity (vec3s)"));
  options.grids = {};
  ASSERT_OK_AND_ASSIGN(const IngestReport report, Ingest(options));
  EXPECT_EQ(report.fields, (std::vector<std::string>{"density"}));
  EXPECT_EQ(report.warnings.size(), 3U);
}

TEST_F(VdbTest, GridsOfOneNameAndSharedTreesAreToldApart) {
  WriteVdb(Path("a.vdb"), {{.voxels = {{{0, 0, 0}, 1}, {{5, 0, 0}, 2}}},
                           {.voxels = {{{0, 0, 0}, 3}}},
                           {.name = "copy", .type = "shared"}});
  ASSERT_OK_AND_ASSIGN(const IngestReport report, Ingest(Options({"a.vdb"})));
  EXPECT_EQ(report.fields, (std::vector<std::string>{"density.0", "density.1", "copy"}));
  ASSERT_OK_AND_ASSIGN(const Grid second, Voxels(0, "density.1"));
  EXPECT_NEAR(second.At(0, 0, 0), 3, FourUlp(3));
  ASSERT_OK_AND_ASSIGN(const Grid copy, Voxels(0, "copy"));
  EXPECT_NEAR(copy.At(5, 0, 0), 2, FourUlp(3));
}

TEST_F(VdbTest, MetadataIsNotNeeded) {
  const std::vector<VdbGrid> grids{{.voxels = {{{-3, 4, 5}, 1}, {{6, 7, 8}, 2}}},
                                   {.name = "b", .voxels = {{{0, 0, 0}, 2}}}};
  WriteVdb(Path("a.vdb"), grids, {.stats_metadata = false});
  WriteVdb(Path("b.vdb"), grids, {.grid_offsets = false});
  for (const std::string name : {"a.vdb", "b.vdb"}) {
    IngestOptions options = Options({name});
    options.output = Path(name + ".zarr");
    ASSERT_OK_AND_ASSIGN(const IngestReport report, Ingest(options));
    EXPECT_EQ(report.origin, (Int3{-3, 0, 0})) << name;
    EXPECT_EQ(report.dims, (Int3{10, 8, 9})) << name;
    EXPECT_THAT(report.warnings, IsEmpty()) << name;
  }
}

TEST_F(VdbTest, MetadataThatLiesIsFoundOutAndTheSeriesBegunAgain) {
  WriteVdb(Path("a_1.vdb"), {{.voxels = {{{0, 0, 0}, 1}}}});
  WriteVdb(Path("a_2.vdb"), {{.voxels = {{{0, 0, 0}, 1}, {{40, 0, 0}, 2}}}},
           {.declared_box = Box3{{0, 0, 0}, {1, 1, 1}}});
  ASSERT_OK_AND_ASSIGN(const IngestReport report, Ingest(Options({"a_#.vdb"})));
  EXPECT_EQ(report.steps, 2);
  EXPECT_EQ(report.dims, (Int3{41, 1, 1}));
  EXPECT_THAT(report.warnings, Contains(HasSubstr("a_2.vdb: grid 'density' has active voxels")));
  ASSERT_OK_AND_ASSIGN(const Grid voxels, Voxels(1));
  EXPECT_NEAR(voxels.At(40, 0, 0), 2, FourUlp(2));
}

TEST_F(VdbTest, MetadataThatClaimsTooMuchIsNotBelieved) {
  WriteVdb(Path("a.vdb"), {{.voxels = {{{0, 0, 0}, 1}, {{5, 0, 0}, 2}}}},
           {.declared_box = Box3{{-1'000'000'000, 0, 0}, {6, 1, 1}}});
  ASSERT_OK_AND_ASSIGN(const IngestReport report, Ingest(Options({"a.vdb"})));
  EXPECT_EQ(report.dims, (Int3{6, 1, 1}));
  EXPECT_THAT(report.warnings, Contains(HasSubstr("says the metadata")));
  WriteVdb(Path("b.vdb"), {{.voxels = {{{0, 0, 0}, 1}, {{70'000, 0, 0}, 2}}}});
  IngestOptions options = Options({"b.vdb"});
  options.output = Path("b.zarr");
  EXPECT_THAT(Ingest(options), FailsWith(absl::StatusCode::kOutOfRange, "over 65536 voxels"));
}

TEST_F(VdbTest, TransformAndUnitAreKept) {
  WriteVdb(Path("a.vdb"), {{.voxels = {{{4, 0, 0}, 1}, {{5, 1, 1}, 1}},
                            .voxel_size = 0.25,
                            .origin = {10, 20, 30},
                            .unit = "m"}});
  ASSERT_OK(Ingest(Options({"a.vdb"})));
  const store::DatasetInfo info = Info();
  EXPECT_EQ(info.origin, (Int3{4, 0, 0}));
  EXPECT_EQ(info.world_unit, "m");
  const Vec3 corner = info.index_to_world.TransformPoint({0, 0, 0});
  EXPECT_NEAR(corner.x, 10 + 3.5 * 0.25, 1e-12);
  EXPECT_NEAR(corner.z, 30 - 0.5 * 0.25, 1e-12);
}

TEST_F(VdbTest, AMissingGridIsNamedSkippedOrHeld) {
  WriteVdb(Path("a_1.vdb"),
           {{.voxels = {{{0, 0, 0}, 1}}}, {.name = "t", .voxels = {{{0, 0, 0}, 5}}}});
  WriteVdb(Path("a_2.vdb"), {{.voxels = {{{0, 0, 0}, 2}}}});
  IngestOptions options = Options({"a_#.vdb"});
  EXPECT_THAT(Ingest(options),
              FailsWith(absl::StatusCode::kNotFound, "a_2.vdb: there is no grid 't'"));
  options.on_missing = OnMissing::kHold;
  ASSERT_OK(Ingest(options));
  ASSERT_OK_AND_ASSIGN(const Grid density, Voxels(1, "density"));
  ASSERT_OK_AND_ASSIGN(const Grid held, Voxels(1, "t"));
  EXPECT_NEAR(density.At(0, 0, 0), 2, FourUlp(5));
  EXPECT_NEAR(held.At(0, 0, 0), 5, FourUlp(5));
}

TEST_F(VdbTest, AHeldStepIsTheOneBefore) {
  WriteVdb(Path("a_1.vdb"), {{.voxels = {{{0, 0, 0}, 1}}}});
  WriteVdb(Path("a_2.vdb"), {{.voxels = {{{0, 0, 0}, 2}}}});
  WriteVdb(Path("a_4.vdb"), {{.voxels = {{{0, 0, 0}, 4}}}});
  IngestOptions options = Options({"a_#.vdb"});
  EXPECT_THAT(Ingest(options), FailsWith(absl::StatusCode::kNotFound, "a_3.vdb"));
  options.on_missing = OnMissing::kHold;
  ASSERT_OK_AND_ASSIGN(const IngestReport report, Ingest(options));
  EXPECT_EQ(report.steps, 4);
  ASSERT_OK_AND_ASSIGN(const auto dataset, store::Dataset::Open(options.output));
  ASSERT_OK_AND_ASSIGN(const auto number, dataset->FrameNumber(2));
  EXPECT_EQ(number, 3);
  ASSERT_OK_AND_ASSIGN(const Grid held, Voxels(2));
  EXPECT_NEAR(held.At(0, 0, 0), 2, FourUlp(4));
}

TEST_F(VdbTest, StepsAreAppended) {
  WriteVdb(Path("a_1.vdb"), {{.voxels = {{{0, 0, 0}, 1}, {{9, 9, 9}, 1}}}});
  WriteVdb(Path("a_2.vdb"), {{.voxels = {{{5, 5, 5}, 2}}}});
  WriteVdb(Path("a_3.vdb"), {{.voxels = {{{10, 5, 5}, 2}}}});
  ASSERT_OK(Ingest(Options({"a_1.vdb"})));
  EXPECT_THAT(Ingest(Options({"a_2.vdb"})),
              FailsWith(absl::StatusCode::kAlreadyExists, "--append"));
  IngestOptions more = Options({"a_2.vdb"});
  more.append = true;
  ASSERT_OK_AND_ASSIGN(const IngestReport report, Ingest(more));
  EXPECT_EQ(report.steps, 1);
  EXPECT_EQ(Info().committed_steps, 2);
  ASSERT_OK_AND_ASSIGN(const Grid voxels, Voxels(1));
  EXPECT_NEAR(voxels.At(5, 5, 5), 2, FourUlp(2));
  more.inputs = {Path("a_3.vdb")};
  EXPECT_THAT(Ingest(more),
              FailsWith(absl::StatusCode::kInvalidArgument, "reaches from (10, 5, 5)"));
  EXPECT_EQ(Info().committed_steps, 2);
}

TEST_F(VdbTest, ProgressStopsBetweenStepsAndWhatIsDoneStays) {
  IngestOptions options = Options({});
  options.inputs = {FOVEA_SOURCE_DIR "/tests/data/plume/plume_####.vdb"};
  const auto three = [](const IngestProgress& progress) { return progress.steps_done < 3; };
  EXPECT_THAT(Ingest(options, three), FailsWith(absl::StatusCode::kCancelled, "3 steps in"));
  EXPECT_EQ(Info().committed_steps, 3);
  const auto at_once = [](const IngestProgress&) { return false; };
  options.output = Path("none.zarr");
  EXPECT_THAT(Ingest(options, at_once), FailsWith(absl::StatusCode::kCancelled, ""));
  EXPECT_FALSE(std::filesystem::exists(options.output));
}

}  // namespace
}  // namespace fovea::ingest
