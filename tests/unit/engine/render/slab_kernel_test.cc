// The SIMD kernel against equation (3) in double, and its instruction sets against each other.
#include "engine/render/slab_kernel.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <vector>

#include <gtest/gtest.h>
#include <hwy/targets.h>

namespace fovea::render {
namespace {

constexpr int64_t kStride = 61;
constexpr int64_t kRows = 12;
constexpr int64_t kSlices = 4;

std::vector<float> RandomValues(uint32_t seed, size_t count) {
  std::mt19937 random(seed);
  std::vector<float> values(count);
  for (float& value : values) {
    value = std::uniform_real_distribution<float>(-0.1F, 1.1F)(random);
  }
  return values;
}

/// Points at random places; opacities to 1, colours free, a step, a transparent stretch.
TransferFunction RandomFunction(uint32_t seed, int points) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> unit(0, 1);
  TransferFunction transfer;
  for (int i = 0; i < points; ++i) {
    const bool clear = i == points / 2 || i == points / 2 + 1;
    const bool opaque = i == points - 1;
    transfer.points.push_back({unit(random),
                               {unit(random), unit(random), unit(random)},
                               clear    ? 0.0F
                               : opaque ? 1.0F
                                        : 0.3F * unit(random)});
  }
  std::sort(transfer.points.begin(), transfer.points.end(),
            [](const auto& a, const auto& b) { return a.value < b.value; });
  if (points > 4) {
    transfer.points[1].value = transfer.points[2].value;
  }
  return transfer;
}

struct Planes {
  std::vector<float> red, green, blue, transmittance;
  explicit Planes(size_t n) : red(n), green(n), blue(n), transmittance(n, 1.0F) {}
  [[nodiscard]] std::array<const std::vector<float>*, 4> All() const {
    return {&red, &green, &blue, &transmittance};
  }
  friend bool operator==(const Planes&, const Planes&) = default;
};

struct Scene {
  std::vector<float> values = RandomValues(1, kStride* kRows* kSlices);
  std::vector<float> other = RandomValues(2, kStride* kRows* kSlices);
  std::vector<float> opacity_scale = RandomValues(3, kStride* kRows);
  std::vector<float> length_scale = RandomValues(4, kStride* kRows);
  std::vector<SlabRun> runs;

  Scene() {
    // Every length from 1 up, so that every tail of every vector width occurs.
    for (int64_t row = 1; row + 3 < kRows; ++row) {
      const int64_t base = row * kStride;
      runs.push_back({base + 2, base + 1, 7 * row % 17 + 1});
      runs.push_back({base + 22, base + 21, 4 * row + 1});
    }
    for (float& scale : opacity_scale) {
      scale = std::abs(scale) / 1.2F;
    }
    for (float& scale : length_scale) {
      scale = std::abs(scale) / 1.2F;
    }
  }

  [[nodiscard]] Slab SlabInto(Planes* planes, bool weighted) const {
    Slab slab;
    slab.taps = values.data() + kStride * kRows;
    slab.row_stride = kStride;
    slab.slice_stride = kStride * kRows;
    slab.fu = 0.3F;
    slab.fv = 0.85F;
    slab.length = 1.7F;
    if (weighted) {
      slab.opacity_scale = opacity_scale.data();
      slab.length_scale = length_scale.data();
    }
    slab.red = planes->red.data();
    slab.green = planes->green.data();
    slab.blue = planes->blue.data();
    slab.transmittance = planes->transmittance.data();
    return slab;
  }
};

double Bilinear(const std::vector<float>& values, const Slab& slab, int64_t tap) {
  const float* t = values.data() + kStride * kRows + tap;
  const double fu = slab.fu;
  const double fv = slab.fv;
  return (1 - fv) * ((1 - fu) * t[0] + fu * t[1]) +
         fv * ((1 - fu) * t[kStride] + fu * t[kStride + 1]);
}

std::array<double, 4> Evaluate(const TransferFunction& transfer, double value) {
  const auto& points = transfer.points;
  const auto channels = [](const TransferFunction::Point& p) {
    return std::array<double, 4>{p.color.red, p.color.green, p.color.blue, p.opacity};
  };
  if (value <= points.front().value) {
    return channels(points.front());
  }
  for (size_t i = 0; i + 1 < points.size(); ++i) {
    if (value <= points[i + 1].value) {
      const double f = (value - points[i].value) / (points[i + 1].value - points[i].value);
      std::array<double, 4> mixed = channels(points[i]);
      for (int c = 0; c < 4; ++c) {
        mixed[c] += f * (channels(points[i + 1])[c] - mixed[c]);
      }
      return mixed;
    }
  }
  return channels(points.back());
}

/// Three slabs, one behind the other, through the same pixels.
Planes ThreeSlabs(const Scene& scene, const TransferFunction& transfer,
                  const TransferFunction* color, const KernelLight* light, bool weighted,
                  const SlabCover* cover = nullptr) {
  Planes planes(static_cast<size_t>(kStride * kRows));
  Slab slab = scene.SlabInto(&planes, weighted);
  if (color != nullptr) {
    slab.color_taps = scene.other.data() + kStride * kRows;
  }
  slab.cover = cover;
  const KernelFunction function(transfer);
  const KernelFunction paint(color != nullptr ? *color : transfer);
  for (int n = 0; n < 3; ++n) {
    CompositeSlab(function, paint, light, slab, scene.runs);
    slab.fu += 0.2F;
  }
  return planes;
}

Planes Expected(const Scene& scene, const TransferFunction& transfer, const TransferFunction* color,
                bool weighted) {
  Planes planes(static_cast<size_t>(kStride * kRows));
  Slab slab = scene.SlabInto(&planes, weighted);
  for (int n = 0; n < 3; ++n) {
    for (const SlabRun& run : scene.runs) {
      for (int64_t i = 0; i < run.count; ++i) {
        const auto at = static_cast<size_t>(run.pixel + i);
        auto c = Evaluate(transfer, Bilinear(scene.values, slab, run.tap + i));
        const double alpha = c[3] * (weighted ? scene.opacity_scale[at] : 1.0);
        if (color != nullptr) {
          c = Evaluate(*color, Bilinear(scene.other, slab, run.tap + i));
        }
        const double length =
            static_cast<double>(slab.length) * (weighted ? scene.length_scale[at] : 1.0);
        const double passes = std::pow(1 - alpha, length);
        const double weight = planes.transmittance[at] * (1 - passes);
        planes.red[at] += static_cast<float>(weight * c[0]);
        planes.green[at] += static_cast<float>(weight * c[1]);
        planes.blue[at] += static_cast<float>(weight * c[2]);
        planes.transmittance[at] *= static_cast<float>(passes);
      }
    }
    slab.fu += 0.2F;
  }
  return planes;
}

double LargestDifference(const Planes& a, const Planes& b) {
  double largest = 0;
  for (size_t c = 0; c < 4; ++c) {
    for (size_t i = 0; i < a.red.size(); ++i) {
      largest =
          std::max(largest, std::abs(static_cast<double>((*a.All()[c])[i]) - (*b.All()[c])[i]));
    }
  }
  return largest;
}

/// Runs `body` once for each instruction set this machine has; then the best is in use again.
template <typename Body>
void ForEachTarget(const Body& body) {
  for (const int64_t target : hwy::SupportedAndGeneratedTargets()) {
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
    body(target);
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
}

TEST(SlabKernelTest, EveryInstructionSetFollowsEquationThree) {
  const Scene scene;
  for (uint32_t seed = 1; seed < 30; ++seed) {
    const TransferFunction transfer = RandomFunction(seed, 1 + static_cast<int>(seed) % 9);
    const TransferFunction color = RandomFunction(seed + 100, 1 + static_cast<int>(seed) % 4);
    for (const bool weighted : {false, true}) {
      for (const TransferFunction* paint :
           {static_cast<const TransferFunction*>(nullptr), &color}) {
        const Planes expected = Expected(scene, transfer, paint, weighted);
        ForEachTarget([&](int64_t target) {
          EXPECT_LT(
              LargestDifference(ThreeSlabs(scene, transfer, paint, nullptr, weighted), expected),
              3e-6)
              << hwy::TargetName(target) << " seed " << seed << " weighted " << weighted;
        });
      }
    }
  }
}

/// A polynomial for slabs of one length stands in for logarithm and exponential.
TEST(SlabKernelTest, CoverByPolynomialFollowsEquationThree) {
  const Scene scene;
  int with_polynomial = 0;
  for (uint32_t seed = 1; seed < 30; ++seed) {
    TransferFunction transfer = RandomFunction(seed, 2 + static_cast<int>(seed) % 5);
    double most = 0;
    for (auto& point : transfer.points) {
      point.opacity *= 0.03F * static_cast<float>(seed);
      most = std::max(most, static_cast<double>(point.opacity));
    }
    const SlabCover cover(1.7F, most);
    with_polynomial += cover.count > 0 ? 1 : 0;
    const Planes expected = Expected(scene, transfer, nullptr, false);
    ForEachTarget([&](int64_t target) {
      const Planes planes = ThreeSlabs(scene, transfer, nullptr, nullptr, false, &cover);
      EXPECT_LT(LargestDifference(planes, expected), 3e-6)
          << hwy::TargetName(target) << " seed " << seed << " " << cover.count << " coefficients";
    });
  }
  EXPECT_GT(with_polynomial, 20);
}

TEST(SlabCoverTest, IsExactOrEmpty) {
  for (const double length : {0.3, 1.0, 1.155, 2.0, 18.5, 140.0}) {
    for (const double most : {1e-4, 0.004, 0.067, 0.3, 0.8, 0.999, 1.0}) {
      const SlabCover cover(length, most);
      for (int i = 0; cover.count > 0 && i <= 1000; ++i) {
        const float opacity = static_cast<float>(most) * static_cast<float>(i) / 1000;
        float sum = 0;
        for (int c = 0; c < cover.count; ++c) {
          sum = std::fma(sum, opacity, cover.coefficients[static_cast<size_t>(c)]);
        }
        const double expected = 1 - std::pow(1 - static_cast<double>(opacity), length);
        ASSERT_NEAR(sum * opacity, expected, 6e-7 * expected + 1e-12)
            << "length " << length << " opacity " << opacity << " of " << most;
      }
    }
  }
  EXPECT_GT(SlabCover(1.155, 0.3).count, 0);  // what most frames need
  EXPECT_GT(SlabCover(18.5, 0.067).count, 0);
  EXPECT_EQ(SlabCover(18.5, 0.9).count, 0);
}

/// More points than ramps are read from a table, which is a little less exact.
TEST(SlabKernelTest, ManyPointsComeFromATable) {
  const Scene scene;
  TransferFunction transfer;
  for (int i = 0; i <= 200; ++i) {
    const float f = static_cast<float>(i) / 200;
    transfer.points.push_back({f, {f, 1 - f, 0.5F + 0.4F * std::sin(20 * f)}, 0.2F * f * f});
  }
  for (const bool weighted : {false, true}) {
    const Planes expected = Expected(scene, transfer, nullptr, weighted);
    ForEachTarget([&](int64_t target) {
      EXPECT_LT(
          LargestDifference(ThreeSlabs(scene, transfer, nullptr, nullptr, weighted), expected),
          2e-4)
          << hwy::TargetName(target);
    });
  }
}

TEST(SlabKernelTest, Avx2AndAvx512GiveTheSameBits) {
  const Scene scene;
  const KernelLight light{
      {1, 0.1F, 0, 0, 1, 0, 0, 0.2F, 1.3F}, {0, 0.6F, 0.8F}, {0, 0, 1}, 0.3F, 0.6F, 0.3F, 4, 1e-3F};
  std::vector<std::vector<Planes>> by_target;
  ForEachTarget([&](int64_t target) {
    if (target != HWY_AVX2 && target != HWY_AVX3 && target != HWY_AVX3_DL) {
      return;
    }
    std::vector<Planes>& results = by_target.emplace_back();
    for (uint32_t seed = 1; seed < 12; ++seed) {
      const TransferFunction transfer = RandomFunction(seed, static_cast<int>(seed));
      results.push_back(ThreeSlabs(scene, transfer, nullptr, nullptr, seed % 2 == 0));
      results.push_back(ThreeSlabs(scene, transfer, &transfer, &light, seed % 2 == 0));
    }
  });
  if (by_target.size() < 2) {
    GTEST_SKIP() << "this machine has no AVX-512";
  }
  for (const auto& results : by_target) {
    EXPECT_TRUE(results == by_target.front());
  }
}

TEST(SlabKernelTest, NotANumberHarmsNobody) {
  Scene scene;
  std::fill(scene.values.begin(), scene.values.end(), std::nanf(""));
  ForEachTarget([&](int64_t) {
    const Planes planes = ThreeSlabs(scene, RandomFunction(3, 5), nullptr, nullptr, false);
    for (const auto* plane : planes.All()) {
      EXPECT_TRUE(
          std::all_of(plane->begin(), plane->end(), [](float x) { return std::isfinite(x); }));
    }
  });
}

TEST(SlabKernelTest, MaximumKeepsTheLargestValue) {
  const Scene scene;
  Planes planes(static_cast<size_t>(kStride * kRows));
  const Slab slab = scene.SlabInto(&planes, false);
  ForEachTarget([&](int64_t) {
    std::fill(planes.red.begin(), planes.red.end(), 0.5F);
    MaximumSlab(slab, scene.runs);
    for (const SlabRun& run : scene.runs) {
      for (int64_t i = 0; i < run.count; ++i) {
        const double value = Bilinear(scene.values, slab, run.tap + i);
        EXPECT_NEAR(planes.red[static_cast<size_t>(run.pixel + i)], std::max(0.5, value), 1e-6);
      }
    }
  });
}

}  // namespace
}  // namespace fovea::render
