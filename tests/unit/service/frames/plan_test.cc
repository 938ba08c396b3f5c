#include "service/frames/plan.h"

#include <fstream>

#include "engine/base/stopwatch.h"
#include "engine/store/dataset_writer.h"
#include "engine/store/layout.h"
#include "service/frames/frames.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temporary_folder.h"

namespace fovea::frames {
namespace {

using ::fovea::testing::FailsWith;
using ::fovea::testing::TemporaryFolder;

/// A store of 65536^3 voxels in chunks of `edge`; step s holds s + 1 chunks of detail, side by side
/// at the finest level, the last of them at `chunk`.
Status MakeHugeStore(const std::string& path, int64_t edge, int64_t steps, const Int3& chunk) {
  store::DatasetInfo info;
  FOVEA_ASSIGN_OR_RETURN(info.hierarchy, Hierarchy::Make({65536, 65536, 65536}));
  info.chunk_edge = edge;
  info.default_field = "density";
  info.fields.push_back({"density"});
  FOVEA_ASSIGN_OR_RETURN(const auto writer, store::DatasetWriter::Create(path, info));
  CoefficientSet set;
  set.hierarchy = info.hierarchy;
  set.coarse = Grid(Box3::OfSize(info.hierarchy.DimsAt(0)), 1.0F);
  for (int level = 0; level < info.hierarchy.finest(); ++level) {
    set.detail.emplace_back(info.hierarchy.DimsAt(level), edge, 7, 0.0F);
  }
  const std::vector<float> ones(static_cast<size_t>(7 * edge * edge * edge), 1.0F);
  const FieldStats stats{0, 2, {1}};
  for (int64_t step = 0; step < steps; ++step) {
    set.detail.back().Put({chunk.x - step, chunk.y, chunk.z}, ones);
    FOVEA_RETURN_IF_ERROR(writer->WriteField("density", set, stats));
    FOVEA_RETURN_IF_ERROR(writer->Commit(step, std::nullopt));
  }
  return absl::OkStatus();
}

StatusOr<FrameSpec> SpecAt(store::Dataset& dataset, const Vec3& fovea, double rate) {
  FrameSpec spec;
  spec.width_px = spec.height_px = 64;
  spec.fovea = Position{fovea};
  spec.rate = rate;
  spec.strict = true;
  FOVEA_ASSIGN_OR_RETURN(const FrameSpec defaults, DefaultSpec(dataset));
  return ResolveSpec(dataset, spec, defaults);
}

constexpr Int3 kChunk{1052, 1040, 1040};
// In it, 60 coefficients of the finest level (120 voxels) from where the next block of the table
// begins, which is 32 chunks of 16 wide.
constexpr Vec3 kFovea{2 * (33 * 512 - 60), 2 * (32 * 512 + 256), 2 * (32 * 512 + 256)};

TEST(PlanWithin, QuotesNoReadOfWhatCostsTooMuchAlready) {
  const TemporaryFolder folder;
  const std::string path = folder / "huge.zarr";
  ASSERT_OK(MakeHugeStore(path, 16, 1, kChunk));
  ASSERT_OK_AND_ASSIGN(const auto dataset, store::Dataset::Open(path));
  ASSERT_OK_AND_ASSIGN(const FrameSpec spec, SpecAt(*dataset, kFovea, 100));
  ASSERT_OK_AND_ASSIGN(const FramePlan wanted, PlanFrame(*dataset, 0, spec, 1));
  // Whoever looks at windows wider than 120 coefficients finds rubbish.
  const store::DatasetInfo info = dataset->info();
  const auto layout = store::LevelLayout::Make(info, info.FieldOf("density"), 11);
  std::ofstream(path + "/" + store::TablePath("density", layout.width) + "/" +
                store::SpaceChunkName(0, {33, 32, 32}, /*with_bands=*/false))
      << "rubbish";
  ASSERT_OK_AND_ASSIGN(const FrameSpec wide, SpecAt(*dataset, kFovea, 128));
  EXPECT_THAT(PlanFrame(*dataset, 0, wide, 1), FailsWith(absl::StatusCode::kDataLoss, "chunk_max"));
  FrameBudget budget;
  budget.coefficients = wanted.coefficients;
  ASSERT_OK_AND_ASSIGN(const FramePlan by_coefficients, PlanWithin(*dataset, 0, spec, budget, 1));
  EXPECT_EQ(by_coefficients.used.rate, 100);
  EXPECT_EQ(by_coefficients.chunks_read, wanted.chunks_read);
  EXPECT_EQ(by_coefficients.bytes_read, wanted.bytes_read);
  budget.coefficients.reset();
  budget.memory_bytes = static_cast<uint64_t>(wanted.counts.memory_bytes);
  budget.ms = 1e9;
  ASSERT_OK_AND_ASSIGN(const FramePlan by_memory, PlanWithin(*dataset, 0, spec, budget, 1));
  EXPECT_EQ(by_memory.used.rate, 100);
  // Where all but the reading takes too long already, nothing is read either.
  FrameBudget time;
  time.ms = 0.99 * (wanted.time.Total() - wanted.time.read_ms);
  ASSERT_OK_AND_ASSIGN(const FramePlan by_time, PlanWithin(*dataset, 0, spec, time, 1));
  EXPECT_LT(by_time.used.rate->x, 100);
}

// 2,396,745 blocks of tables, two of which are there.
TEST(PlanWithin, OfAHugeVolumeIsQuick) {
  const TemporaryFolder folder;
  const std::string path = folder / "huge.zarr";
  ASSERT_OK(MakeHugeStore(path, 8, 2, {2 * kChunk.x, 2 * kChunk.y, 2 * kChunk.z}));
  ASSERT_OK_AND_ASSIGN(const auto dataset, store::Dataset::Open(path));
  ASSERT_OK_AND_ASSIGN(const FrameSpec spec, SpecAt(*dataset, kFovea, 40));
  FrameBudget budget;
  budget.coefficients = uint64_t{1} << 28;  // what a server renders at most
  budget.bytes_read = uint64_t{1} << 40;
  const Stopwatch watch;
  ASSERT_OK_AND_ASSIGN(const FramePlan plan, PlanWithin(*dataset, 0, spec, budget, 1));
  EXPECT_LT(watch.ElapsedMs(), 4000);
  EXPECT_EQ(plan.chunks_total, 2U);  // the coarse level, and one of detail
  ASSERT_OK_AND_ASSIGN(const FramePlan next, PlanFrame(*dataset, 1, spec, 1));
  EXPECT_EQ(next.chunks_total, 3U);
}

TEST(PlanWithin, KeepsWithinAndTheNextRateDoesNot) {
  const TemporaryFolder folder;
  const std::string path = folder / "huge.zarr";
  ASSERT_OK(MakeHugeStore(path, 16, 1, kChunk));
  ASSERT_OK_AND_ASSIGN(const auto dataset, store::Dataset::Open(path));
  ASSERT_OK_AND_ASSIGN(const FrameSpec spec, SpecAt(*dataset, kFovea, 37));
  ASSERT_OK_AND_ASSIGN(const FramePlan wanted, PlanFrame(*dataset, 0, spec, 1));
  FrameBudget budget;
  budget.ms = wanted.time.Total();
  ASSERT_OK_AND_ASSIGN(const FramePlan plan, PlanWithin(*dataset, 0, spec, budget, 1));
  EXPECT_EQ(plan.used.rate, 37);
  budget.coefficients = 1;
  EXPECT_THAT(PlanWithin(*dataset, 0, spec, budget, 1),
              FailsWith(absl::StatusCode::kResourceExhausted, "at rate 1"));
  EXPECT_THAT(PlanWithin(*dataset, 1, spec, budget, 1),
              FailsWith(absl::StatusCode::kOutOfRange, "step 1"));
}

}  // namespace
}  // namespace fovea::frames
