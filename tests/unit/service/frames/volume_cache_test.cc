#include "service/frames/volume_cache.h"

#include <atomic>
#include <initializer_list>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "service/frames/frames.h"
#include "tests/support/fake_dataset.h"
#include "tests/support/status_matchers.h"

namespace fovea::frames {
namespace {

using ::fovea::testing::FailsWith;
using ::fovea::testing::FakeDataset;

constexpr int64_t kEdge = 32;

ReadVolume Make(float value) {
  ReadVolume read;
  read.volume.levels.emplace_back(Box3{{0, 0, 0}, {kEdge, kEdge, kEdge}}, value);
  return read;
}

float ValueOf(const VolumeCache::Found& found) {
  return found.volume->volume.levels[0].values[0];
}

TEST(VolumeCacheTest, KeepsThoseUsedLastWithinItsBytes) {
  const int64_t one = BytesOf(Make(0).volume);
  EXPECT_GE(one, kEdge * kEdge * kEdge * 4);
  VolumeCache cache(2 * one);
  const auto get = [&](const std::string& key, float value) {
    return *cache.Get(key, [&]() -> StatusOr<ReadVolume> { return Make(value); });
  };
  EXPECT_FALSE(get("a", 1).hit);
  EXPECT_FALSE(get("b", 2).hit);
  EXPECT_TRUE(get("a", 9).hit);
  EXPECT_EQ(ValueOf(get("a", 9)), 1.0F);
  EXPECT_FALSE(get("c", 3).hit);  // in the place of b
  EXPECT_TRUE(get("a", 9).hit);
  EXPECT_FALSE(get("b", 4).hit);
  const VolumeCache::Counts counts = cache.counts();
  EXPECT_EQ(counts.hits, 3U);
  EXPECT_EQ(counts.misses, 4U);
  EXPECT_EQ(counts.evictions, 2U);
  EXPECT_EQ(counts.entries, 2);
  EXPECT_EQ(counts.bytes, 2 * one);
}

TEST(VolumeCacheTest, WhatIsTooLargeOrDamagedOrAnErrorIsNotKept) {
  VolumeCache small(1000);
  for (int i = 0; i < 2; ++i) {
    ASSERT_OK_AND_ASSIGN(const auto found,
                         small.Get("a", []() -> StatusOr<ReadVolume> { return Make(1); }));
    EXPECT_FALSE(found.hit);
  }
  EXPECT_EQ(small.counts().bytes, 0);
  VolumeCache cache(int64_t{1} << 30);
  for (int i = 0; i < 2; ++i) {
    EXPECT_THAT(cache.Get("a", []() -> StatusOr<ReadVolume> { return NotFound("gone"); }),
                FailsWith(absl::StatusCode::kNotFound, "gone"));
    ASSERT_OK_AND_ASSIGN(const auto found, cache.Get("b", []() -> StatusOr<ReadVolume> {
      ReadVolume read = Make(1);
      read.read.chunks_damaged = 1;
      return read;
    }));
    EXPECT_FALSE(found.hit);
  }
  EXPECT_EQ(cache.counts().entries, 0);
}

TEST(VolumeCacheTest, ManyAtTheSameTimeMakeItOnce) {
  VolumeCache cache(int64_t{1} << 30);
  std::atomic<int> made = 0;
  std::vector<std::thread> threads;
  for (int i = 0; i < 8; ++i) {
    threads.emplace_back([&] {
      const auto found = cache.Get("a", [&]() -> StatusOr<ReadVolume> {
        ++made;
        while (made == 1 && cache.counts().hits < 7) {  // until all others wait for it
          std::this_thread::yield();
        }
        return Make(5);
      });
      ASSERT_OK(found.status());
      EXPECT_EQ(ValueOf(*found), 5.0F);
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  EXPECT_EQ(made, 1);
  EXPECT_EQ(cache.counts().misses, 1U);
}

TEST(VolumeKeyTest, TellsApartWhatMakesAnotherVolume) {
  FrameSpec spec;
  spec.fovea = Position{{1, 2, 3}};
  spec.rate = Rate(40);
  const std::string key = VolumeKey(1, 2, "density", spec);
  EXPECT_NE(VolumeKey(2, 2, "density", spec), key);
  EXPECT_NE(VolumeKey(1, 3, "density", spec), key);
  EXPECT_NE(VolumeKey(1, 2, "heat", spec), key);
  for (void (*change)(FrameSpec*) : std::initializer_list<void (*)(FrameSpec*)>{
           [](FrameSpec* s) { s->fovea->at.x += 1e-15; }, [](FrameSpec* s) { s->fovea->at.z = 4; },
           [](FrameSpec* s) { s->rate->y = 41; },
           [](FrameSpec* s) { s->window = WindowShape::kSphere; },
           [](FrameSpec* s) { s->reconstruction = Reconstruction::kFast; },
           [](FrameSpec* s) { s->strict = true; }}) {
    FrameSpec other = spec;
    change(&other);
    EXPECT_NE(VolumeKey(1, 2, "density", other), key);
  }
  FrameSpec other_view = spec;
  other_view.view.azimuth_deg = 77;
  other_view.width_px = 3;
  EXPECT_EQ(VolumeKey(1, 2, "density", other_view), key);
}

TEST(SharedFrameTest, AnotherViewReadsNothingAndHasTheSameBytes) {
  FakeDataset dataset(2);
  ASSERT_OK_AND_ASSIGN(const FrameSpec defaults, DefaultSpec(dataset));
  VolumeCache cache(int64_t{1} << 30);
  FrameSpec spec;
  spec.encoding = Encoding::kRawRgbaF32;
  spec.width_px = spec.height_px = 32;
  for (int i = 0; i < 3; ++i) {
    spec.view.azimuth_deg = 25.0 * i;
    ASSERT_OK_AND_ASSIGN(const FrameSpec resolved, ResolveSpec(dataset, spec, defaults));
    ASSERT_OK_AND_ASSIGN(const Frame alone, RenderFrame(dataset, "fake", 1, resolved, 1));
    ASSERT_OK_AND_ASSIGN(const Frame shared,
                         RenderFrame(dataset, "fake", 1, resolved, 1, {&cache, 7}));
    EXPECT_TRUE(shared.pixels == alone.pixels) << i;
    EXPECT_EQ(shared.stats.chunks_read, i == 0 ? alone.stats.chunks_read : 0);
    EXPECT_EQ(shared.stats.chunks_total, alone.stats.chunks_total);
    EXPECT_EQ(shared.stats.coefficients, alone.stats.coefficients);
  }
  EXPECT_EQ(cache.counts().misses, 1U);
  EXPECT_EQ(cache.counts().hits, 2U);
}

}  // namespace
}  // namespace fovea::frames
