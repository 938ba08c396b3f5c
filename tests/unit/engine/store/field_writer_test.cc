#include "engine/store/field_writer.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "engine/store/dataset_writer.h"
#include "tests/support/simulated_disk.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/engine/store/store_test_util.h"

namespace fovea::store {
namespace {

using ::fovea::testing::FailsWith;
using ::fovea::testing::SimulatedDisk;
using testing::MakeInfo;
using testing::MakeStep;
using testing::StepData;

// Two shards along z and x at the finest level, none of them full, odd sizes.
constexpr Int3 kDims{137, 21, 171};
constexpr int64_t kEdge = 8;
constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

struct Brick {
  int level = 0;
  Int3 at;
  BrickGrid::Brick values;  // zeros past the border, as the transform leaves them
};

/// The bricks that a stream of slices finds done, in the order in which it does: a coarser layer
/// between the finer ones, and within a layer the last first.
std::vector<Brick> InLayers(const CoefficientSet& set) {
  std::vector<Brick> bricks;
  for (int level = 0; level < std::ssize(set.detail); ++level) {
    const BrickGrid& detail = set.detail[static_cast<size_t>(level)];
    for (const auto& [key, values] : detail.bricks()) {
      Brick brick{level, {key[2], key[1], key[0]}, values};
      for (size_t i = 0; i < brick.values.size(); ++i) {
        const auto place = static_cast<int64_t>(i);
        const Int3 in{place % kEdge, place / kEdge % kEdge, place / (kEdge * kEdge) % kEdge};
        const Int3 point{brick.at.x * kEdge + in.x, brick.at.y * kEdge + in.y,
                         brick.at.z * kEdge + in.z};
        if (!Box3::OfSize(detail.dims())
                 .Contains({point, {point.x + 1, point.y + 1, point.z + 1}})) {
          brick.values[i] = 0;
        }
      }
      bricks.push_back(std::move(brick));
    }
  }
  std::stable_sort(bricks.begin(), bricks.end(), [](const Brick& a, const Brick& b) {
    const int64_t end_a = (a.at.z + 1) << (8 - a.level);
    const int64_t end_b = (b.at.z + 1) << (8 - b.level);
    return end_a != end_b ? end_a < end_b : a.level > b.level;
  });
  for (auto first = bricks.begin(); first != bricks.end();) {
    const auto last = std::find_if(first, bricks.end(), [&](const Brick& brick) {
      return brick.level != first->level || brick.at.z != first->at.z;
    });
    std::reverse(first, last);
    first = last;
  }
  return bricks;
}

Status Feed(const StepData& data, FieldWriter* writer) {
  const std::vector<Brick> bricks = InLayers(data.coefficients);
  for (size_t i = 0; i < bricks.size(); ++i) {
    const Brick& brick = bricks[i];
    float largest = 0;
    for (const float value : brick.values) {
      largest = std::max(largest, std::fabs(value));
    }
    if (largest > 0) {
      FOVEA_RETURN_IF_ERROR(
          writer->Add(brick.level, brick.at, std::as_bytes(std::span(brick.values)), largest));
    }
    if (i + 1 == bricks.size() || bricks[i + 1].level != brick.level ||
        bricks[i + 1].at.z != brick.at.z) {
      FOVEA_RETURN_IF_ERROR(writer->EndLayer(brick.level, brick.at.z));
    }
  }
  return writer->Finish(data.coefficients.coarse, data.stats);
}

TEST(FieldWriter, WhatIsFedInLayersIsWhatIsWrittenWhole) {
  const DatasetInfo info = MakeInfo(kDims, kEdge, {"a"});
  const StepData data = MakeStep(kDims, kEdge, 3);
  SimulatedDisk whole, layered;
  ASSERT_OK_AND_ASSIGN(const auto one, DatasetWriter::Create("s", info, whole));
  ASSERT_OK_AND_ASSIGN(const auto other, DatasetWriter::Create("s", info, layered));
  layered.set_most_at_once(1000);
  for (int64_t step = 0; step < 2; ++step) {
    ASSERT_OK(one->WriteField("a", data.coefficients, data.stats));
    ASSERT_OK(one->Commit(step, {}));
    ASSERT_OK_AND_ASSIGN(const auto field, other->BeginField("a"));
    ASSERT_OK(Feed(data, field.get()));
    ASSERT_OK(other->Commit(step, {}));
  }
  EXPECT_GT(whole.Files().size(), 30U);
  EXPECT_TRUE(whole.Files() == layered.Files());
}

TEST(FieldWriter, FilesDoNotStayOpenBetweenLayers) {
  const DatasetInfo info = MakeInfo(kDims, kEdge, {"a"});
  const StepData data = MakeStep(kDims, kEdge, 3);
  SimulatedDisk disk;
  ASSERT_OK_AND_ASSIGN(const auto writer, DatasetWriter::Create("s", info, disk));
  const size_t before = disk.open_handles();
  ASSERT_OK_AND_ASSIGN(const auto field, writer->BeginField("a"));
  for (const Brick& brick : InLayers(data.coefficients)) {
    ASSERT_OK(field->Add(brick.level, brick.at, std::as_bytes(std::span(brick.values)), 1));
    ASSERT_OK(field->EndLayer(brick.level, brick.at.z));
    EXPECT_EQ(disk.open_handles(), before);
  }
}

TEST(FieldWriter, AFieldThatIsNotFinishedTakesTheStepWithIt) {
  const DatasetInfo info = MakeInfo(kDims, kEdge, {"a", "b"});
  const StepData data = MakeStep(kDims, kEdge, 3);
  SimulatedDisk disk;
  ASSERT_OK_AND_ASSIGN(const auto writer, DatasetWriter::Create("s", info, disk));
  const auto empty = disk.Files();
  ASSERT_OK(writer->WriteField("a", data.coefficients, data.stats));
  {
    ASSERT_OK_AND_ASSIGN(const auto field, writer->BeginField("b"));
    const std::vector<float> ones(7 * kEdge * kEdge * kEdge, 1.0F);
    ASSERT_OK(field->Add(0, {0, 0, 0}, std::as_bytes(std::span(ones)), 1));
    ASSERT_OK(field->EndLayer(0, 0));
  }
  EXPECT_TRUE(disk.Files() == empty);
  EXPECT_THAT(writer->Commit(0, {}),
              FailsWith(absl::StatusCode::kFailedPrecondition, "'a' of step 0 has not been"));
}

TEST(FieldWriter, FieldsWrittenAtOnceAreWhatIsWrittenOneByOne) {
  const std::vector<std::string> names{"a", "b", "c", "d"};
  const DatasetInfo info = MakeInfo(kDims, kEdge, names);
  std::vector<StepData> data;
  for (size_t i = 0; i < names.size(); ++i) {
    data.push_back(MakeStep(kDims, kEdge, 3 + static_cast<int>(i)));
  }
  SimulatedDisk in_turn, at_once;
  ASSERT_OK_AND_ASSIGN(const auto one, DatasetWriter::Create("s", info, in_turn));
  ASSERT_OK_AND_ASSIGN(const auto other, DatasetWriter::Create("s", info, at_once));
  for (int64_t step = 0; step < 3; ++step) {
    std::vector<std::thread> threads;
    std::vector<Status> results(names.size());
    for (size_t i = 0; i < names.size(); ++i) {
      ASSERT_OK(one->WriteField(names[i], data[i].coefficients, data[i].stats));
      threads.emplace_back([&, i] {
        const auto field = other->BeginField(names[i]);
        results[i] = field.ok() ? Feed(data[i], field->get()) : field.status();
      });
    }
    for (std::thread& thread : threads) {
      thread.join();
    }
    for (const Status& result : results) {
      ASSERT_OK(result);
    }
    ASSERT_OK(one->Commit(step, {}));
    ASSERT_OK(other->Commit(step, {}));
  }
  EXPECT_TRUE(in_turn.Files() == at_once.Files());
}

TEST(FieldWriter, OneThatFailsTakesThoseThatEndAfterItToo) {
  const DatasetInfo info = MakeInfo(kDims, kEdge, {"a", "b"});
  const StepData data = MakeStep(kDims, kEdge, 3);
  SimulatedDisk disk;
  ASSERT_OK_AND_ASSIGN(const auto writer, DatasetWriter::Create("s", info, disk));
  const auto empty = disk.Files();
  {
    ASSERT_OK_AND_ASSIGN(const auto slow, writer->BeginField("a"));
    ASSERT_OK_AND_ASSIGN(auto failing, writer->BeginField("b"));
    failing.reset();
    ASSERT_OK(Feed(data, slow.get()));
  }
  EXPECT_TRUE(disk.Files() == empty);
  EXPECT_THAT(writer->Commit(0, {}),
              FailsWith(absl::StatusCode::kFailedPrecondition, "'a' of step 0 has not been"));
  ASSERT_OK(writer->WriteField("a", data.coefficients, data.stats));
  ASSERT_OK(writer->WriteField("b", data.coefficients, data.stats));
  EXPECT_OK(writer->Commit(0, {}));
}

TEST(FieldWriter, RefusesWhatDoesNotFit) {
  const DatasetInfo info = MakeInfo(kDims, kEdge, {"a"});
  const StepData data = MakeStep(kDims, kEdge, 3);
  SimulatedDisk disk;
  ASSERT_OK_AND_ASSIGN(const auto writer, DatasetWriter::Create("s", info, disk));
  EXPECT_THAT(writer->BeginField("x"), FailsWith(absl::StatusCode::kNotFound, "no field 'x'"));
  const std::vector<float> ones(7 * kEdge * kEdge * kEdge, 1.0F);
  for (const float bad :
       {std::numeric_limits<float>::infinity(), std::numeric_limits<float>::quiet_NaN()}) {
    ASSERT_OK_AND_ASSIGN(const auto field, writer->BeginField("a"));
    EXPECT_THAT(field->Add(0, {0, 0, 0}, std::as_bytes(std::span(ones)), bad),
                FailsWith(kInvalid, "not finite"));
    Grid coarse = data.coefficients.coarse;
    coarse.values.back() = bad;
    EXPECT_THAT(field->Finish(coarse, data.stats), FailsWith(kInvalid, "field 'a' of step 0"));
  }
  ASSERT_OK_AND_ASSIGN(const auto field, writer->BeginField("a"));
  EXPECT_THAT(field->Finish(Grid(Box3::OfSize({1, 1, 1})), data.stats),
              FailsWith(kInvalid, "coarse level"));
}

}  // namespace
}  // namespace fovea::store
