#include "service/wire/readings.h"

#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "service/wire/status.h"
#include "tests/support/status_matchers.h"

namespace fovea::wire {
namespace {

using ::fovea::testing::FailsWith;

v1::ReadingsHeader GoodHeader() {
  v1::ReadingsHeader header;
  header.set_dataset("lab/live");
  header.set_step_seconds(0.1);
  header.mutable_lower()->set_x(-1);
  header.mutable_upper()->set_x(9);
  header.mutable_upper()->set_y(20);
  header.mutable_upper()->set_z(5.5);
  header.mutable_voxel()->set_x(1);
  header.mutable_voxel()->set_y(2);
  header.mutable_voxel()->set_z(1);
  return header;
}

v1::ReadingBatch GoodBatch() {
  v1::ReadingBatch batch;
  batch.set_sequence(7);
  for (int i = 0; i < 3; ++i) {
    batch.add_time_ns(i);
    batch.add_x(i);
    batch.add_y(2 * i);
    batch.add_z(3 * i);
    batch.add_value(static_cast<float>(4 * i));
    batch.add_value(static_cast<float>(5 * i));
  }
  return batch;
}

TEST(ReadingsHeaderTest, SaysBoxFieldsAndRules) {
  v1::ReadingsHeader header = GoodHeader();
  header.add_fields("temperature");
  header.add_fields("wind");
  header.set_watermark_seconds(2);
  header.set_duplicates(v1::ReadingsHeader::MEAN);
  header.set_on_missing(v1::ReadingsHeader::HOLD);
  ASSERT_OK_AND_ASSIGN(const ReadingsSpec spec, FromProto(header));
  EXPECT_EQ(spec.dataset, "lab/live");
  EXPECT_FALSE(spec.acknowledge_received);
  EXPECT_EQ(spec.fields, (std::vector<std::string>{"temperature", "wind"}));
  ASSERT_TRUE(spec.grid.has_value());
  EXPECT_EQ(spec.grid->hierarchy.dims(), (Int3{10, 10, 6}));  // the last voxel along z is cut
  EXPECT_EQ(spec.grid->lower.x, -1);
  EXPECT_EQ(spec.steps.window_s, 0.1);
  EXPECT_EQ(spec.steps.watermark_s, 2);
  EXPECT_EQ(spec.steps.on_empty, sensors::OnEmpty::kHold);
  EXPECT_EQ(spec.duplicates, sensors::Duplicates::kMean);
  EXPECT_EQ(spec.chunk_edge, 16);
}

TEST(ReadingsHeaderTest, ThereAndBackIsTheSame) {
  v1::ReadingsHeader header = GoodHeader();
  header.add_fields("temperature");
  header.set_durability(v1::ReadingsHeader::RECEIVED);
  header.set_least_value(-3);
  header.set_reach_voxels(8);
  header.set_world_unit("m");
  ASSERT_OK_AND_ASSIGN(const ReadingsSpec spec, FromProto(header));
  ASSERT_OK_AND_ASSIGN(const ReadingsSpec again, FromProto(ToProto(spec)));
  EXPECT_EQ(ToProto(again).SerializeAsString(), ToProto(spec).SerializeAsString());
  EXPECT_TRUE(again.acknowledge_received);
  EXPECT_EQ(again.grid->hierarchy.dims(), spec.grid->hierarchy.dims());
  EXPECT_EQ(again.fill.reach_voxels, 8);
}

TEST(ReadingsHeaderTest, WhatIsWrongIsNamed) {
  using Spoil = std::function<void(v1::ReadingsHeader*)>;
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const std::vector<std::pair<const char*, Spoil>> cases = {
      {"header.dataset", [](auto* h) { h->set_dataset(""); }},
      {"header.dataset", [](auto* h) { h->set_dataset("../etc/passwd"); }},
      {"header.dataset", [](auto* h) { h->set_dataset("/etc"); }},
      {"header.dataset", [](auto* h) { h->set_dataset("a//b"); }},
      {"header.dataset", [](auto* h) { h->set_dataset("a/"); }},
      {"header.dataset", [](auto* h) { h->set_dataset("plume.zarr/x"); }},
      {"header.dataset", [](auto* h) { h->set_dataset("a\nb"); }},
      {"header.dataset", [](auto* h) { h->set_dataset(std::string(256, 'a')); }},
      {"header.durability",
       [](auto* h) { h->set_durability(static_cast<v1::ReadingsHeader::Durability>(9)); }},
      {"header.fields", [](auto* h) { h->add_fields("coverage"); }},
      {"header.fields", [](auto* h) { h->add_fields("a/b"); }},
      {"header.fields", [](auto* h) { *h->add_fields() = *h->add_fields() = "twice"; }},
      {"header.lower", [](auto* h) { h->clear_lower(); }},
      {"header.lower", [=](auto* h) { h->mutable_lower()->set_y(nan); }},
      {"header.upper", [](auto* h) { h->mutable_upper()->set_x(-2); }},
      {"header.upper", [](auto* h) { h->mutable_upper()->set_x(INFINITY); }},
      {"header.voxel", [](auto* h) { h->clear_voxel(); }},
      {"header.voxel", [](auto* h) { h->mutable_voxel()->set_x(0); }},
      {"header.voxel", [](auto* h) { h->mutable_voxel()->set_x(1e-5); }},
      {"header.step_seconds", [](auto* h) { h->set_step_seconds(0); }},
      {"header.step_seconds", [=](auto* h) { h->set_step_seconds(nan); }},
      {"header.start_seconds", [](auto* h) { h->set_start_seconds(1e10); }},
      {"header.watermark_seconds", [](auto* h) { h->set_watermark_seconds(-1); }},
      {"header.most_ahead", [](auto* h) { h->set_most_ahead(0); }},
      {"header.on_missing",
       [](auto* h) { h->set_on_missing(static_cast<v1::ReadingsHeader::OnMissing>(9)); }},
      {"header.duplicates",
       [](auto* h) { h->set_duplicates(static_cast<v1::ReadingsHeader::Duplicates>(9)); }},
      {"header.greatest_value",
       [](auto* h) {
         h->set_least_value(2);
         h->set_greatest_value(1);
       }},
      {"header.reach_voxels", [](auto* h) { h->set_reach_voxels(0); }},
      {"header.background", [](auto* h) { h->set_background(1e38F); }},
      {"header.world_unit", [](auto* h) { h->set_world_unit(std::string(65, 'm')); }},
      {"header.chunk_edge", [](auto* h) { h->set_chunk_edge(12); }},
  };
  for (const auto& [field, spoil] : cases) {
    v1::ReadingsHeader header = GoodHeader();
    spoil(&header);
    const auto result = FromProto(header);
    EXPECT_THAT(result, FailsWith(absl::StatusCode::kInvalidArgument, field));
    EXPECT_EQ(FieldOf(result.status()), field);
  }
}

TEST(ReadingBatchTest, ThereAndBackIsTheSame) {
  v1::ReadingBatch proto = GoodBatch();
  proto.set_complete_before_ns(1'000'000'000);
  ASSERT_OK_AND_ASSIGN(const ReadingBatch batch, FromProto(proto, 2));
  ASSERT_EQ(batch.readings.size(), 3U);
  EXPECT_EQ(batch.readings[2].y, 4);
  EXPECT_EQ(batch.values[5], 10);
  EXPECT_EQ(ToProto(batch).SerializeAsString(), proto.SerializeAsString());
}

TEST(ReadingBatchTest, HeightsMayBeLeftOut) {
  v1::ReadingBatch proto = GoodBatch();
  proto.clear_z();
  ASSERT_OK_AND_ASSIGN(const ReadingBatch batch, FromProto(proto, 2));
  EXPECT_EQ(batch.readings[2].z, 0);
}

TEST(ReadingBatchTest, WhatIsWrongIsNamed) {
  using Spoil = std::function<void(v1::ReadingBatch*)>;
  const std::vector<std::pair<const char*, Spoil>> cases = {
      {"batch.sequence", [](auto* b) { b->set_sequence(0); }},
      {"batch.x", [](auto* b) { b->add_x(1); }},
      {"batch.x", [](auto* b) { b->clear_x(); }},
      {"batch.y", [](auto* b) { b->add_y(1); }},
      {"batch.z", [](auto* b) { b->mutable_z()->RemoveLast(); }},
      {"batch.value", [](auto* b) { b->add_value(1); }},
  };
  for (const auto& [field, spoil] : cases) {
    v1::ReadingBatch batch = GoodBatch();
    spoil(&batch);
    EXPECT_EQ(FieldOf(FromProto(batch, 2).status()), field);
  }
  EXPECT_EQ(FieldOf(FromProto(GoodBatch(), 1).status()), "batch.value");
}

TEST(ReadingBatchTest, AsManyAsFitAreNotTooLarge) {
  for (const int fields : {1, 3, 64}) {
    ReadingBatch batch;
    batch.sequence = ~uint64_t{0};
    batch.complete_before_ns = -1;
    batch.readings.resize(static_cast<size_t>(ReadingsOfOneMessage(fields)));
    batch.values.resize(batch.readings.size() * static_cast<size_t>(fields));
    v1::StreamReadingsRequest message;
    *message.mutable_batch() = ToProto(batch);
    EXPECT_LE(static_cast<int64_t>(message.ByteSizeLong()), kMaxReadingsMessageBytes);
  }
}

TEST(ReadingBatchTest, ATimeThatIsNoneStaysOneThatIsLeftOut) {
  ReadingBatch batch;
  batch.sequence = 1;
  batch.readings.resize(2);
  batch.readings[0].time_s = std::numeric_limits<double>::quiet_NaN();
  batch.readings[1].time_s = -1e300;
  batch.values.resize(2);
  ASSERT_OK_AND_ASSIGN(const ReadingBatch back, FromProto(ToProto(batch), 1));
  EXPECT_GT(std::abs(back.readings[0].time_s), 9.2e9);
  EXPECT_GT(std::abs(back.readings[1].time_s), 9.2e9);
}

}  // namespace
}  // namespace fovea::wire
