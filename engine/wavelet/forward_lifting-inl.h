#if defined(ENGINE_WAVELET_FORWARD_LIFTING_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ENGINE_WAVELET_FORWARD_LIFTING_INL_H_
#undef ENGINE_WAVELET_FORWARD_LIFTING_INL_H_
#else
#define ENGINE_WAVELET_FORWARD_LIFTING_INL_H_
#endif

#include <algorithm>
#include <cstdint>
#include <type_traits>

#include <hwy/highway.h>

#include "engine/wavelet/forward_kernels.h"

// For forward_kernels.cc only: vectors and the lifting steps, once for every instruction set.

HWY_BEFORE_NAMESPACE();
namespace fovea::wavelet::internal::HWY_NAMESPACE {
namespace {
namespace hn = hwy::HWY_NAMESPACE;

template <typename Value>
using Lanes = hn::CappedTag<Value, kLanes>;

/// Calls body(d, i) so that vectors of d from i on cover [0, count); they may overlap.
template <typename Value, typename Body>
HWY_INLINE void ForCovering(int64_t count, const Body& body) {
  const auto cover = [&](auto d) HWY_ATTR {
    const auto n = static_cast<int64_t>(hn::Lanes(d));
    if (count < n) {
      return false;
    }
    for (int64_t i = 0; i + n <= count; i += n) {
      body(d, i);
    }
    if (count % n != 0) {
      body(d, count - n);
    }
    return true;
  };
  if (cover(Lanes<Value>()) || cover(hn::CappedTag<Value, 4>())) {
    return;
  }
  const hn::CappedTag<Value, 1> d1;
  for (int64_t i = 0; i < count; ++i) {
    body(d1, i);
  }
}

/// Pairs of samples apart; count of each as d has lanes.
template <class D, class V>
HWY_INLINE void LoadPairs(D d, const hn::TFromD<D>* from, V& even, V& odd) {
#if HWY_TARGET == HWY_SCALAR
  hn::LoadInterleaved2(d, from, even, odd);
#else
  if constexpr (hn::MaxLanes(D()) == 1) {
    hn::LoadInterleaved2(d, from, even, odd);
  } else {  // faster than LoadInterleaved2
    const V a = hn::LoadU(d, from), b = hn::LoadU(d, from + hn::Lanes(d));
    even = hn::ConcatEven(d, b, a);
    odd = hn::ConcatOdd(d, b, a);
  }
#endif
}

/// What magnitudes are compared as: floats by their bits, so that NaN is above infinity.
template <class D, class V>
HWY_INLINE auto Magnitude([[maybe_unused]] D d, V value) {
  if constexpr (std::is_same_v<hn::TFromD<D>, float>) {
    const hn::RebindToSigned<D> di;
    return hn::And(hn::BitCast(di, value), hn::Set(di, 0x7fffffff));
  } else {
    return hn::Abs(value);
  }
}

/// The largest of the magnitudes added, of coefficients of type Value.
template <typename Value>
class Largest {
 public:
  template <class D, class V>
  HWY_INLINE void Add(D /*d*/, V magnitude) {
    const hn::RebindToSigned<D> di;
    hn::Store(hn::Max(hn::Load(di, most_), magnitude), di, most_);
  }
  [[nodiscard]] float Get() const {
    const Bits most = *std::max_element(most_, most_ + kLanes);
    if constexpr (std::is_same_v<Value, float>) {
      float value;
      hwy::CopySameSize(&most, &value);
      return value;
    } else {
      return static_cast<float>(most);
    }
  }

 private:
  using Bits = hwy::MakeSigned<Value>;
  alignas(64) Bits most_[kLanes] = {};
};

/// The lifting schemes (docs/theory.md): the forward steps, as sums of a target and its neighbours.
/// Stages of two steps each: odds first.
struct Cdf53Scheme {
  static constexpr Wavelet kWavelet = Wavelet::kCdf53;
  static constexpr int kStages = 1;
  template <class D, class V>
  static HWY_INLINE V Odd(D d, int /*stage*/, bool /*up*/, V odd, V before, V behind) {
    return hn::Add(odd, hn::Mul(hn::Set(d, -0.5F), hn::Add(before, behind)));
  }
  template <class D, class V>
  static HWY_INLINE V Even(D d, int /*stage*/, bool /*up*/, V even, V before, V behind) {
    return hn::Add(even, hn::Mul(hn::Set(d, 0.25F), hn::Add(before, behind)));
  }
  static float Scale(bool /*high*/) { return 1; }
};

struct Cdf97Scheme {
  static constexpr Wavelet kWavelet = Wavelet::kCdf97;
  static constexpr int kStages = 2;
  template <class D, class V>
  static HWY_INLINE V Odd(D d, int stage, bool /*up*/, V odd, V before, V behind) {
    const float c = stage == 0 ? -1.586134342059924F : 0.882911075530934F;
    return hn::Add(odd, hn::Mul(hn::Set(d, c), hn::Add(before, behind)));
  }
  template <class D, class V>
  static HWY_INLINE V Even(D d, int stage, bool /*up*/, V even, V before, V behind) {
    const float c = stage == 0 ? -0.052980118572961F : 0.443506852043971F;
    return hn::Add(even, hn::Mul(hn::Set(d, c), hn::Add(before, behind)));
  }
  /// Low-pass gain 1 at zero, high-pass gain 2 at the Nyquist frequency.
  static float Scale(bool high) {
    constexpr float kLowScale = 1.230174104914001F;
    return high ? kLowScale : 1 / kLowScale;
  }
};

/// Reversible: halves and quarters are rounded, up or down.
struct IntegerCdf53Scheme {
  static constexpr Wavelet kWavelet = Wavelet::kCdf53;
  static constexpr int kStages = 1;
  template <class D, class V>
  static HWY_INLINE V Odd(D d, int /*stage*/, bool up, V odd, V before, V behind) {
    const V sum = hn::Add(before, behind);
    return hn::Sub(odd, hn::ShiftRight<1>(hn::Add(sum, hn::Set(d, up ? 1 : 0))));
  }
  template <class D, class V>
  static HWY_INLINE V Even(D d, int /*stage*/, bool up, V even, V before, V behind) {
    const V sum = hn::Add(before, behind);
    return hn::Add(even, hn::ShiftRight<2>(hn::Add(sum, hn::Set(d, up ? 1 : 2))));
  }
};

/// Stage `kStage` on a stream of pairs: takes pair k and gives pair k - 1 lifted.
template <class Scheme, int kStage, class D>
class Stage {
 public:
  using V = hn::Vec<D>;
  HWY_INLINE Stage(D d, V even, V odd) : even_(even), odd_(odd), before_(hn::Zero(d)) {}
  HWY_INLINE void Feed(D d, bool up, V& even, V& odd) {
    const V lifted = Scheme::Odd(d, kStage, up, odd_, even_, even);
    const V low = Scheme::Even(d, kStage, up, even_, before_, lifted);
    even_ = even;
    odd_ = odd;
    before_ = lifted;
    even = low;
    odd = lifted;
  }

 private:
  V even_, odd_, before_;
};

/// Lifts a column of vectors: `load(k, even, odd)` gives pair k of `pairs`, `store(k, low, high)`
/// takes what becomes of pair `margin` + k.
template <class Scheme, class D, class Load, class Store>
HWY_INLINE void LiftColumn(D d, bool up, int64_t pairs, const Load& load, const Store& store) {
  using V = hn::Vec<D>;
  V even, odd;
  load(0, even, odd);
  Stage<Scheme, 0, D> first(d, even, odd);
  if constexpr (Scheme::kStages == 1) {
    load(1, even, odd);
    first.Feed(d, up, even, odd);
    for (int64_t k = 0; k + 2 < pairs; ++k) {
      load(k + 2, even, odd);
      first.Feed(d, up, even, odd);
      store(k, even, odd);
    }
  } else {
    load(1, even, odd);
    first.Feed(d, up, even, odd);
    Stage<Scheme, 1, D> second(d, even, odd);
    for (int64_t k = 2; k < 4; ++k) {
      load(k, even, odd);
      first.Feed(d, up, even, odd);
      second.Feed(d, up, even, odd);
    }
    for (int64_t k = 0; k + 4 < pairs; ++k) {
      load(k + 4, even, odd);
      first.Feed(d, up, even, odd);
      second.Feed(d, up, even, odd);
      store(k, even, odd);
    }
  }
}

}  // namespace
}  // namespace fovea::wavelet::internal::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // per target
