#ifndef ENGINE_WAVELET_LIFTING_H_
#define ENGINE_WAVELET_LIFTING_H_

#include <algorithm>
#include <array>
#include <cstdint>

#include "engine/wavelet/kernels.h"

/// The inverse of wavelets made of lifting steps (Sweldens 1996; Daubechies and Sweldens 1998), for
/// the transforms of this folder only; the forward steps are in forward_kernels.cc. Along an axis
/// the even samples become the low-pass and the odd ones the high-pass coefficients. A step changes
/// all evens or all odds by their two neighbours of the other kind; the inverse takes the steps
/// back in the reverse order. At the ends of a line symmetric extension means that a neighbour that
/// is missing equals the one on the other side.
namespace fovea::wavelet::internal {

/// A scheme's Lift(step, target, a, b, n) changes target[i] by a[i] and b[i], its neighbours before
/// and behind. Steps are numbered in the order of the inverse: step 0, 2 .. change evens, step 1,
/// 3 .. odds. kHalo: children beyond a window of the inverse that it needs on each side.

/// CDF 5/3 in floats.
struct Cdf53 {
  using Value = float;
  static constexpr int kSteps = 2;
  static constexpr int64_t kHalo = 2;
  static constexpr bool kPairs = false;
  static constexpr float kLowScale = 1;

  void Lift(int step, float* target, const float* a, const float* b, int64_t n) const {
    const float c = step == 0 ? -0.25F : 0.5F;
    internal::Lift(c, a, b, n, target);
  }
};

/// CDF 9/7 in floats, scaled so that the low-pass has gain 1 at zero and the high-pass gain 2 at
/// the Nyquist frequency.
struct Cdf97 {
  using Value = float;
  static constexpr int kSteps = 4;
  static constexpr int64_t kHalo = 4;
  static constexpr bool kPairs = false;
  /// Low-pass coefficients are the lifted evens divided by this, high-pass ones the odds times it.
  static constexpr float kLowScale = 1.230174104914001F;

  void Lift(int step, float* target, const float* a, const float* b, int64_t n) const {
    constexpr float kSteps97[] = {-0.443506852043971F, -0.882911075530934F, 0.052980118572961F,
                                  1.586134342059924F};
    internal::Lift(kSteps97[step], a, b, n, target);
  }
};

/// Reversible CDF 5/3. `up` is the mirror image: the transform of -x, negated. Used by turns (by
/// axis and level) it keeps rounding from drifting one way.
struct IntegerCdf53 {
  using Value = int32_t;
  static constexpr int kSteps = 2;
  static constexpr int64_t kHalo = 2;
  static constexpr bool kPairs = false;
  static constexpr float kLowScale = 1;
  bool up = false;

  void Lift(int step, int32_t* __restrict target, const int32_t* a, const int32_t* b,
            int64_t n) const {
    const int32_t round = step == 0 ? (up ? 1 : 2) : (up ? 1 : 0);
    const int shift = step == 0 ? 2 : 1;
    const int32_t sign = step == 0 ? -1 : 1;
    for (int64_t i = 0; i < n; ++i) {
      target[i] += sign * ((a[i] + b[i] + round) >> shift);
    }
  }
};

/// Reversible Haar (the S-transform): d = p - q, low = (p + q)/2 rounded down, or up. Samples meet
/// in pairs only; an odd last sample is its own low-pass.
struct IntegerHaar {
  using Value = int32_t;
  static constexpr int kSteps = 2;
  static constexpr int64_t kHalo = 0;
  static constexpr bool kPairs = true;
  static constexpr float kLowScale = 1;
  bool up = false;

  void Lift(int step, int32_t* __restrict target, const int32_t* a, const int32_t* b,
            int64_t n) const {
    if (step == 1) {  // d = p - q and q = p - d
      for (int64_t i = 0; i < n; ++i) {
        target[i] = a[i] - target[i];
      }
      return;
    }
    const int32_t round = up ? 0 : 1;
    for (int64_t i = 0; i < n; ++i) {
      target[i] += (b[i] + round) >> 1;
    }
  }
};

/// The integer scheme of each axis: rounding goes up where axis + level is odd.
template <typename Scheme>
std::array<Scheme, 3> ByAxis(int level) {
  return {Scheme{level % 2 != 0}, Scheme{level % 2 == 0}, Scheme{level % 2 != 0}};
}

/// How many samples of a line are even and odd: `odds` is `evens` or one less.
struct LineLength {
  int64_t evens = 0, odds = 0;
  [[nodiscard]] static LineLength Of(int64_t samples) { return {(samples + 1) / 2, samples / 2}; }
};

/// As the float ones of kernels.h.
inline void Interleave(const int32_t* even, const int32_t* odd, int64_t count, int32_t* out) {
  for (int64_t i = 0; i < count; ++i) {
    out[2 * i] = even[i];
    out[2 * i + 1] = odd[i];
  }
}

/// Lifts one line whose evens and odds lie apart. Both need a cell to write to before the first
/// and behind the last.
template <typename Scheme>
void LiftRow(const Scheme& scheme, const LineLength& length, typename Scheme::Value* even,
             typename Scheme::Value* odd) {
  const auto [evens, odds] = length;
  if (odds == 0) {
    return;
  }
  for (int step = 0; step < Scheme::kSteps; ++step) {
    if (step % 2 == 0) {
      odd[-1] = odd[0];
      if (odds < evens) {
        odd[odds] = Scheme::kPairs ? 0 : odd[odds - 1];
      }
      scheme.Lift(step, even, odd - 1, odd, evens);
    } else {
      even[evens] = even[evens - 1];
      scheme.Lift(step, odd, even, even + 1, odds);
    }
  }
}

/// Lifts along an axis whose samples are whole lines of `width` values, `stride` apart, evens and
/// odds by turns.
template <typename Scheme>
void LiftLines(const Scheme& scheme, const LineLength& length, int64_t stride, int64_t width,
               typename Scheme::Value* lines) {
  const auto [evens, odds] = length;
  if (odds == 0) {
    return;
  }
  const auto even = [&](int64_t i) { return lines + 2 * i * stride; };
  const auto odd = [&](int64_t i) { return lines + (2 * i + 1) * stride; };
  for (int step = 0; step < Scheme::kSteps; ++step) {
    if (step % 2 == 0) {
      const int64_t last = Scheme::kPairs ? odds : evens;
      for (int64_t k = 0; k < last; ++k) {
        scheme.Lift(step, even(k), odd(std::max<int64_t>(k - 1, 0)), odd(std::min(k, odds - 1)),
                    width);
      }
    } else {
      for (int64_t k = 0; k < odds; ++k) {
        scheme.Lift(step, odd(k), even(k), even(std::min(k + 1, evens - 1)), width);
      }
    }
  }
}

/// The factor on a lifted sample when it becomes a coefficient, along an axis with odd samples;
/// the inverse divides by it. A line of one sample is its own low-pass.
template <typename Scheme>
float ForwardScale(const LineLength& length, bool high) {
  if (length.odds == 0) {
    return 1;
  }
  return high ? Scheme::kLowScale : 1 / Scheme::kLowScale;
}

}  // namespace fovea::wavelet::internal

#endif  // ENGINE_WAVELET_LIFTING_H_
