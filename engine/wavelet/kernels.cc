#include "engine/wavelet/kernels.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/wavelet/kernels.cc"
#include <hwy/foreach_target.h>  // IWYU pragma: keep
// foreach_target.h must come first
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace fovea::wavelet::internal::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

/// Calls body(d, i) for i in [0, count) in vectors as long as there are, then of four, then singly.
template <typename Body>
HWY_INLINE void ForVectors(int64_t count, const Body& body) {
  const hn::ScalableTag<float> d;
  const hn::CappedTag<float, 4> d4;
  const hn::CappedTag<float, 1> d1;
  int64_t i = 0;
  for (const auto n = static_cast<int64_t>(hn::Lanes(d)); i + n <= count; i += n) {
    body(d, i);
  }
  for (const auto n = static_cast<int64_t>(hn::Lanes(d4)); i + n <= count; i += n) {
    body(d4, i);
  }
  for (; i < count; ++i) {
    body(d1, i);
  }
}

void LiftKernel(float c, const float* a, const float* b, int64_t count, float* target) {
  ForVectors(count, [=](auto d, int64_t i) HWY_ATTR {
    const auto sum = hn::Add(hn::LoadU(d, a + i), hn::LoadU(d, b + i));
    hn::StoreU(hn::Add(hn::LoadU(d, target + i), hn::Mul(hn::Set(d, c), sum)), d, target + i);
  });
}

void ScaleKernel(float c, const float* in, int64_t count, float* out) {
  ForVectors(count, [=](auto d, int64_t i) HWY_ATTR {
    hn::StoreU(hn::Mul(hn::Set(d, c), hn::LoadU(d, in + i)), d, out + i);
  });
}

void InterleaveKernel(const float* even, const float* odd, int64_t count, float* out) {
  ForVectors(count, [=](auto d, int64_t i) HWY_ATTR {
    hn::StoreInterleaved2(hn::LoadU(d, even + i), hn::LoadU(d, odd + i), d, out + 2 * i);
  });
}

void InverseHaarKernel(const std::array<const float*, 8>& bands, int64_t count,
                       const std::array<float*, 4>& rows) {
  ForVectors(count, [&](auto d, int64_t i) HWY_ATTR {
    const auto band = [&](int of) HWY_ATTR { return hn::LoadU(d, bands[of] + i); };
    // Along z, then y, then x: sums and differences of low and high.
    for (int z = 0; z < 2; ++z) {
      const auto along_z = [&](int of) HWY_ATTR {
        return z == 0 ? hn::Add(band(of), band(of + 4)) : hn::Sub(band(of), band(of + 4));
      };
      const auto a = along_z(0), x = along_z(1), y = along_z(2), xy = along_z(3);
      const auto a0 = hn::Add(a, y), a1 = hn::Sub(a, y);
      const auto x0 = hn::Add(x, xy), x1 = hn::Sub(x, xy);
      hn::StoreInterleaved2(hn::Add(a0, x0), hn::Sub(a0, x0), d, rows[2 * z] + 2 * i);
      hn::StoreInterleaved2(hn::Add(a1, x1), hn::Sub(a1, x1), d, rows[2 * z + 1] + 2 * i);
    }
  });
}

}  // namespace fovea::wavelet::internal::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace fovea::wavelet::internal {

HWY_EXPORT(LiftKernel);
HWY_EXPORT(ScaleKernel);
HWY_EXPORT(InterleaveKernel);
HWY_EXPORT(InverseHaarKernel);

void Lift(float c, const float* a, const float* b, int64_t count, float* target) {
  HWY_DYNAMIC_DISPATCH(LiftKernel)(c, a, b, count, target);
}

void Scale(float c, const float* in, int64_t count, float* out) {
  HWY_DYNAMIC_DISPATCH(ScaleKernel)(c, in, count, out);
}

void Interleave(const float* even, const float* odd, int64_t count, float* out) {
  HWY_DYNAMIC_DISPATCH(InterleaveKernel)(even, odd, count, out);
}

void InverseHaar(const std::array<const float*, 8>& bands, int64_t count,
                 const std::array<float*, 4>& rows) {
  HWY_DYNAMIC_DISPATCH(InverseHaarKernel)(bands, count, rows);
}

}  // namespace fovea::wavelet::internal
#endif  // HWY_ONCE
