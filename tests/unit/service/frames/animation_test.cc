#include "service/frames/animation.h"

#include <random>

#include "engine/base/stopwatch.h"
#include "tests/support/status_matchers.h"

namespace fovea::frames {
namespace {

using ::fovea::testing::FailsWith;

constexpr const char* kShot = R"({"frames": 11, "keys": [
  {"frame": 0, "view": [0, 20], "rate": 40, "step": 0},
  {"frame": 5, "fovea": [1, 2, 3]},
  {"frame": 10, "view": [90, -20], "rate": 20, "step": 3, "fovea": [11, 2, 3], "span": 60}]})";

TEST(Animation, IsLinearBetweenKeysAndConstantOutside) {
  ASSERT_OK_AND_ASSIGN(const Animation animation, Animation::Parse(kShot));
  EXPECT_EQ(animation.frames(), 11);
  frames::FrameSpec base;
  base.width_px = 77;
  const frames::FrameSpec first = animation.SpecAt(0, base);
  EXPECT_EQ(first.width_px, 77);
  EXPECT_EQ(first.view.azimuth_deg, 0);
  EXPECT_EQ(first.fovea, (frames::Position{{1, 2, 3}}));  // before its first key
  EXPECT_EQ(first.view.span_voxels, 60);
  const frames::FrameSpec middle = animation.SpecAt(5, base);
  EXPECT_EQ(middle.view.azimuth_deg, 45);
  EXPECT_EQ(middle.view.elevation_deg, 0);
  EXPECT_EQ(middle.rate, 30);
  EXPECT_EQ(animation.SpecAt(8, base).fovea, (frames::Position{{7, 2, 3}}));
  EXPECT_EQ(animation.SpecAt(10, base).view.azimuth_deg, 90);
  EXPECT_EQ(animation.StepAt(0), 0);
  EXPECT_EQ(animation.StepAt(4), 1);  // 1.2
  EXPECT_EQ(animation.StepAt(5), 2);  // 1.5
  EXPECT_EQ(animation.StepAt(10), 3);
}

TEST(Animation, WhatNoKeySaysStaysAsItWas) {
  ASSERT_OK_AND_ASSIGN(const Animation animation,
                       Animation::Parse(R"({"frames": 3, "keys": [{"frame": 1, "rate": 9}]})"));
  frames::FrameSpec base;
  base.view.azimuth_deg = 12;
  EXPECT_EQ(animation.SpecAt(2, base).view.azimuth_deg, 12);
  EXPECT_FALSE(animation.SpecAt(2, base).fovea.has_value());
  EXPECT_EQ(animation.SpecAt(2, base).rate, 9);
  EXPECT_FALSE(animation.StepAt(2).has_value());
}

TEST(Animation, AnOrbitStopsOnePartBeforeItsStart) {
  const Animation orbit = Animation::Orbit(10, 5, 360, 4);
  EXPECT_EQ(orbit.frames(), 4);
  EXPECT_EQ(orbit.SpecAt(0, {}).view.azimuth_deg, 10);
  EXPECT_EQ(orbit.SpecAt(1, {}).view.azimuth_deg, 100);
  EXPECT_EQ(orbit.SpecAt(3, {}).view.azimuth_deg, 280);
  EXPECT_EQ(orbit.SpecAt(3, {}).view.elevation_deg, 5);
}

TEST(Animation, ACameraMovesAlongItsKeys) {
  ASSERT_OK_AND_ASSIGN(const Animation animation, Animation::Parse(R"({"frames": 11, "keys": [
    {"frame": 0, "eye": [-10, 0, 5], "target": [5, 5, 5]},
    {"frame": 10, "eye": [10, 20, 5], "fov": 60}]})"));
  frames::FrameSpec base;
  base.view.azimuth_deg = 30;  // of the flags; a camera takes its place
  base.view.span_voxels = 70;
  const frames::ViewSpec view = animation.SpecAt(5, base).view;
  ASSERT_TRUE(view.perspective);
  EXPECT_FALSE(view.azimuth_deg || view.span_voxels);
  EXPECT_EQ(view.perspective->eye, (frames::Position{{0, 10, 5}}));
  EXPECT_EQ(view.perspective->target, (frames::Position{{5, 5, 5}}));
  EXPECT_EQ(view.perspective->fov_y_deg, 60);
  EXPECT_FALSE(view.perspective->up);
}

TEST(Animation, ACameraOrbitsItsTargetAtOneDistance) {
  Matrix4 matrix;
  matrix.m[0] = 0.5;  // a voxel is half as long in x
  const frames::PerspectiveSpec camera{
      {{-20, 5, 8}}, frames::Position{{0, 5, 5}}, Vec3{0, 0, 1}, 45};
  const Animation orbit = Animation::Orbit(camera, matrix, 360, 4);
  frames::FrameSpec base;
  base.view.perspective = camera;
  const auto eye = [&](int64_t frame) {
    return orbit.SpecAt(frame, base).view.perspective->eye.at;
  };
  EXPECT_EQ(eye(0), camera.eye.at);
  EXPECT_NEAR(eye(1).x, 0, 1e-9);  // a quarter on, azimuth grows: it looks along +y
  EXPECT_NEAR(eye(1).y, -5, 1e-9);
  EXPECT_NEAR(eye(1).z, 8, 1e-9);
  EXPECT_NEAR(eye(2).x, 20, 1e-9);
  EXPECT_EQ(orbit.SpecAt(1, base).view.perspective->target, camera.target);
}

TEST(Animation, ManyKeysAreFound) {
  std::vector<Keyframe> keys(100'000);
  for (size_t i = 0; i < keys.size(); ++i) {
    keys[i].frame = static_cast<int64_t>(10 * i);
    keys[i].rate = 1 + static_cast<double>(i);
  }
  ASSERT_OK_AND_ASSIGN(const Animation animation, Animation::Make(1'000'000, keys));
  for (int64_t frame = 0; frame < 999'990; frame += 500) {
    ASSERT_EQ(animation.SpecAt(frame, {}).rate, 1 + static_cast<double>(frame) / 10);
  }
}

TEST(Animation, EachValueHasKeysOfItsOwn) {
  std::mt19937 random(7);
  std::vector<Keyframe> keys(40);
  for (size_t i = 0; i < keys.size(); ++i) {
    keys[i].frame = static_cast<int64_t>(3 * i + random() % 3);
    if (random() % 3 == 0) {
      keys[i].rate = 1 + static_cast<double>(random() % 100);
    }
    if (random() % 4 == 0) {
      keys[i].step = random() % 1000;
    }
  }
  ASSERT_OK_AND_ASSIGN(const Animation animation, Animation::Make(200, keys));
  for (int64_t frame = 0; frame < 200; ++frame) {
    const Keyframe* before = nullptr;
    const Keyframe* after = nullptr;
    for (const Keyframe& key : keys) {
      if (key.rate && key.frame <= frame) {
        before = &key;
      } else if (key.rate && after == nullptr) {
        after = &key;
      }
    }
    ASSERT_TRUE(before != nullptr || after != nullptr);
    const double from = before != nullptr ? *before->rate : *after->rate;
    const double to = after != nullptr ? *after->rate : from;
    const double part = before != nullptr && after != nullptr
                            ? static_cast<double>(frame - before->frame) /
                                  static_cast<double>(after->frame - before->frame)
                            : 0;
    EXPECT_EQ(animation.SpecAt(frame, {}).rate, from + part * (to - from)) << frame;
  }
  for (const Keyframe& key : keys) {
    EXPECT_TRUE(!key.step || animation.StepAt(key.frame) == key.step) << key.frame;
  }
}

// Looking at every key for every value would be 9 x 2e10 looks, and minutes.
TEST(Animation, FramesFarFromTheirKeysCostLittle) {
  std::vector<Keyframe> keys(200'000);
  for (size_t i = 0; i < keys.size(); ++i) {
    keys[i].frame = static_cast<int64_t>(i);
  }
  keys.front().rate = 1;
  keys.back().rate = 200'000;
  ASSERT_OK_AND_ASSIGN(const Animation animation, Animation::Make(1'000'000, keys));
  const Stopwatch watch;
  for (int64_t frame = 0; frame < 200'000; frame += 2) {
    ASSERT_NEAR(animation.SpecAt(frame, {}).rate->x, 1 + static_cast<double>(frame), 1e-6);
  }
  EXPECT_LT(watch.ElapsedMs(), 5000);
}

TEST(Animation, SpreadsItsFramesEvenly) {
  ASSERT_OK_AND_ASSIGN(const Animation animation, Animation::Make(5, {Keyframe{}}));
  for (int64_t frame = 0; frame < 5; ++frame) {
    EXPECT_EQ(animation.PlaceIn(2, frame), frame < 3 ? 0 : 1);
    EXPECT_EQ(animation.PlaceIn(5, frame), frame);
  }
}

TEST(Animation, SaysWhatIsWrong) {
  const auto fails = [](const std::string& text, const std::string& message) {
    EXPECT_THAT(Animation::Parse(text), FailsWith(absl::StatusCode::kInvalidArgument, message));
  };
  fails("{", "not valid JSON");
  fails("[]", "\"frames\" and \"keys\"");
  fails(R"({"frames": 0, "keys": [{"frame": 0}]})", "\"frames\"");
  fails(R"({"frames": 1e9, "keys": [{"frame": 0}]})", "\"frames\"");
  fails(R"({"frames": 2, "keys": []})", "\"keys\"");
  fails(R"({"frames": 2, "keys": [{"frame": 0}], "loop": true})", "unknown key \"loop\"");
  fails(R"({"frames": 2, "keys": [{"rate": 3}]})", "needs a whole number \"frame\"");
  fails(R"({"frames": 2, "keys": [{"frame": 1}, {"frame": 1}]})", "must grow");
  fails(R"({"frames": 2, "keys": [{"frame": 3}]})", "\"frame\" 3");
  fails(R"({"frames": 2, "keys": [{"frame": 0, "zoom": 3}]})", "unknown key \"zoom\"");
  fails(R"({"frames": 2, "keys": [{"frame": 0, "view": [1]}]})", "\"view\" must be");
  fails(R"({"frames": 2, "keys": [{"frame": 0, "fovea": [1, 2, "x"]}]})", "\"fovea\" must be");
  fails(R"({"frames": 2, "keys": [{"frame": 0, "eye": [1, 2]}]})", "\"eye\" must be");
  fails(R"({"frames": 2, "keys": [{"frame": 0, "eye": [1, 2, 3], "span": 4}]})", "one of them");
  fails(R"({"frames": 2, "keys": [{"frame": 0, "fov": 30}]})", "never say \"eye\"");
  fails(R"({"frames": 2, "keys": [{"frame": 0, "rate": null}]})", "\"rate\" must be");
  fails(R"({"frames": 2, "keys": [{"frame": 0, "step": -1}]})", "\"step\" must be");
  fails(R"({"frames": 2, "keys": [{"frame": 0, "step": 1.5}]})", "\"step\" must be");
}

}  // namespace
}  // namespace fovea::frames
