#include "service/wire/requests.h"

#include <string>

#include <gtest/gtest.h>

#include "service/wire/status.h"
#include "tests/support/status_matchers.h"

namespace fovea::wire {
namespace {

using ::fovea::testing::FailsWith;

constexpr char kStreamId[] = "abcdefgh-01234567_ABC";

v1::RenderSequenceRequest GoodSequence() {
  v1::RenderSequenceRequest proto;
  proto.set_dataset("plume");
  proto.set_window(2);
  proto.set_stream_id(kStreamId);
  return proto;
}

TEST(FrameRequestTest, StepOrTime) {
  v1::RenderFrameRequest proto;
  proto.set_dataset("plume");
  ASSERT_OK_AND_ASSIGN(FrameRequest request, FromProto(proto));
  EXPECT_EQ(request.step, 0U);
  EXPECT_FALSE(request.time_ns.has_value());
  proto.set_step(12);
  ASSERT_OK_AND_ASSIGN(request, FromProto(proto));
  EXPECT_EQ(request.step, 12U);
  proto.set_time_ns(0);
  ASSERT_OK_AND_ASSIGN(request, FromProto(proto));
  EXPECT_EQ(request.time_ns, 0);
}

TEST(FrameRequestTest, NeedsADataset) {
  const auto result = FromProto(v1::RenderFrameRequest());
  EXPECT_THAT(result, FailsWith(absl::StatusCode::kInvalidArgument, "dataset"));
  EXPECT_EQ(FieldOf(result.status()), "dataset");
}

TEST(SequenceRequestTest, DefaultsAndValues) {
  ASSERT_OK_AND_ASSIGN(SequenceRequest request, FromProto(GoodSequence()));
  EXPECT_EQ(request.first, 0U);
  EXPECT_FALSE(request.last.has_value());
  EXPECT_EQ(request.stride, 1U);
  EXPECT_EQ(request.window, 2U);
  v1::RenderSequenceRequest proto = GoodSequence();
  proto.mutable_steps()->set_first(3);
  proto.mutable_steps()->set_last(9);
  proto.mutable_steps()->set_stride(2);
  proto.set_start_index(1);
  ASSERT_OK_AND_ASSIGN(request, FromProto(proto));
  EXPECT_EQ(request.first, 3U);
  EXPECT_EQ(request.last, 9U);
  EXPECT_EQ(request.stride, 2U);
  EXPECT_EQ(request.start_index, 1U);
}

struct BadSequence {
  const char* field;
  void (*spoil)(v1::RenderSequenceRequest* request);
};

const BadSequence kBadSequences[] = {
    {"dataset", [](v1::RenderSequenceRequest* r) { r->clear_dataset(); }},
    {"window", [](v1::RenderSequenceRequest* r) { r->set_window(65); }},
    {"stream_id", [](v1::RenderSequenceRequest* r) { r->clear_stream_id(); }},
    {"stream_id", [](v1::RenderSequenceRequest* r) { r->set_stream_id("short"); }},
    {"stream_id", [](v1::RenderSequenceRequest* r) { r->set_stream_id(std::string(65, 'a')); }},
    {"stream_id", [](v1::RenderSequenceRequest* r) { r->set_stream_id("abcdefgh 01234567"); }},
    {"steps.stride", [](v1::RenderSequenceRequest* r) { r->mutable_steps()->set_stride(0); }},
    {"steps.last",
     [](v1::RenderSequenceRequest* r) {
       r->mutable_steps()->set_first(2);
       r->mutable_steps()->set_last(1);
     }},
    {"spec.rate", [](v1::RenderSequenceRequest* r) { r->mutable_spec()->set_rate(0); }},
};

TEST(SequenceRequestTest, EachRangeIsCheckedAndTheFieldNamed) {
  for (const BadSequence& bad : kBadSequences) {
    v1::RenderSequenceRequest proto = GoodSequence();
    bad.spoil(&proto);
    const auto result = FromProto(proto);
    EXPECT_EQ(result.status().code(), absl::StatusCode::kInvalidArgument) << bad.field;
    EXPECT_EQ(FieldOf(result.status()), bad.field) << MessageOf(result.status());
  }
}

TEST(SequenceRequestTest, NoWindowNeedsNoStreamId) {
  v1::RenderSequenceRequest proto = GoodSequence();
  proto.clear_window();
  proto.clear_stream_id();
  EXPECT_OK(FromProto(proto).status());
}

v1::RenderSequenceRequest GoodPath() {
  v1::RenderSequenceRequest proto = GoodSequence();
  proto.mutable_path()->set_frames(11);
  v1::Keyframe* key = proto.mutable_path()->add_keys();
  key->set_frame(2);
  key->mutable_eye()->set_x(-9);
  key->mutable_target()->set_y(1);
  key->mutable_up()->set_z(2);
  key->set_fov_y_deg(30);
  key->mutable_fovea()->set_z(3);
  key->set_rate(8);
  key->set_step(4);
  proto.mutable_path()->add_keys()->set_frame(11);
  return proto;
}

TEST(PathTest, ComesBackAsItWas) {
  ASSERT_OK_AND_ASSIGN(const SequenceRequest request, FromProto(GoodPath()));
  ASSERT_OK_AND_ASSIGN(const StepSeries series, ResolveSteps(request, 5));
  ASSERT_OK_AND_ASSIGN(const frames::Animation path, ResolvePath(request, series, 5));
  EXPECT_EQ(ToProto(path).SerializeAsString(), GoodPath().path().SerializeAsString());
  v1::RenderSequenceRequest views = GoodSequence();
  v1::Keyframe* key = views.mutable_path()->add_keys();
  key->mutable_view()->set_azimuth_deg(400);
  key->mutable_view()->set_elevation_deg(-90);
  key->set_span_voxels(0.5);
  ASSERT_OK_AND_ASSIGN(const SequenceRequest other, FromProto(views));
  ASSERT_OK_AND_ASSIGN(const frames::Animation turn, ResolvePath(other, series, 5));
  EXPECT_EQ(turn.frames(), 5);  // one a step
  views.mutable_path()->set_frames(5);
  EXPECT_EQ(ToProto(turn).SerializeAsString(), views.path().SerializeAsString());
}

const BadSequence kBadPaths[] = {
    {"path", [](v1::RenderSequenceRequest* r) { r->set_follow(true); }},
    {"path.frames", [](v1::RenderSequenceRequest* r) { r->mutable_path()->set_frames(0); }},
    {"path.frames", [](v1::RenderSequenceRequest* r) { r->mutable_path()->set_frames(1'000'001); }},
    {"path.keys", [](v1::RenderSequenceRequest* r) { r->mutable_path()->clear_keys(); }},
    {"path.keys",
     [](v1::RenderSequenceRequest* r) {
       r->mutable_path()->clear_keys();
       for (uint64_t i = 0; i < 4097; ++i) {
         r->mutable_path()->add_keys()->set_frame(i);
       }
     }},
    {"path.keys[1].frame",
     [](v1::RenderSequenceRequest* r) { r->mutable_path()->mutable_keys(1)->set_frame(2); }},
    {"path.keys[1].frame",
     [](v1::RenderSequenceRequest* r) { r->mutable_path()->mutable_keys(1)->set_frame(12); }},
    {"path.keys[1].frame",
     [](v1::RenderSequenceRequest* r) {
       r->mutable_path()->clear_frames();
       r->mutable_path()->mutable_keys(1)->set_frame(~uint64_t{0});
     }},
    {"path.keys",  // a camera and an orthographic view
     [](v1::RenderSequenceRequest* r) { r->mutable_path()->mutable_keys(1)->mutable_view(); }},
    {"path.keys",  // a camera without an eye
     [](v1::RenderSequenceRequest* r) { r->mutable_path()->mutable_keys(0)->clear_eye(); }},
    {"path.keys[1].view.azimuth_deg",
     [](v1::RenderSequenceRequest* r) {
       r->mutable_path()->mutable_keys(1)->mutable_view()->set_azimuth_deg(1.0 / 0.0);
     }},
    {"path.keys[1].view.elevation_deg",
     [](v1::RenderSequenceRequest* r) {
       r->mutable_path()->mutable_keys(1)->mutable_view()->set_elevation_deg(91);
     }},
    {"path.keys[1].span_voxels",
     [](v1::RenderSequenceRequest* r) { r->mutable_path()->mutable_keys(1)->set_span_voxels(0); }},
    {"path.keys[0].eye",
     [](v1::RenderSequenceRequest* r) {
       r->mutable_path()->mutable_keys(0)->mutable_eye()->set_y(2e9);
     }},
    {"path.keys[0].target",
     [](v1::RenderSequenceRequest* r) {
       r->mutable_path()->mutable_keys(0)->mutable_target()->set_y(0.0 / 0.0);
     }},
    {"path.keys[0].up",
     [](v1::RenderSequenceRequest* r) {
       r->mutable_path()->mutable_keys(0)->mutable_up()->set_y(1.0 / 0.0);
     }},
    {"path.keys[0].fov_y_deg",
     [](v1::RenderSequenceRequest* r) { r->mutable_path()->mutable_keys(0)->set_fov_y_deg(171); }},
    {"path.keys[0].fovea",
     [](v1::RenderSequenceRequest* r) {
       r->mutable_path()->mutable_keys(0)->mutable_fovea()->set_x(-2e9);
     }},
    {"path.keys[0].rate",
     [](v1::RenderSequenceRequest* r) { r->mutable_path()->mutable_keys(0)->set_rate(0.5); }},
};

TEST(PathTest, EachRangeIsCheckedAndTheFieldNamed) {
  ASSERT_OK(FromProto(GoodPath()).status());
  for (const BadSequence& bad : kBadPaths) {
    v1::RenderSequenceRequest proto = GoodPath();
    bad.spoil(&proto);
    const auto result = FromProto(proto);
    EXPECT_EQ(result.status().code(), absl::StatusCode::kInvalidArgument) << bad.field;
    EXPECT_EQ(FieldOf(result.status()), bad.field) << MessageOf(result.status());
  }
}

TEST(PathTest, WhatOnlyTheStepsTell) {
  v1::RenderSequenceRequest proto = GoodPath();
  proto.mutable_path()->clear_frames();  // one a step
  ASSERT_OK_AND_ASSIGN(SequenceRequest request, FromProto(proto));
  ASSERT_OK_AND_ASSIGN(const StepSeries series, ResolveSteps(request, 5));
  EXPECT_EQ(FieldOf(ResolvePath(request, series, 5).status()), "path.keys[1].frame");
  request.path->frames = 11;
  EXPECT_OK(ResolvePath(request, series, 5).status());
  EXPECT_THAT(ResolvePath(request, series, 4),
              FailsWith(absl::StatusCode::kOutOfRange, "path.keys[0].step"));
  request.start_index = 11;
  EXPECT_OK(ResolveSteps(request, 5).status());
  EXPECT_OK(ResolvePath(request, series, 5).status());
  request.start_index = 12;
  EXPECT_EQ(FieldOf(ResolvePath(request, series, 5).status()), "start_index");
}

TEST(ListRequestTest, PagesAndTokens) {
  v1::ListDatasetsRequest proto;
  ASSERT_OK_AND_ASSIGN(ListRequest request, FromProto(proto));
  EXPECT_EQ(request.page_size, 100U);
  EXPECT_EQ(request.after, "");
  proto.set_page_size(1000);
  proto.set_page_token(PageTokenAfter("lab/plume"));
  ASSERT_OK_AND_ASSIGN(request, FromProto(proto));
  EXPECT_EQ(request.page_size, 1000U);
  EXPECT_EQ(request.after, "lab/plume");
  proto.set_page_token("made up");
  EXPECT_EQ(FieldOf(FromProto(proto).status()), "page_token");
  proto.clear_page_token();
  proto.set_page_size(1001);
  EXPECT_EQ(FieldOf(FromProto(proto).status()), "page_size");
}

TEST(ResolveStepsTest, DefaultIsEveryCommittedStep) {
  ASSERT_OK_AND_ASSIGN(const StepSeries series, ResolveSteps({}, 5));
  EXPECT_EQ(series.count, 5);
  EXPECT_EQ(series.StepAt(4), 4);
}

TEST(ResolveStepsTest, LastIsIncludedAndStrideCounts) {
  SequenceRequest request;
  request.first = 1;
  request.last = 7;
  request.stride = 3;
  ASSERT_OK_AND_ASSIGN(StepSeries series, ResolveSteps(request, 8));
  EXPECT_EQ(series.count, 3);
  EXPECT_EQ(series.StepAt(2), 7);
  request.stride = ~uint64_t{0};
  ASSERT_OK_AND_ASSIGN(series, ResolveSteps(request, 8));
  EXPECT_EQ(series.count, 1);
  EXPECT_EQ(series.StepAt(0), 1);
}

TEST(ResolveStepsTest, StepsThatAreNotThere) {
  SequenceRequest request;
  request.dataset = "plume";
  EXPECT_THAT(ResolveSteps(request, 0),
              FailsWith(absl::StatusCode::kOutOfRange, "no committed step"));
  request.first = 8;
  EXPECT_THAT(ResolveSteps(request, 8),
              FailsWith(absl::StatusCode::kOutOfRange, "'plume' has steps 0 to 7"));
  request.first = 0;
  request.last = ~uint64_t{0};
  EXPECT_THAT(ResolveSteps(request, 8), FailsWith(absl::StatusCode::kOutOfRange, "step 18446"));
}

TEST(ResolveStepsTest, StartIndexUpToTheEnd) {
  SequenceRequest request;
  request.start_index = 4;
  EXPECT_OK(ResolveSteps(request, 4).status());
  request.start_index = 5;
  const auto result = ResolveSteps(request, 4);
  EXPECT_THAT(result, FailsWith(absl::StatusCode::kInvalidArgument, "0 to 4"));
  EXPECT_EQ(FieldOf(result.status()), "start_index");
}

}  // namespace
}  // namespace fovea::wire
