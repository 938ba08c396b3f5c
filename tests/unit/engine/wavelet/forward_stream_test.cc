// The streaming forward transform against plain loops over whole lines, bit for bit, however the
// voxels come.
#include "engine/wavelet/forward_stream.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <map>
#include <mutex>
#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "engine/wavelet/transform.h"
#include "tests/support/status_matchers.h"

namespace fovea::wavelet {
namespace {

using Key = std::array<int64_t, 4>;  // level, z, y, x

/// Keeps all bricks as floats, and checks what a sink is promised.
class Collector : public DetailSink {
 public:
  explicit Collector(CoefficientType type) : type_(type) {}

  Status Take(const DetailBrick& brick) override {
    std::vector<float> values;
    float largest = 0;
    const size_t size = type_ == CoefficientType::kInt16 ? 2 : 4;
    for (size_t at = 0; at < brick.values.size(); at += size) {
      values.push_back(ValueAt(brick.values.data() + at));
      largest = std::max(largest, std::abs(values.back()));
    }
    const std::lock_guard lock(mutex_);
    EXPECT_EQ(brick.largest, largest);
    EXPECT_GT(brick.largest, 0);
    EXPECT_EQ(reinterpret_cast<uintptr_t>(brick.values.data()) % 64, 0U);
    EXPECT_EQ(brick.at.z, ended_[brick.level]) << "a layer that is not the next";
    const bool is_new =
        bricks.emplace(Key{brick.level, brick.at.z, brick.at.y, brick.at.x}, values).second;
    EXPECT_TRUE(is_new);
    return absl::OkStatus();
  }
  Status EndLayer(int level, int64_t z) override {
    EXPECT_EQ(z, ended_[level]++);
    return stop_after-- > 0 ? absl::OkStatus() : Cancelled("enough");
  }

  std::map<Key, std::vector<float>> bricks;
  int64_t stop_after = 1 << 20;  // layers

 private:
  [[nodiscard]] float ValueAt(const std::byte* at) const {
    if (type_ == CoefficientType::kFloat32) {
      float value;
      std::memcpy(&value, at, sizeof(value));
      return value;
    }
    int32_t value = 0;
    int16_t small = 0;
    if (type_ == CoefficientType::kInt16) {
      std::memcpy(&small, at, sizeof(small));
      return small;
    }
    std::memcpy(&value, at, sizeof(value));
    return static_cast<float>(value);
  }

  const CoefficientType type_;
  std::mutex mutex_;
  std::map<int, int64_t> ended_;
};

/// One step of lifting in plain arithmetic.
float Lifted(const Basis& basis, int step, bool up, float target, float a, float b) {
  if (basis.wavelet == Wavelet::kCdf97) {
    constexpr float kSteps[] = {-1.586134342059924F, -0.052980118572961F, 0.882911075530934F,
                                0.443506852043971F};
    return target + kSteps[step] * (a + b);
  }
  if (!basis.integer) {
    return target + (step == 0 ? -0.5F : 0.25F) * (a + b);
  }
  const double half = step == 0 ? (a + b + (up ? 1 : 0)) / 2 : (a + b + (up ? 1 : 2)) / 4;
  return target + static_cast<float>(step == 0 ? -std::floor(half) : std::floor(half));
}

/// Lifts one line in place; evens become low-pass, odds high-pass.
void LiftLine(const Basis& basis, bool up, std::vector<float>* line) {
  const int64_t n = std::ssize(*line);
  if (n == 1) {
    return;
  }
  std::vector<float>& v = *line;
  if (basis.wavelet == Wavelet::kHaar) {  // of integers: float Haar is not done line by line
    for (int64_t i = 0; i + 1 < n; i += 2) {
      const float d = v[i] - v[i + 1];
      v[i] -= std::floor((d + (up ? 0 : 1)) / 2);
      v[i + 1] = d;
    }
    return;
  }
  const int steps = basis.wavelet == Wavelet::kCdf97 ? 4 : 2;
  for (int step = 0; step < steps; ++step) {
    for (int64_t i = step % 2 == 0 ? 1 : 0; i < n; i += 2) {
      v[i] =
          Lifted(basis, step, up, v[i], v[std::abs(i - 1)], v[i + 1 < n ? i + 1 : 2 * n - 3 - i]);
    }
  }
}

/// One level of the transform of dims {x, y, z} values, evens and odds left where they are, scales
/// left out.
void LiftVolume(const Basis& basis, int level, const Int3& dims, std::vector<float>* values) {
  const Int3 strides{1, dims.x, dims.x * dims.y};
  for (const int axis : {2, 1, 0}) {
    const bool up = (axis + level) % 2 != 0;
    for (int64_t i = 0; i < dims.Product(); ++i) {
      if (i / strides[axis] % dims[axis] != 0) {
        continue;
      }
      std::vector<float> line;
      for (int64_t k = 0; k < dims[axis]; ++k) {
        line.push_back((*values)[i + k * strides[axis]]);
      }
      LiftLine(basis, up, &line);
      for (int64_t k = 0; k < dims[axis]; ++k) {
        (*values)[i + k * strides[axis]] = line[k];
      }
    }
  }
}

/// The Haar coefficients of the eight children of parent p: children outside repeat the last ones.
float HaarCoefficient(const Int3& dims, const std::vector<float>& values, const Int3& p, int band) {
  float sums[8];
  for (int child = 0; child < 8; ++child) {
    Int3 at;
    for (int axis = 0; axis < 3; ++axis) {
      at[axis] = std::min(2 * p[axis] + ((child >> axis) & 1), dims[axis] - 1);
    }
    sums[child] = values[(at.z * dims.y + at.y) * dims.x + at.x];
  }
  for (int axis = 0; axis < 3; ++axis) {
    for (int child = 0; child < 8; ++child) {
      if (((child >> axis) & 1) == 0) {
        const float a = sums[child], b = sums[child + (1 << axis)];
        sums[child] = a + b;
        sums[child + (1 << axis)] = a - b;
      }
    }
  }
  return sums[band] * 0.125F;
}

/// The coefficient of band `band` at p, from what LiftVolume made.
float LiftedCoefficient(const Basis& basis, const Int3& dims, const std::vector<float>& lifted,
                        const Int3& p, int band) {
  Int3 at;
  float scale = 1;
  for (int axis = 0; axis < 3; ++axis) {
    const bool high = ((band >> axis) & 1) != 0;
    at[axis] = 2 * p[axis] + (high ? 1 : 0);
    if (at[axis] >= dims[axis]) {
      return 0;
    }
    if (basis.wavelet == Wavelet::kCdf97 && dims[axis] > 1) {
      scale *= high ? 1.230174104914001F : 1 / 1.230174104914001F;
    }
  }
  return lifted[(at.z * dims.y + at.y) * dims.x + at.x] * scale;
}

struct Expected {
  std::map<Key, std::vector<float>> bricks;
  std::vector<float> coarse;
};

/// The whole transform, by plain loops.
Expected PlainForward(const Basis& basis, const Hierarchy& hierarchy, int64_t edge,
                      float background, std::vector<float> values) {
  Expected expected;
  const float bias = basis.wavelet == Wavelet::kCdf97 ? background : 0;
  for (float& value : values) {
    value -= bias;
  }
  for (int level = hierarchy.finest() - 1; level >= 0; --level) {
    const Int3 dims = hierarchy.DimsAt(level + 1), half = hierarchy.DimsAt(level);
    const bool float_haar = basis == Basis{Wavelet::kHaar, false};
    if (!float_haar) {
      LiftVolume(basis, level, dims, &values);
    }
    std::vector<float> low;
    for (int64_t i = 0; i < half.Product(); ++i) {
      const Int3 p{i % half.x, i / half.x % half.y, i / half.x / half.y};
      for (int band = 0; band < 8; ++band) {
        const float value = float_haar ? HaarCoefficient(dims, values, p, band)
                                       : LiftedCoefficient(basis, dims, values, p, band);
        if (band == 0) {
          low.push_back(value);
        } else if (value != 0) {
          std::vector<float>& brick = expected.bricks[{level, p.z / edge, p.y / edge, p.x / edge}];
          brick.resize(static_cast<size_t>(7 * edge * edge * edge));
          brick[(((band - 1) * edge + p.z % edge) * edge + p.y % edge) * edge + p.x % edge] = value;
        }
      }
    }
    values = std::move(low);
  }
  for (const float value : values) {
    expected.coarse.push_back(value + bias);
  }
  return expected;
}

struct Case {
  Basis basis;
  CoefficientType type;
};

const char* TypeName(CoefficientType type) {
  const char* const names[] = {"Float", "Int16", "Int32"};
  return names[static_cast<int>(type)];
}

class ForwardStreamTest : public ::testing::TestWithParam<Case> {
 protected:
  /// A stream that gives its bricks to a Collector of its own.
  void Start(const Int3& dims, int64_t edge, int threads, float background = 0) {
    collector_ = std::make_unique<Collector>(GetParam().type);
    auto stream = ForwardStream::Make({Hierarchy::Make(dims).value(), GetParam().basis,
                                       GetParam().type, edge, background, threads},
                                      collector_.get());
    ASSERT_OK(stream.status());
    stream_ = std::move(stream).value();
  }
  void ExpectResult(const Expected& expected) {
    ASSERT_OK_AND_ASSIGN(const Grid coarse, stream_->Finish());
    EXPECT_EQ(coarse.values, expected.coarse);
    EXPECT_TRUE(collector_->bricks == expected.bricks);
  }

  std::unique_ptr<Collector> collector_;
  std::unique_ptr<ForwardStream> stream_;
};

template <typename T>
std::vector<T> Noise(const Int3& dims, uint32_t seed) {
  std::mt19937 random(seed);
  std::vector<T> values(static_cast<size_t>(dims.Product()));
  for (T& value : values) {
    value = static_cast<T>(random() % 256);
  }
  return values;
}

/// Pushes slices by turns 1, 2, .. up to `most` at a time, from memory that is overwritten as soon
/// as the stream lets go of it.
template <typename T>
Status PushInPieces(const Int3& dims, const std::vector<T>& values, int64_t most,
                    ForwardStream* stream) {
  const int64_t slice = dims.x * dims.y;
  int64_t count = 1;
  for (int64_t z = 0; z < dims.z; z += count) {
    count = std::min(count % most + 1, dims.z - z);
    auto* const piece =
        new std::vector<T>(values.begin() + z * slice, values.begin() + (z + count) * slice);
    const std::span<const T> span(*piece);
    const std::shared_ptr<const void> owner(piece, [](std::vector<T>* done) {
      std::fill(done->begin(), done->end(), T{99});
      delete done;
    });
    FOVEA_RETURN_IF_ERROR(stream->Push(span, owner));
  }
  return absl::OkStatus();
}

TEST_P(ForwardStreamTest, SlicesGiveWhatPlainLoopsGive) {
  const Basis& basis = GetParam().basis;
  uint32_t seed = 0;
  for (const Int3& dims : {Int3{96, 40, 64}, Int3{35, 61, 83}, Int3{1, 50, 33}, Int3{47, 1, 90},
                           Int3{66, 19, 1}, Int3{9, 7, 5}, Int3{2, 3, 130}, Int3{97, 64, 65}}) {
    const std::vector<float> values = Noise<float>(dims, ++seed);
    const Hierarchy hierarchy = Hierarchy::Make(dims).value();
    const int64_t edge = seed % 2 == 0 ? 8 : 16;
    const float background = seed % 3 == 0 ? 17 : 0;
    const Expected expected = PlainForward(basis, hierarchy, edge, background, values);
    Start(dims, edge, 1, background);
    ASSERT_OK(stream_->Push(std::span(values)));
    ExpectResult(expected);
    Start(dims, edge, 2, background);
    ASSERT_OK(PushInPieces(dims, values, 7, stream_.get()));
    ExpectResult(expected);
  }
}

TEST_P(ForwardStreamTest, AllTypesOfVoxelsGiveTheSame) {
  const Int3 dims{70, 45, 52};
  const std::vector<float> values = Noise<float>(dims, 3);
  const Expected expected =
      PlainForward(GetParam().basis, Hierarchy::Make(dims).value(), 16, 0, values);
  const auto expect_same = [&]<typename T>(T /*type*/) {
    const std::vector<T> typed(values.begin(), values.end());
    Start(dims, 16, 0);
    ASSERT_OK(PushInPieces(dims, typed, 32, stream_.get()));
    ExpectResult(expected);
  };
  expect_same(uint8_t{});
  expect_same(int16_t{});
  expect_same(uint16_t{});
  std::vector<int8_t> bytes(values.size());
  std::vector<float> small(values.size());
  for (size_t i = 0; i < values.size(); ++i) {
    bytes[i] = static_cast<int8_t>(values[i] - 128);
    small[i] = values[i] - 128;
  }
  Start(dims, 16, 1);
  ASSERT_OK(stream_->Push(std::span<const int8_t>(bytes)));
  ExpectResult(PlainForward(GetParam().basis, Hierarchy::Make(dims).value(), 16, 0, small));
}

TEST_P(ForwardStreamTest, LayersOfBricksGiveWhatTheVolumeGives) {
  const Int3 dims{100, 70, 90};
  BrickGrid sparse(dims, 8, 1, 31);
  sparse.CopyIn({{40, 33, 8}, {57, 41, 30}}, std::vector<float>(17 * 8 * 22, 77));
  sparse.CopyIn({{96, 60, 88}, {100, 70, 90}}, std::vector<float>(4 * 10 * 2, 200));
  std::vector<float> values(static_cast<size_t>(dims.Product()));
  sparse.CopyOut(Box3::OfSize(dims), values);
  const Expected expected =
      PlainForward(GetParam().basis, Hierarchy::Make(dims).value(), 8, 31, values);
  for (const int64_t layers : {1, 5, 12}) {
    Start(dims, 8, layers == 5 ? 2 : 1, 31);
    for (int64_t z = 0; z < 12; z += layers) {
      // Only what lies in these layers, and gone when the stream lets go of it.
      auto piece = std::make_shared<BrickGrid>(dims, 8, 1, 31.0F);
      for (const auto& [key, brick] : sparse.bricks()) {
        if (key[0] >= z && key[0] < z + layers) {
          piece->Put({key[2], key[1], key[0]}, brick);
        }
      }
      ASSERT_OK(stream_->Push(std::move(piece), std::min<int64_t>(layers, 12 - z)));
    }
    ExpectResult(expected);
  }
}

TEST_P(ForwardStreamTest, ItLetsGoOfSlicesAsSoonAsItCan) {
  const Int3 dims{32, 32, 512};
  const std::vector<float> values = Noise<float>(dims, 5);
  Start(dims, 16, 1);
  int64_t alive = 0, most = 0;
  for (int64_t z = 0; z < dims.z; z += 32) {
    ++alive;
    const std::shared_ptr<const void> owner(&alive, [](int64_t* count) { --*count; });
    ASSERT_OK(
        stream_->Push(std::span(values).subspan(static_cast<size_t>(z * 1024), 32 * 1024), owner));
    most = std::max(most, alive - 1);  // but for our own
  }
  EXPECT_LE(most, GetParam().basis.wavelet == Wavelet::kHaar ? 1 : 3);
}

TEST_P(ForwardStreamTest, AnErrorOfTheSinkStopsIt) {
  const std::vector<float> values = Noise<float>({64, 64, 64}, 6);
  Start({64, 64, 64}, 8, 1);
  collector_->stop_after = 3;
  EXPECT_THAT(stream_->Push(std::span(values)),
              testing::FailsWith(absl::StatusCode::kCancelled, "enough"));
  EXPECT_EQ(collector_->stop_after, -1);
  EXPECT_THAT(stream_->Finish(), testing::FailsWith(absl::StatusCode::kCancelled, "enough"));
}

TEST_P(ForwardStreamTest, MisuseIsAnError) {
  const std::vector<float> values = Noise<float>({40, 40, 40}, 7);
  const auto invalid = absl::StatusCode::kInvalidArgument;
  Start({40, 40, 40}, 16, 1);
  EXPECT_THAT(stream_->Push(std::span(values).first(41)), testing::FailsWith(invalid, "slices"));
  Start({40, 40, 40}, 16, 1);
  ASSERT_OK(stream_->Push(std::span(values).first(1600 * 39)));
  EXPECT_THAT(stream_->Finish(),
              testing::FailsWith(absl::StatusCode::kFailedPrecondition, "39 slices of 40"));
  EXPECT_THAT(stream_->Push(std::span(values).first(3200)),
              testing::FailsWith(invalid, "41 slices, of 40"));
  Start({40, 40, 40}, 16, 1);
  ASSERT_OK(stream_->Push(std::span(values).first(1600 * 16)));
  EXPECT_THAT(stream_->Push(std::make_shared<BrickGrid>(Int3{40, 40, 40}, 16, 1, 0.0F), 1),
              testing::FailsWith(invalid, "another"));
  Start({40, 40, 40}, 16, 1);
  EXPECT_THAT(stream_->Push(std::make_shared<BrickGrid>(Int3{40, 40, 40}, 8, 1, 0.0F), 1),
              testing::FailsWith(invalid, "another grid"));
}

TEST_P(ForwardStreamTest, VoxelsThatIntegersCannotHoldAreErrors) {
  if (!GetParam().basis.integer) {
    return;
  }
  const float most =
      GetParam().type == CoefficientType::kInt16 ? kMostShortVoxel : static_cast<float>(kMostVoxel);
  for (const float bad : {0.5F, most + 1, -most - 1, INFINITY, NAN, most}) {
    std::vector<float> values = Noise<float>({40, 40, 40}, 8);
    values[777] = bad;
    Start({40, 40, 40}, 16, 1);
    const Status status = stream_->Push(std::span(values));
    if (bad == most) {
      EXPECT_OK(status);
    } else {
      EXPECT_THAT(status, testing::FailsWith(absl::StatusCode::kInvalidArgument, "whole number"));
    }
  }
}

TEST_P(ForwardStreamTest, VoxelsOf16BitsMustFitThemToo) {
  if (GetParam().type != CoefficientType::kInt16) {
    return;
  }
  std::vector<int16_t> values = Noise<int16_t>({64, 64, 64}, 9);
  for (const int32_t bad : {kMostShortVoxel, kMostShortVoxel + 1, -kMostShortVoxel - 1}) {
    values[130000] = static_cast<int16_t>(bad);
    Start({64, 64, 64}, 16, 1);
    EXPECT_EQ(stream_->Push(std::span<const int16_t>(values)).ok(), bad == kMostShortVoxel) << bad;
  }
}

INSTANTIATE_TEST_SUITE_P(
    Bases, ForwardStreamTest,
    ::testing::Values(Case{{Wavelet::kHaar, false}, CoefficientType::kFloat32},
                      Case{{Wavelet::kCdf53, false}, CoefficientType::kFloat32},
                      Case{{Wavelet::kCdf97, false}, CoefficientType::kFloat32},
                      Case{{Wavelet::kHaar, true}, CoefficientType::kInt16},
                      Case{{Wavelet::kCdf53, true}, CoefficientType::kInt16},
                      Case{{Wavelet::kHaar, true}, CoefficientType::kInt32},
                      Case{{Wavelet::kCdf53, true}, CoefficientType::kInt32}),
    [](const auto& p) {
      return std::string(WaveletName(p.param.basis.wavelet)) + TypeName(p.param.type);
    });

/// Notes what is not finite.
class NotFinite : public DetailSink {
 public:
  Status Take(const DetailBrick& brick) override {
    found |= !std::isfinite(brick.largest);
    return absl::OkStatus();
  }
  Status EndLayer(int /*level*/, int64_t /*z*/) override { return absl::OkStatus(); }
  bool found = false;
};

TEST(ForwardStreamOptionsTest, CoefficientsThatAreNotFiniteShowInTheLargest) {
  for (const Int3& dims : {Int3{32, 32, 32}, Int3{33, 32, 31}}) {
    for (const float bad : {INFINITY, NAN, 1.0F}) {
      for (const Wavelet wavelet : {Wavelet::kHaar, Wavelet::kCdf53, Wavelet::kCdf97}) {
        NotFinite sink;
        const auto stream =
            ForwardStream::Make({.hierarchy = Hierarchy::Make(dims).value(), .basis = {wavelet}},
                                &sink)
                .value();
        std::vector<float> values = Noise<float>(dims, 2);
        values[dims.x * 40 + 5] = bad;
        ASSERT_OK(stream->Push(std::span<const float>(values)));
        EXPECT_EQ(sink.found, bad != 1.0F);
      }
    }
  }
}

TEST(ForwardStreamOptionsTest, WhatDoesNotGoTogetherIsRefused) {
  NotFinite sink;
  const auto make = [&](const ForwardStreamOptions& options) {
    return ForwardStream::Make(options, &sink).status();
  };
  const auto invalid = absl::StatusCode::kInvalidArgument;
  EXPECT_OK(make({}));
  EXPECT_THAT(make({.edge = 7}), testing::FailsWith(invalid, "edge 7"));
  EXPECT_THAT(make({.edge = 2}), testing::FailsWith(invalid, "edge 2"));
  EXPECT_THAT(make({.basis = {Wavelet::kHaar, true}}), testing::FailsWith(invalid, "integer"));
  EXPECT_THAT(make({.type = CoefficientType::kInt16}), testing::FailsWith(invalid, "integer"));
  EXPECT_THAT(make({.basis = {Wavelet::kCdf97, true}, .type = CoefficientType::kInt32}),
              testing::FailsWith(invalid, "cdf97"));
  EXPECT_THAT(
      make({.basis = {Wavelet::kHaar, true}, .type = CoefficientType::kInt16, .background = 1.5F}),
      testing::FailsWith(invalid, "background 1.5"));
}

}  // namespace
}  // namespace fovea::wavelet
