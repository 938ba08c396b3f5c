// A foveated frame is a value: what it shows depends on its leaf pixels and shape alone, wherever
// it is expanded, on any number of threads and on every instruction set.
#include "engine/render/foveated_frame.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <hwy/targets.h>

#include "engine/fovea/coefficient_source.h"
#include "engine/fovea/reconstruct.h"
#include "engine/render/expand.h"
#include "engine/render/frame_scratch.h"
#include "engine/render/renderer.h"
#include "tests/support/allocations.h"
#include "tests/support/status_matchers.h"
#include "tests/support/volumes.h"

namespace fovea::render {
namespace {

constexpr Smoothing kAllSmoothings[] = {Smoothing::kNone, Smoothing::kImage, Smoothing::kFull};

SuperVoxels MakeSuperVoxels(const Int3& dims, const Fovea& fovea) {
  const CoefficientSet set = testing::MakeCoefficients(testing::MakeWavyGrid(dims));
  MemorySource source(set);
  return Reconstruct(source, RetainedSet::Make(set.hierarchy, fovea).value(), 1).value();
}

/// Sizes that fill no whole vectors, a fovea near a border, a view oblique on both axes.
SuperVoxels OddSuperVoxels() {
  return MakeSuperVoxels({61, 90, 47}, {{20, 84, 24}, 9});
}

RenderSettings ObliqueSettings() {
  RenderSettings settings;
  settings.transfer = {{{0.1, {0.1F, 0.2F, 0.9F}, 0.0F},
                        {0.5, {0.9F, 0.5F, 0.1F}, 0.04F},
                        {1.0, {1.0F, 1.0F, 1.0F}, 0.3F}}};
  settings.view.azimuth_deg = 205;
  settings.view.elevation_deg = 33;
  settings.width_px = 143;
  settings.height_px = 101;
  settings.threads = 1;
  return settings;
}

bool HasSameBits(const Image& a, const Image& b) {
  return a.width == b.width && a.height == b.height && a.rgba.size() == b.rgba.size() &&
         std::memcmp(a.rgba.data(), b.rgba.data(), a.rgba.size() * sizeof(float)) == 0;
}

double LargestDifference(const Image& a, const Image& b) {
  EXPECT_EQ(a.rgba.size(), b.rgba.size());
  double largest = 0;
  for (size_t i = 0; i < a.rgba.size(); ++i) {
    largest = std::max(largest, static_cast<double>(std::abs(a.rgba[i] - b.rgba[i])));
  }
  return largest;
}

/// Built from what would be sent: shapes, kinds, and the values of leaf pixels.
FoveatedFrame Received(const FoveatedFrame& sent) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  FoveatedFrame frame;
  frame.sheet = sent.sheet;
  frame.warp = sent.warp;
  frame.width_px = sent.width_px;
  frame.height_px = sent.height_px;
  for (const FrameLevel& from : sent.levels) {
    FrameLevel& level = frame.levels.emplace_back();
    level.width = from.width;
    level.rect = from.rect;
    level.void_u0 = from.void_u0;
    level.void_u1 = from.void_u1;
    level.void_v0 = from.void_v0;
    level.void_v1 = from.void_v1;
    level.crossing = from.crossing;
    level.kinds = from.kinds;
    level.values.assign(from.values.size(), {kNan, kNan, kNan, kNan});
    for (size_t i = 0; i < from.kinds.size(); ++i) {
      if (from.kinds[i] == PixelKind::kLeaf) {
        level.values[i] = from.values[i];
      }
    }
  }
  return frame;
}

TEST(FoveatedFrameTest, ExpandsToTheSameBitsFromItsLeafPixelsAlone) {
  const SuperVoxels volume = OddSuperVoxels();
  RenderSettings settings = ObliqueSettings();
  for (const Smoothing smoothing : kAllSmoothings) {
    settings.smoothing = smoothing;
    settings.basis = smoothing == Smoothing::kImage ? Basis::kBspline : Basis::kBilinear;
    ASSERT_OK_AND_ASSIGN(const Image image, RenderFoveated(volume, Matrix4{}, settings));
    ASSERT_OK_AND_ASSIGN(const FoveatedFrame frame, RenderFrame(volume, Matrix4{}, settings));
    EXPECT_OK(Validate(frame));
    ASSERT_GT(*std::max_element(image.rgba.begin(), image.rgba.end()), 0.1F);
    EXPECT_TRUE(HasSameBits(
        image, Expand(Received(frame), image.width, image.height, smoothing, settings.basis, 1)));
  }
}

TEST(FoveatedFrameTest, ExpandsToTheSameViewAtAnotherSize) {
  const SuperVoxels volume = OddSuperVoxels();
  RenderSettings settings = ObliqueSettings();
  ASSERT_OK_AND_ASSIGN(const FoveatedFrame frame, RenderFrame(volume, Matrix4{}, settings));
  for (const auto& [width, height] : {std::pair(286, 202), std::pair(64, 99), std::pair(1, 1)}) {
    settings.width_px = width;
    settings.height_px = height;
    ASSERT_OK_AND_ASSIGN(const Image image, RenderFoveated(volume, Matrix4{}, settings));
    EXPECT_LT(LargestDifference(Expand(frame, width, height, settings.smoothing, settings.basis, 1),
                                image),
              1e-5);
  }
}

TEST(FoveatedFrameTest, HasTheSameBitsOnAnyThreadsAndInstructionSets) {
  const SuperVoxels volume = OddSuperVoxels();
  RenderSettings settings = ObliqueSettings();
  for (const Smoothing smoothing : kAllSmoothings) {
    settings.smoothing = smoothing;
    settings.threads = 1;
    ASSERT_OK_AND_ASSIGN(const Image image, RenderFoveated(volume, Matrix4{}, settings));
    for (settings.threads = 2; settings.threads <= 8; settings.threads += 3) {
      ASSERT_OK_AND_ASSIGN(const Image other, RenderFoveated(volume, Matrix4{}, settings));
      EXPECT_TRUE(HasSameBits(image, other)) << settings.threads << " threads";
    }
    std::vector<Image> with_fma;
    for (const int64_t target : hwy::SupportedAndGeneratedTargets()) {
      hwy::SetSupportedTargetsForTest(target);
      ASSERT_OK_AND_ASSIGN(const Image other, RenderFoveated(volume, Matrix4{}, settings));
      EXPECT_LT(LargestDifference(image, other), 1e-5) << hwy::TargetName(target);
      if (target == HWY_AVX2 || target == HWY_AVX3 || target == HWY_AVX3_DL) {
        with_fma.push_back(other);
        EXPECT_TRUE(HasSameBits(with_fma[0], other)) << hwy::TargetName(target);
      }
    }
    hwy::SetSupportedTargetsForTest(0);
  }
}

TEST(FoveatedFrameTest, BuffersMayServeAnyFrameAfterAnyOther) {
  const SuperVoxels volumes[] = {OddSuperVoxels(), MakeSuperVoxels({33, 20, 64}, {{9, 9, 9}, 21}),
                                 MakeSuperVoxels({5, 6, 7}, {{1, 2, 3}, 2})};
  FrameScratch scratch;
  Image image;
  RenderSettings settings = ObliqueSettings();
  for (int i = 0; i < 12; ++i) {
    const SuperVoxels& volume = volumes[i % 3];
    settings.smoothing = kAllSmoothings[i % 2 + i / 6];
    settings.view.azimuth_deg = 70 * i;
    settings.width_px = 60 + 31 * (i % 5);
    ASSERT_OK_AND_ASSIGN(const Image fresh, RenderFoveated(volume, Matrix4{}, settings));
    ASSERT_OK(RenderFoveated(volume, Matrix4{}, settings, &scratch, &image));
    EXPECT_TRUE(HasSameBits(fresh, image)) << "frame " << i;
  }
}

TEST(FoveatedFrameTest, WithItsBuffersExpandingAllocatesNothing) {
  const SuperVoxels volume = OddSuperVoxels();
  const RenderSettings settings = ObliqueSettings();
  FrameScratch scratch;
  Image image;
  ASSERT_OK(RenderFrame(volume, Matrix4{}, settings, &scratch));
  std::vector<FrameLevel> levels;
  for (int round = 0; round < 3; ++round) {
    const size_t before = testing::AllocationCount();
    Combine(true, 1, &scratch.trace.layers, &scratch.combine, &levels);
    for (const Smoothing smoothing : kAllSmoothings) {
      Expand(scratch.frame, 143, 101, smoothing, Basis::kBspline, 1, &scratch.expand, &image);
    }
    const size_t made = testing::AllocationCount() - before;
    EXPECT_EQ(made > 0, round == 0) << made << " in round " << round;
  }
}

/// One level of leaves two voxels wide, seen from straight ahead, a picture's pixel a voxel.
FoveatedFrame FrameOf(const std::function<float(int64_t u, int64_t v)>& value) {
  FoveatedFrame frame;
  frame.sheet = {0, 40, 0, 40};
  frame.width_px = frame.height_px = 40;
  frame.warp = {1, 0, 0.5, 0, 1, 0.5};
  for (const int64_t width : {2, 1}) {  // of the finest level there are no pixels
    FrameLevel& level = frame.levels.emplace_back();
    level.width = width;
    level.rect = width == 2 ? Rect{0, 20, 0, 20} : Rect{10, 12, 10, 12};
    level.void_u0 = level.void_u1 = level.void_v0 = level.void_v1 = width == 2;
    level.crossing = level.rect;
    const auto pixels = static_cast<size_t>(level.rect.Width() * level.rect.Height());
    level.kinds.assign(pixels, width == 2 ? PixelKind::kLeaf : PixelKind::kAbsent);
    level.values.resize(pixels);
  }
  FrameLevel& level = frame.levels.front();
  for (int64_t v = 0; v < 20; ++v) {
    for (int64_t u = 0; u < 20; ++u) {
      const float x = value(u, v);
      level.values[level.Index(u, v)] = {x, x, x, 1};
    }
  }
  return frame;
}

TEST(FoveatedFrameTest, BothBasesKeepSlopesAndSums) {
  const FoveatedFrame slope = FrameOf([](int64_t u, int64_t v) {
    return 0.1F + 0.01F * static_cast<float>(u) + 0.02F * static_cast<float>(v);
  });
  const FoveatedFrame spot =
      FrameOf([](int64_t u, int64_t v) { return u == 9 && v == 8 ? 0.625F : 0.5F; });
  for (const Basis basis : {Basis::kBilinear, Basis::kBspline}) {
    const Image image = Expand(slope, 40, 40, Smoothing::kImage, basis, 1);
    const Image spotted = Expand(spot, 40, 40, Smoothing::kImage, basis, 1);
    double sum = 0;
    for (int j = 4; j < 36; ++j) {
      for (int i = 4; i < 36; ++i) {
        const size_t at = 4 * (40 * static_cast<size_t>(j) + static_cast<size_t>(i));
        // Pixel u has its centre at 2 u + 1.
        EXPECT_NEAR(image.rgba[at], 0.1 + 0.01 * (i - 0.5) / 2 + 0.02 * (j - 0.5) / 2, 1e-6);
        EXPECT_NEAR(spotted.rgba[at + 3], 1, 1e-6);
        sum += spotted.rgba[at] - 0.5;
      }
    }
    EXPECT_NEAR(sum, 4 * 0.125, 1e-5);
  }
}

/// Pixels of all levels of a frame of an empty volume of n^3 voxels, fovea in its middle.
size_t PixelsOfFrame(int64_t n, double rate) {
  const Int3 dims{n, n, n};
  const BrickGrid bricks(dims, 16, 1, 0.0F);
  const CoefficientSet set = wavelet::ForwardHaar(bricks, Hierarchy::Make(dims).value(), 1);
  MemorySource source(set);
  const double middle = static_cast<double>(n) / 2;
  const RetainedSet retained =
      RetainedSet::Make(set.hierarchy, {{middle, middle, middle}, rate}).value();
  const SuperVoxels volume = Reconstruct(source, retained, 1).value();
  const FoveatedFrame frame = RenderFrame(volume, Matrix4{}, ObliqueSettings()).value();
  size_t pixels = 0;
  for (const FrameLevel& level : frame.levels) {
    pixels += level.values.size();
  }
  return pixels;
}

TEST(FoveatedFrameTest, GrowsWithTheLevelsNotWithTheVolume) {
  const size_t at_64 = PixelsOfFrame(64, 12);
  const size_t at_256 = PixelsOfFrame(256, 12);
  const size_t at_1024 = PixelsOfFrame(1024, 12);
  // Two more levels each, of windows that are equal but for rounding.
  EXPECT_LE(at_1024 - at_256, at_256 - at_64 + (at_256 - at_64) / 5);
  EXPECT_LT(at_1024, size_t{70} * 12 * 12);
}

TEST(FoveatedFrameTest, InvalidFramesAreRefusedWithTheirLevel) {
  const FoveatedFrame valid = RenderFrame(OddSuperVoxels(), Matrix4{}, ObliqueSettings()).value();
  ASSERT_OK(Validate(valid));
  struct Damage {
    const char* says;
    std::function<void(FoveatedFrame*)> damage;
  };
  const Damage damages[] = {
      {"0 levels", [](FoveatedFrame* f) { f->levels.clear(); }},
      {"picture size", [](FoveatedFrame* f) { f->width_px = 0; }},
      {"picture size", [](FoveatedFrame* f) { f->warp[4] = NAN; }},
      {"level 1 has pixels", [](FoveatedFrame* f) { f->levels[1].width *= 2; }},
      {"level 2 has no pixels", [](FoveatedFrame* f) { f->levels[2].rect.u1 = -99999; }},
      {"level 0 has", [](FoveatedFrame* f) { f->levels[0].values.pop_back(); }},
      {"of level 1 do not fit", [](FoveatedFrame* f) { f->levels[1].kinds[0] = PixelKind(7); }},
      {"do not fit", [](FoveatedFrame* f) { f->levels.pop_back(); }},
      {"of level 0 do not fit",
       [](FoveatedFrame* f) {
         f->levels[0].kinds.assign(f->levels[0].kinds.size(), PixelKind::kSplit);
       }},
  };
  for (const Damage& damage : damages) {
    FoveatedFrame frame = valid;
    damage.damage(&frame);
    const Status status = Validate(frame);
    EXPECT_FALSE(status.ok()) << damage.says;
    EXPECT_THAT(std::string(MessageOf(status)), ::testing::HasSubstr(damage.says));
  }
}

}  // namespace
}  // namespace fovea::render
