// VDB files as people have them: vectors, particles, level sets, turned and stretched transforms,
// transforms that change from step to step.

#include <cmath>
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
using ::fovea::testing::VdbGrid;
using ::fovea::testing::VdbVoxel;
using ::fovea::testing::WriteVdb;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

class VdbKindsTest : public ::testing::Test {
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

VdbGrid Velocity(const std::string& type, bool staggered = false) {
  return {.name = "velocity",
          .type = type,
          .voxels = {{.at = {0, 0, 0}, .vector = {3, 4, 12}},
                     {.at = {1, 0, 0}, .vector = {-5, 0, 0}},
                     {.at = {0, 1, 0}, .vector = {0, 2, 0}},
                     {.at = {0, 0, 1}, .vector = {0, 0, 4}}},
          .staggered = staggered};
}

class VectorTypeTest : public VdbKindsTest, public ::testing::WithParamInterface<std::string> {};

TEST_P(VectorTypeTest, LengthAndComponentsAreFields) {
  WriteVdb(Path("a.vdb"), {Velocity(GetParam())});
  IngestOptions options = Options({"a.vdb"});
  options.grids = {"velocity.magnitude", "velocity.x", "velocity.z"};
  ASSERT_OK_AND_ASSIGN(const IngestReport report, Ingest(options));
  EXPECT_EQ(report.fields, options.grids);
  ASSERT_OK_AND_ASSIGN(const Grid length, Voxels(0, "velocity.magnitude"));
  EXPECT_NEAR(length.At(0, 0, 0), 13, FourUlp(13));
  EXPECT_NEAR(length.At(1, 0, 0), 5, FourUlp(13));
  ASSERT_OK_AND_ASSIGN(const Grid x, Voxels(0, "velocity.x"));
  EXPECT_NEAR(x.At(0, 0, 0), 3, FourUlp(8));
  EXPECT_NEAR(x.At(1, 0, 0), -5, FourUlp(8));
  ASSERT_OK_AND_ASSIGN(const Grid z, Voxels(0, "velocity.z"));
  EXPECT_NEAR(z.At(0, 0, 0), 12, FourUlp(12));
  EXPECT_NEAR(z.At(0, 0, 1), 4, FourUlp(12));
}

INSTANTIATE_TEST_SUITE_P(All, VectorTypeTest, ::testing::Values("vec3s", "vec3d", "vec3i"),
                         [](const auto& test) { return test.param; });

TEST_F(VdbKindsTest, AVectorByItsNameIsItsLengthAndSaid) {
  WriteVdb(Path("a.vdb"), {Velocity("vec3s")});
  IngestOptions options = Options({"a.vdb"});
  options.grids = {"velocity"};
  ASSERT_OK_AND_ASSIGN(const IngestReport report, Ingest(options));
  EXPECT_EQ(report.fields, (std::vector<std::string>{"velocity.magnitude"}));
  EXPECT_THAT(report.warnings, Contains(HasSubstr("'velocity' holds vectors")));
}

/// Faces: x of voxel (0, 0, 0) is 3 before it and -5 behind it.
TEST_F(VdbKindsTest, StaggeredComponentsAreBroughtToTheCentres) {
  WriteVdb(Path("a.vdb"), {Velocity("vec3s", /*staggered=*/true)});
  IngestOptions options = Options({"a.vdb"});
  options.grids = {"velocity.x", "velocity.y", "velocity.z", "velocity.magnitude"};
  ASSERT_OK(Ingest(options));
  const double expected[] = {(3 - 5) / 2.0, (4 + 2) / 2.0, (12 + 4) / 2.0};
  for (int axis = 0; axis < 3; ++axis) {
    ASSERT_OK_AND_ASSIGN(const Grid part, Voxels(0, options.grids[static_cast<size_t>(axis)]));
    EXPECT_NEAR(part.At(0, 0, 0), expected[axis], FourUlp(16)) << axis;
  }
  ASSERT_OK_AND_ASSIGN(const Grid length, Voxels(0, "velocity.magnitude"));
  EXPECT_NEAR(length.At(0, 0, 0), std::sqrt(1.0 + 9 + 64), FourUlp(16));
}

TEST_F(VdbKindsTest, VectorsAreNotTakenUnlessAskedForAndTheWarningSaysHow) {
  WriteVdb(Path("a.vdb"), {{.voxels = {{{0, 0, 0}, 1}}}, Velocity("vec3s")});
  ASSERT_OK_AND_ASSIGN(const IngestReport report, Ingest(Options({"a.vdb"})));
  EXPECT_EQ(report.fields, (std::vector<std::string>{"density"}));
  EXPECT_THAT(report.warnings, Contains(HasSubstr("--grid velocity.magnitude")));
}

TEST_F(VdbKindsTest, ParticlesAreRefusedWithAWordOnWhatToDo) {
  WriteVdb(Path("a.vdb"), {{.name = "liquid", .type = "points"}});
  EXPECT_THAT(Ingest(Options({"a.vdb"})),
              FailsWith(absl::StatusCode::kInvalidArgument, "points (particles)"));
  WriteVdb(Path("b.vdb"), {{.name = "liquid", .type = "points"}, Velocity("vec3s")});
  EXPECT_THAT(Ingest(Options({"b.vdb"})),
              FailsWith(absl::StatusCode::kInvalidArgument, "points (particles)"));
  EXPECT_THAT(Ingest(Options({"b.vdb"})),
              FailsWith(absl::StatusCode::kInvalidArgument, "velocity (vec3s)"));
}

/// A quarter turn about z, voxels of 0.5 x 1 x 2, moved: index (i, j, k) lies at world
/// (10 - j, i / 2, 2 k). Ours begins half a voxel earlier.
TEST_F(VdbKindsTest, TurnedAndStretchedTransformsAreKept) {
  WriteVdb(Path("a.vdb"), {{.voxels = {{{-3, -2, -1}, 1}, {{4, 5, 6}, 2}},
                            .scale = {0.5, 1, 2},
                            .turn_deg = 90,
                            .origin = {10, 0, 0}}});
  ASSERT_OK(Ingest(Options({"a.vdb"})));
  const store::DatasetInfo info = Info();
  EXPECT_EQ(info.origin, (Int3{-3, -2, -1}));
  EXPECT_EQ(info.hierarchy.dims(), (Int3{8, 8, 8}));
  const Vec3 centre = info.index_to_world.TransformPoint({0.5, 0.5, 0.5});  // of index (-3, -2, -1)
  EXPECT_NEAR(centre.x, 12, 1e-9);
  EXPECT_NEAR(centre.y, -1.5, 1e-9);
  EXPECT_NEAR(centre.z, -2, 1e-9);
  ASSERT_OK_AND_ASSIGN(const Grid voxels, Voxels());
  EXPECT_NEAR(voxels.At(0, 0, 0), 1, FourUlp(2));
  EXPECT_NEAR(voxels.At(7, 7, 7), 2, FourUlp(2));
}

/// Voxels of x = 0 .. 7 whose value is their world position along x.
VdbGrid Ramp(double voxel_size, double origin) {
  VdbGrid grid{.voxel_size = voxel_size, .origin = {origin, 0, 0}};
  for (int64_t z = 0; z < 8; ++z) {
    for (int64_t y = 0; y < 8; ++y) {
      for (int64_t x = 0; x < 8; ++x) {
        grid.voxels.push_back({{x, y, z}, voxel_size * static_cast<double>(x) + origin});
      }
    }
  }
  return grid;
}

TEST_F(VdbKindsTest, TransformsThatChangeNeedARegistrationAndTheErrorNamesIt) {
  WriteVdb(Path("s_1.vdb"), {Ramp(1, 0)});
  WriteVdb(Path("s_2.vdb"), {Ramp(0.5, 0)});
  EXPECT_THAT(Ingest(Options({"s_#.vdb"})),
              FailsWith(absl::StatusCode::kInvalidArgument, "--registration"));
}

TEST_F(VdbKindsTest, RegistrationByIndexKeepsVoxelsAndSaysWhatDiffers) {
  WriteVdb(Path("s_1.vdb"), {Ramp(1, 0)});
  WriteVdb(Path("s_2.vdb"), {Ramp(0.5, 3)});
  IngestOptions options = Options({"s_#.vdb"});
  options.registration = Registration::kIndex;
  ASSERT_OK_AND_ASSIGN(const IngestReport report, Ingest(options));
  EXPECT_EQ(report.dims, (Int3{8, 8, 8}));
  EXPECT_THAT(report.warnings, Contains(HasSubstr("voxel size (1, 1, 1) and (0.5, 0.5, 0.5)")));
  ASSERT_OK_AND_ASSIGN(const Grid second, Voxels(1));
  EXPECT_NEAR(second.At(4, 0, 0), 5, FourUlp(7));
  EXPECT_NEAR(Info().index_to_world.Spacing().x, 1, 1e-12);
}

TEST_F(VdbKindsTest, RegistrationByWorldMovesWholeVoxelsWithoutLoss) {
  WriteVdb(Path("s_1.vdb"), {Ramp(1, 0)});
  WriteVdb(Path("s_2.vdb"), {Ramp(1, -3)});
  IngestOptions options = Options({"s_#.vdb"});
  options.registration = Registration::kWorld;
  ASSERT_OK_AND_ASSIGN(const IngestReport report, Ingest(options));
  EXPECT_EQ(report.origin, (Int3{-3, 0, 0}));
  EXPECT_EQ(report.dims, (Int3{11, 8, 8}));
  EXPECT_THAT(report.warnings, Contains(HasSubstr("origin (0, 0, 0) and (-3, 0, 0)")));
  ASSERT_OK_AND_ASSIGN(const Grid first, Voxels(0));
  ASSERT_OK_AND_ASSIGN(const Grid second, Voxels(1));
  EXPECT_EQ(first.At(2, 4, 4), 0);   // outside the first grid
  EXPECT_EQ(second.At(9, 4, 4), 0);  // outside the second
  for (int64_t x = 0; x < 8; ++x) {
    EXPECT_NEAR(first.At(x + 3, 4, 4), static_cast<double>(x), FourUlp(10));
    EXPECT_NEAR(second.At(x, 4, 4), static_cast<double>(x) - 3, FourUlp(10));
  }
}

/// Trilinear interpolation is exact on a ramp, away from the ends.
TEST_F(VdbKindsTest, RegistrationByWorldResamplesOtherVoxelSizes) {
  WriteVdb(Path("s_1.vdb"), {Ramp(0.5, 0.1)});
  WriteVdb(Path("s_2.vdb"), {Ramp(1, 0)});
  IngestOptions options = Options({"s_#.vdb"});
  options.registration = Registration::kWorld;
  ASSERT_OK_AND_ASSIGN(const IngestReport report, Ingest(options));
  EXPECT_THAT(report.warnings, Contains(HasSubstr("voxel size (0.5, 0.5, 0.5) and (1, 1, 1)")));
  const store::DatasetInfo info = Info();
  ASSERT_OK_AND_ASSIGN(const Grid second, Voxels(1));
  int compared = 0;
  for (int64_t x = 0; x < info.hierarchy.dims().x; ++x) {
    const Int3 middle{x, info.hierarchy.dims().y / 2, info.hierarchy.dims().z / 2};
    const double world =
        info.index_to_world
            .TransformPoint({static_cast<double>(x) + 0.5, static_cast<double>(middle.y) + 0.5,
                             static_cast<double>(middle.z) + 0.5})
            .x;
    if (world >= 0 && world <= 7) {
      EXPECT_NEAR(second.At(x, middle.y, middle.z), world, 1e-5) << x;
      ++compared;
    }
  }
  EXPECT_GE(compared, 13);
}

TEST_F(VdbKindsTest, GridsThatLieOtherwiseAreResampledNotLeftOutWhenRegisteredByWorld) {
  VdbGrid coarse = Ramp(2, 0);
  coarse.name = "coarse";
  WriteVdb(Path("a.vdb"), {Ramp(1, 0), coarse});
  IngestOptions options = Options({"a.vdb"});
  options.registration = Registration::kWorld;
  ASSERT_OK_AND_ASSIGN(const IngestReport report, Ingest(options));
  EXPECT_EQ(report.fields, (std::vector<std::string>{"density", "coarse"}));
  ASSERT_OK_AND_ASSIGN(const Grid resampled, Voxels(0, "coarse"));
  const Int3 at{5 - report.origin.x, 4 - report.origin.y, 4 - report.origin.z};
  EXPECT_NEAR(resampled.At(at.x, at.y, at.z), 5, 1e-5);
}

TEST_F(VdbKindsTest, AppendedStepsAreRegisteredOnWhatTheStoreHas) {
  WriteVdb(Path("s_1.vdb"), {Ramp(1, 0)});
  WriteVdb(Path("s_2.vdb"), {{.voxels = {{{1, 0, 0}, 7}}, .origin = {3, 2, 0}}});
  IngestOptions options = Options({"s_1.vdb"});
  ASSERT_OK(Ingest(options));
  options.inputs = {folder_ / "s_2.vdb"};
  options.append = true;
  EXPECT_THAT(Ingest(options), FailsWith(absl::StatusCode::kInvalidArgument, "--registration"));
  options.registration = Registration::kWorld;
  ASSERT_OK(Ingest(options));
  ASSERT_OK_AND_ASSIGN(const Grid second, Voxels(1));
  EXPECT_NEAR(second.At(4, 2, 0), 7, FourUlp(7));
  EXPECT_EQ(second.At(1, 0, 0), 0);
}

/// Blender writes empty grids with a box from INT_MAX to INT_MIN.
TEST_F(VdbKindsTest, EmptyGridsWithImpossibleBoxesAreEmpty) {
  constexpr int64_t kMost = 2147483647;
  WriteVdb(Path("s_1.vdb"), {{.voxels = {{{0, 0, 0}, 1}, {{3, 3, 3}, 2}}}});
  WriteVdb(Path("s_2.vdb"), {{}},
           {.declared_box = Box3{{kMost, kMost, kMost}, {-kMost, -kMost, -kMost}}});
  ASSERT_OK_AND_ASSIGN(const IngestReport report, Ingest(Options({"s_#.vdb"})));
  EXPECT_EQ(report.dims, (Int3{4, 4, 4}));
  ASSERT_OK_AND_ASSIGN(const Grid second, Voxels(1));
  EXPECT_EQ(second.At(3, 3, 3), 0);
}

}  // namespace
}  // namespace fovea::ingest
