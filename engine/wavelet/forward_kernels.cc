#include "engine/wavelet/forward_kernels.h"

#include <algorithm>
#include <cmath>
#include <type_traits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/wavelet/forward_kernels.cc"
#include <hwy/foreach_target.h>  // IWYU pragma: keep
// foreach_target.h must come first
#include <hwy/highway.h>

#include "engine/wavelet/forward_lifting-inl.h"

// A strip is lifted along z, a row of children (even samples first, then the odd ones) at a time,
// then slice by slice along y and x. Rows are padded to whole vectors, of at most kLanes values.

#ifndef ENGINE_WAVELET_FORWARD_KERNELS_ONCE
#define ENGINE_WAVELET_FORWARD_KERNELS_ONCE
namespace fovea::wavelet::internal {
namespace {

constexpr int64_t Padded(int64_t count) {
  return (count + kLanes - 1) / kLanes * kLanes;
}

/// The sizes of a strip of a wavelet made of lifting steps.
struct StripSizes {
  int64_t pairs;     // of an even and an odd child along y and z, margins included
  int64_t children;  // twice as many
  int64_t row;       // pairs along x
  int64_t width;     // of a row in memory: evens, odds, padding
  int64_t half;      // of a row of lifted evens or odds in memory
};

constexpr StripSizes SizesOf(Wavelet wavelet, int64_t edge, int64_t bricks) {
  const int64_t pairs = edge + 2 * MarginOf(wavelet);
  const int64_t row = edge * bricks + 2 * MarginOf(wavelet);
  return {pairs, 2 * pairs, row, Padded(2 * row), Padded(row)};
}

}  // namespace
}  // namespace fovea::wavelet::internal
#endif  // ENGINE_WAVELET_FORWARD_KERNELS_ONCE

HWY_BEFORE_NAMESPACE();
namespace fovea::wavelet::internal::HWY_NAMESPACE {
namespace {
/// `children` rows of `width` values, from row to row `stride` apart, lifted to `edge` low rows and
/// as many high ones.
template <class Scheme, typename Value>
HWY_INLINE void LiftRows(const StripSizes& sizes, int64_t edge, bool lift, bool up,
                         const Value* rows, int64_t stride, Value* low, Value* high,
                         int64_t out_stride) {
  const Lanes<Value> d;
  const int64_t margin = MarginOf(Scheme::kWavelet);
  for (int64_t x = 0; x < sizes.width; x += static_cast<int64_t>(hn::Lanes(d))) {
    const auto load = [&](int64_t k, auto& even, auto& odd) HWY_ATTR {
      even = hn::Load(d, rows + 2 * k * stride + x);
      odd = hn::Load(d, rows + (2 * k + 1) * stride + x);
    };
    const auto store = [&](int64_t k, auto even, auto odd) HWY_ATTR {
      hn::Store(even, d, low + k * out_stride + x);
      hn::Store(odd, d, high + k * out_stride + x);
    };
    if (lift) {
      LiftColumn<Scheme>(d, up, sizes.pairs, load, store);
    } else {
      for (int64_t k = 0; k < edge; ++k) {
        hn::Vec<decltype(d)> even, odd;
        load(margin + k, even, odd);
        store(k, even, odd);
      }
    }
  }
}

template <class Scheme, typename Value>
class LiftedStrip {
 public:
  LiftedStrip(const StripInput<Value>& in, Value* work, Value* low, Value* detail)
      : in_(in),
        edge_(in.edge),
        cube_(in.edge * in.edge * in.edge),
        sizes_(SizesOf(Scheme::kWavelet, in.edge, in.bricks)),
        low_(low),
        detail_(detail),
        slices_(work),
        rows_(slices_ + 2 * edge_ * sizes_.children * sizes_.width),
        odds_(rows_ + sizes_.children * sizes_.width),
        evens_(odds_ + 2 * edge_ * sizes_.half) {}

  void Transform(float* largest) {
    const int64_t slice = sizes_.children * sizes_.width;
    for (int64_t y = 0; y < sizes_.children; ++y) {
      LoadRows(y);
      Value* const to = slices_ + y * sizes_.width;
      LiftRows<Scheme>(sizes_, edge_, in_.lift[2], in_.up[2], rows_, sizes_.width, to,
                       to + edge_ * slice, slice);
    }
    for (int64_t z = 0; z < 2 * edge_; ++z) {
      LiftRows<Scheme>(sizes_, edge_, in_.lift[1], in_.up[1], slices_ + z * slice, sizes_.width,
                       rows_, rows_ + edge_ * sizes_.width, sizes_.width);
      LiftAlongX(z % edge_, z >= edge_);
    }
    for (int64_t brick = 0; brick < in_.bricks; ++brick) {
      largest[brick] = largest_[brick].Get();
    }
  }

 private:
  /// Row y of all slices, evens and odds apart.
  HWY_INLINE void LoadRows(int64_t y) {
    for (int64_t z = 0; z < sizes_.children; ++z) {
      const Value* const from = in_.slices[z] + in_.rows[y];
      Value* const row = rows_ + z * sizes_.width;
      Value* const to = row + in_.first / 2;
      ForCovering<Value>((in_.last - in_.first) / 2, [&](auto d, int64_t i) HWY_ATTR {
        hn::Vec<decltype(d)> even, odd;
        LoadPairs(d, from + 2 * i, even, odd);
        hn::StoreU(even, d, to + i);
        hn::StoreU(odd, d, to + sizes_.row + i);
      });
      if (in_.next != 0) {
        for (int64_t i = 0; i < in_.last - in_.first; i += 64 / int64_t{sizeof(Value)}) {
          __builtin_prefetch(from + in_.next + i, 0, 2);
        }
      }
      for (const CopiedChild& child : in_.copied) {
        row[CellOf(child.to)] = row[CellOf(child.from)];
      }
    }
  }

  [[nodiscard]] int64_t CellOf(int64_t child) const {
    return child / 2 + (child % 2 == 0 ? 0 : sizes_.row);
  }

  /// The rows of a slice: low ones in y, then high ones.
  HWY_INLINE void LiftAlongX(int64_t z, bool z_is_high) {
    constexpr int64_t kMargin = MarginOf(Scheme::kWavelet);
    if (in_.lift[0] && Scheme::kStages == 2) {
      FirstStage(in_.up[0]);
    }
    for (int64_t row = 0; row < 2 * edge_; ++row) {
      const Value* even = rows_ + row * sizes_.width + kMargin;
      const Value* odd = even + sizes_.row;
      if (in_.lift[0] && Scheme::kStages == 2) {
        even = evens_ + row * sizes_.half + kMargin;
        odd = odds_ + row * sizes_.half + kMargin;
      }
      const int band = (row >= edge_ ? 2 : 0) + (z_is_high ? 4 : 0);
      const int64_t at = (z * edge_ + row % edge_) * edge_;
      for (int64_t brick = 0; brick < in_.bricks; ++brick) {
        FinishRow(brick, band, at, even + brick * edge_, odd + brick * edge_);
      }
    }
  }

  /// The last stage along x, of the row at cell `at` of two bands of a brick.
  HWY_INLINE void FinishRow(int64_t brick, int band, int64_t at, const Value* even,
                            const Value* odd) {
    constexpr int kLast = Scheme::kStages - 1;
    const bool up = in_.up[0];
    Value* const to_low = Band(brick, band) + at;
    Value* const to_high = Band(brick, band + 1) + at;
    const float low_scale = ScaleOf(band), high_scale = ScaleOf(band + 1);
    ForCovering<Value>(edge_, [&](auto d, int64_t i) HWY_ATTR {
      auto low = hn::LoadU(d, even + i);
      auto high = hn::LoadU(d, odd + i);
      if (in_.lift[0]) {
        const auto even_before = hn::LoadU(d, even + i - 1), odd_before = hn::LoadU(d, odd + i - 1);
        const auto before = Scheme::Odd(d, kLast, up, odd_before, even_before, low);
        high = Scheme::Odd(d, kLast, up, high, low, hn::LoadU(d, even + i + 1));
        low = Scheme::Even(d, kLast, up, low, before, high);
      }
      if constexpr (Scheme::kWavelet == Wavelet::kCdf97) {
        low = hn::Mul(low, hn::Set(d, low_scale));
        high = hn::Mul(high, hn::Set(d, high_scale));
      }
      hn::StoreU(low, d, to_low + i);
      hn::StoreU(high, d, to_high + i);
      auto most = Magnitude(d, high);
      if (band != 0) {
        most = hn::Max(most, Magnitude(d, low));
      }
      largest_[brick].Add(d, most);
    });
  }

  /// The first of two stages, for all pairs that the second one needs.
  HWY_INLINE void FirstStage(bool up) {
    for (int64_t row = 0; row < 2 * edge_; ++row) {
      const Value* const even = rows_ + row * sizes_.width;
      const Value* const odd = even + sizes_.row;
      Value* const to_even = evens_ + row * sizes_.half;
      Value* const to_odd = odds_ + row * sizes_.half;
      // All pairs but the first and the last.
      ForCovering<Value>(sizes_.row - 2, [&](auto d, int64_t i) HWY_ATTR {
        const auto e0 = hn::LoadU(d, even + i), e1 = hn::LoadU(d, even + i + 1);
        const auto before = Scheme::Odd(d, 0, up, hn::LoadU(d, odd + i), e0, e1);
        const auto lifted =
            Scheme::Odd(d, 0, up, hn::LoadU(d, odd + i + 1), e1, hn::LoadU(d, even + i + 2));
        hn::StoreU(lifted, d, to_odd + i + 1);
        hn::StoreU(Scheme::Even(d, 0, up, e1, before, lifted), d, to_even + i + 1);
      });
    }
  }

  [[nodiscard]] Value* Band(int64_t brick, int band) const {
    return band == 0 ? low_ + brick * cube_ : detail_ + (7 * brick + band - 1) * cube_;
  }

  [[nodiscard]] float ScaleOf(int band) const {
    float product = 1;
    if constexpr (Scheme::kWavelet == Wavelet::kCdf97) {
      for (int axis = 0; axis < 3; ++axis) {
        product *= in_.lift[axis] ? Scheme::Scale(((band >> axis) & 1) != 0) : 1.0F;
      }
    }
    return product;
  }

  const StripInput<Value>& in_;
  const int64_t edge_, cube_;
  const StripSizes sizes_;
  Value* const low_;
  Value* const detail_;
  Value* const slices_;               // [2 edge: low in z, then high][children][width]
  Value* const rows_;                 // [children][width]
  Value *const odds_, *const evens_;  // [2 edge][half]: after the first stage along x
  Largest<Value> largest_[MostBricks<Value>(Scheme::kWavelet)];
};

/// Haar in floats: sums and differences over 8.
struct HaarScheme {
  template <class D, class V>
  static HWY_INLINE void Transform(D d, const std::array<bool, 3>& /*up*/, V (&p)[4], V (&q)[4],
                                   V (&bands)[8]) {
    const auto eighth = hn::Set(d, 0.125F);
    V low[4], high[4];
    for (int row = 0; row < 4; ++row) {
      low[row] = hn::Add(p[row], q[row]);
      high[row] = hn::Sub(p[row], q[row]);
    }
    for (int x = 0; x < 2; ++x) {
      const V* const v = x == 0 ? low : high;
      const V a0 = hn::Add(v[0], v[1]), y0 = hn::Sub(v[0], v[1]);
      const V a1 = hn::Add(v[2], v[3]), y1 = hn::Sub(v[2], v[3]);
      bands[x] = hn::Mul(hn::Add(a0, a1), eighth);
      bands[x + 2] = hn::Mul(hn::Add(y0, y1), eighth);
      bands[x + 4] = hn::Mul(hn::Sub(a0, a1), eighth);
      bands[x + 6] = hn::Mul(hn::Sub(y0, y1), eighth);
    }
  }
};

/// Reversible Haar: d = p - q, low = p - d/2, rounded; z first, then y, then x.
struct IntegerHaarScheme {
  template <class D, class V>
  static HWY_INLINE void Transform(D d, const std::array<bool, 3>& up, V (&p)[4], V (&q)[4],
                                   V (&bands)[8]) {
    const auto pair = [&](int axis, V a, V b, V& low, V& high) HWY_ATTR {
      high = hn::Sub(a, b);
      low = hn::Sub(a, hn::ShiftRight<1>(hn::Add(high, hn::Set(d, up[axis] ? 0 : 1))));
    };
    V column[2][4];  // [x][bit 0 high in y, bit 1 in z]
    for (int x = 0; x < 2; ++x) {
      V(&row)[4] = x == 0 ? p : q;
      V low[2], high[2];
      pair(2, row[0], row[2], low[0], high[0]);
      pair(2, row[1], row[3], low[1], high[1]);
      pair(1, low[0], low[1], column[x][0], column[x][1]);
      pair(1, high[0], high[1], column[x][2], column[x][3]);
    }
    for (int yz = 0; yz < 4; ++yz) {
      pair(0, column[0][yz], column[1][yz], bands[2 * yz], bands[2 * yz + 1]);
    }
  }
};

/// Asks for the rows of children that are needed `kAhead` rows of coefficients from now.
template <typename Value>
HWY_INLINE void FetchAhead(const StripInput<Value>& in, int64_t row, int64_t height,
                           int64_t depth) {
  constexpr int64_t kAhead = 4;
  const int64_t then = std::min(row + kAhead, depth * height - 1);
  const int64_t z = then / height, y = then % height;
  for (int child = 0; child < 4; ++child) {
    const Value* const from = in.slices[2 * z + child / 2] + in.rows[2 * y + child % 2];
    for (int64_t i = 0; i < in.last - in.first; i += 64 / int64_t{sizeof(Value)}) {
      __builtin_prefetch(from + i);
    }
  }
}

template <class Scheme, typename Value>
void TransformHaarStrip(const StripInput<Value>& in, Value* low, Value* detail, float* largest) {
  const int64_t edge = in.edge;
  const int64_t cube = edge * edge * edge;
  Largest<Value> most_of[MostBricks<Value>(Wavelet::kHaar)];
  const int64_t height = std::min(edge, in.wanted_y), depth = std::min(edge, in.wanted_z);
  for (int64_t wanted = 0; wanted < depth * height; ++wanted) {
    const int64_t z = wanted / height, y = wanted % height;
    const int64_t row = z * edge + y;
    const Value* rows[4];
    for (int child = 0; child < 4; ++child) {
      rows[child] = in.slices[2 * z + child / 2] + in.rows[2 * y + child % 2];
    }
    FetchAhead(in, wanted, height, depth);
    for (int64_t brick = 0; brick < in.bricks; ++brick) {
      Value* const to_low = low + brick * cube + row * edge;
      Value* const to_detail = detail + 7 * brick * cube + row * edge;
      ForCovering<Value>(edge, [&](auto d, int64_t i) HWY_ATTR {
        hn::Vec<decltype(d)> p[4], q[4], bands[8];
        for (int child = 0; child < 4; ++child) {
          LoadPairs(d, rows[child] + 2 * (brick * edge + i), p[child], q[child]);
        }
        Scheme::Transform(d, in.up, p, q, bands);
        hn::StoreU(bands[0], d, to_low + i);
        hn::StoreU(bands[1], d, to_detail + i);
        auto most = Magnitude(d, bands[1]);
        for (int band = 2; band < 8; ++band) {
          hn::StoreU(bands[band], d, to_detail + (band - 1) * cube + i);
          most = hn::Max(most, Magnitude(d, bands[band]));
        }
        most_of[brick].Add(d, most);
      });
    }
  }
  for (int64_t brick = 0; brick < in.bricks; ++brick) {
    largest[brick] = most_of[brick].Get();
  }
}

void FloatKernel(Wavelet wavelet, const StripInput<float>& in, float* work, float* low,
                 float* detail, float* largest) {
  switch (wavelet) {
    case Wavelet::kHaar:
      return TransformHaarStrip<HaarScheme>(in, low, detail, largest);
    case Wavelet::kCdf53:
      return LiftedStrip<Cdf53Scheme, float>(in, work, low, detail).Transform(largest);
    case Wavelet::kCdf97:
      return LiftedStrip<Cdf97Scheme, float>(in, work, low, detail).Transform(largest);
  }
}

template <typename Value>
void IntegerStrip(Wavelet wavelet, const StripInput<Value>& in, Value* work, Value* low,
                  Value* detail, float* largest) {
  if (wavelet == Wavelet::kHaar) {
    TransformHaarStrip<IntegerHaarScheme>(in, low, detail, largest);
  } else {
    LiftedStrip<IntegerCdf53Scheme, Value>(in, work, low, detail).Transform(largest);
  }
}

void ShortKernel(Wavelet wavelet, const StripInput<int16_t>& in, int16_t* work, int16_t* low,
                 int16_t* detail, float* largest) {
  IntegerStrip(wavelet, in, work, low, detail, largest);
}

void LongKernel(Wavelet wavelet, const StripInput<int32_t>& in, int32_t* work, int32_t* low,
                int32_t* detail, float* largest) {
  IntegerStrip(wavelet, in, work, low, detail, largest);
}

}  // namespace
}  // namespace fovea::wavelet::internal::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace fovea::wavelet::internal {

HWY_EXPORT(FloatKernel);
HWY_EXPORT(ShortKernel);
HWY_EXPORT(LongKernel);

template <typename Value>
size_t WorkCells(Wavelet wavelet, int64_t edge) {
  const StripSizes sizes = SizesOf(wavelet, edge, MostBricks<Value>(wavelet));
  return wavelet == Wavelet::kHaar
             ? 0
             : static_cast<size_t>((2 * edge + 1) * sizes.children * sizes.width +
                                   4 * edge * sizes.half + kLanes);
}

template <>
void TransformStrip(Wavelet wavelet, const StripInput<float>& in, float* work, float* low,
                    float* detail, float* largest) {
  HWY_DYNAMIC_DISPATCH(FloatKernel)(wavelet, in, work, low, detail, largest);
}

template <>
void TransformStrip(Wavelet wavelet, const StripInput<int16_t>& in, int16_t* work, int16_t* low,
                    int16_t* detail, float* largest) {
  HWY_DYNAMIC_DISPATCH(ShortKernel)(wavelet, in, work, low, detail, largest);
}

template <>
void TransformStrip(Wavelet wavelet, const StripInput<int32_t>& in, int32_t* work, int32_t* low,
                    int32_t* detail, float* largest) {
  HWY_DYNAMIC_DISPATCH(LongKernel)(wavelet, in, work, low, detail, largest);
}

template size_t WorkCells<float>(Wavelet, int64_t);
template size_t WorkCells<int16_t>(Wavelet, int64_t);
template size_t WorkCells<int32_t>(Wavelet, int64_t);

}  // namespace fovea::wavelet::internal
#endif  // HWY_ONCE
