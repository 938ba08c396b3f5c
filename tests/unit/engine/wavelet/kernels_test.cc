// Every instruction set gives the bits that the plain arithmetic gives.
#include "engine/wavelet/kernels.h"

#include <algorithm>
#include <cstdint>
#include <random>
#include <vector>

#include <gtest/gtest.h>
#include <hwy/aligned_allocator.h>
#include <hwy/targets.h>

#include "engine/wavelet/forward_kernels.h"
#include "engine/wavelet/haar.h"

namespace fovea::wavelet::internal {
namespace {

constexpr int64_t kMost = 70;

std::vector<float> Noise(uint32_t seed, int64_t count) {
  std::mt19937 random(seed);
  std::vector<float> values(static_cast<size_t>(count));
  for (float& value : values) {
    value = std::uniform_real_distribution<float>(-1000, 1000)(random);
  }
  return values;
}

/// Calls `check(count)` for all lengths and instruction sets of this machine.
template <typename Check>
void ForAllTargets(const Check& check) {
  int targets = 0;
  for (const int64_t target : hwy::SupportedAndGeneratedTargets()) {
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
    ++targets;
    for (int64_t count = 0; count <= kMost; ++count) {
      check(count);
    }
    hwy::SetSupportedTargetsForTest(0);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  }
  EXPECT_GE(targets, 2);
}

TEST(KernelsTest, LiftAndScale) {
  const std::vector<float> a = Noise(1, kMost + 1), before = Noise(2, kMost);
  ForAllTargets([&](int64_t count) {
    std::vector<float> lifted = before, scaled = before;
    Lift(0.3F, a.data(), a.data() + 1, count, lifted.data());
    Scale(0.7F, a.data(), count, scaled.data());
    for (int64_t i = 0; i < kMost; ++i) {
      ASSERT_EQ(lifted[i], i < count ? before[i] + 0.3F * (a[i] + a[i + 1]) : before[i]);
      ASSERT_EQ(scaled[i], i < count ? 0.7F * a[i] : before[i]);
    }
  });
}

TEST(KernelsTest, InterleaveTakesTurns) {
  const std::vector<float> even = Noise(3, kMost), odd = Noise(4, kMost);
  ForAllTargets([&](int64_t count) {
    std::vector<float> both(2 * kMost + 1, -7);
    Interleave(even.data(), odd.data(), count, both.data());
    for (int64_t i = 0; i < count; ++i) {
      ASSERT_EQ(both[2 * i], even[i]);
      ASSERT_EQ(both[2 * i + 1], odd[i]);
    }
    ASSERT_EQ(both[2 * count], -7);
  });
}

TEST(KernelsTest, HaarRowsAreSumsAndDifferences) {
  std::vector<std::vector<float>> in;
  HaarBands bands{};
  for (uint32_t band = 0; band < 8; ++band) {
    in.push_back(Noise(10 + band, kMost));
    bands[band] = in.back().data();
  }
  ForAllTargets([&](int64_t count) {
    std::vector<std::vector<float>> out(4, std::vector<float>(2 * kMost + 1, -7));
    HaarRows rows{out[0].data(), out[1].data(), out[2].data(), out[3].data()};
    InverseHaarRow(bands, count, rows);
    for (int child = 0; child < 8; ++child) {
      const auto side = [&](int axis, float low, float high) {
        return ((child >> axis) & 1) == 0 ? low + high : low - high;
      };
      for (int64_t i = 0; i < count; ++i) {
        float z[4];
        for (int band = 0; band < 4; ++band) {
          z[band] = side(2, in[band][i], in[band + 4][i]);
        }
        const float expected = side(0, side(1, z[0], z[2]), side(1, z[1], z[3]));
        ASSERT_EQ(out[child / 2][2 * i + child % 2], expected) << child << " " << i;
      }
      ASSERT_EQ(out[child / 2][2 * count], -7);
    }
  });
}

/// What TransformStrip makes of random children, all on one instruction set: means, detail and the
/// largest, as they are in memory.
template <typename Value>
std::vector<Value> Transformed(Wavelet wavelet, int64_t edge, int64_t bricks, bool up) {
  const int64_t high = 2 * (edge + 2 * MarginOf(wavelet));
  const int64_t wide = 2 * (bricks * edge + 2 * MarginOf(wavelet));
  const auto cube = static_cast<size_t>(edge * edge * edge);
  const std::vector<float> noise = Noise(5, high * high * wide);
  const std::vector<Value> children(noise.begin(), noise.end());
  std::vector<const Value*> slices;
  std::vector<int64_t> rows;
  for (int64_t i = 0; i < high; ++i) {
    slices.push_back(children.data() + i * high * wide);
    rows.push_back(i * wide);
  }
  StripInput<Value> in;
  in.slices = slices.data();
  in.rows = rows.data();
  in.last = wide;
  in.edge = edge;
  in.bricks = bricks;
  in.up = {up, !up, up};
  const auto count = static_cast<size_t>(bricks);
  const auto work = hwy::AllocateAligned<Value>(WorkCells<Value>(wavelet, edge) + 1);
  std::fill_n(work.get(), WorkCells<Value>(wavelet, edge), Value{0});
  const auto all = hwy::AllocateAligned<Value>(8 * cube * count);
  std::vector<float> largest(count);
  TransformStrip(wavelet, in, work.get(), all.get(), all.get() + cube * count, largest.data());
  std::vector<Value> result(all.get(), all.get() + 8 * cube * count);
  for (const float value : largest) {
    result.push_back(static_cast<Value>(value));
  }
  return result;
}

template <typename Value>
void ExpectSameOnAllTargets(Wavelet wavelet) {
  for (const int64_t edge : {8, 16, 20}) {
    const int64_t bricks = edge == 16 ? MostBricks<Value>(wavelet) : 1;
    const std::vector<Value> expected = Transformed<Value>(wavelet, edge, bricks, edge == 8);
    for (const int64_t target : hwy::SupportedAndGeneratedTargets()) {
      hwy::SetSupportedTargetsForTest(target);
      hwy::GetChosenTarget().Update(hwy::SupportedTargets());
      EXPECT_TRUE(Transformed<Value>(wavelet, edge, bricks, edge == 8) == expected)
          << hwy::TargetName(target) << ", edge " << edge;
    }
    hwy::SetSupportedTargetsForTest(0);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  }
}

TEST(KernelsTest, StripsAreTheSameOnAllTargets) {
  ExpectSameOnAllTargets<float>(Wavelet::kHaar);
  ExpectSameOnAllTargets<float>(Wavelet::kCdf53);
  ExpectSameOnAllTargets<float>(Wavelet::kCdf97);
  for (const Wavelet wavelet : {Wavelet::kHaar, Wavelet::kCdf53}) {
    ExpectSameOnAllTargets<int16_t>(wavelet);
    ExpectSameOnAllTargets<int32_t>(wavelet);
  }
}

}  // namespace
}  // namespace fovea::wavelet::internal
