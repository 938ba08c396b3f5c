#ifndef ENGINE_WAVELET_KERNELS_H_
#define ENGINE_WAVELET_KERNELS_H_

#include <array>
#include <cstdint>

/// The inner loops of the inverse float transforms, compiled for every instruction set and chosen
/// at run time. All of them give the same bits: no step is fused or reordered. Nothing needs
/// alignment; what is written must not overlap what is read.
namespace fovea::wavelet::internal {

/// target[i] += c * (a[i] + b[i]); a and b may overlap each other.
void Lift(float c, const float* a, const float* b, int64_t count, float* target);
/// out[i] = c * in[i].
void Scale(float c, const float* in, int64_t count, float* out);
/// out[2i] = even[i], out[2i + 1] = odd[i].
void Interleave(const float* even, const float* odd, int64_t count, float* out);
/// InverseHaarRow of haar.h.
void InverseHaar(const std::array<const float*, 8>& bands, int64_t count,
                 const std::array<float*, 4>& rows);

}  // namespace fovea::wavelet::internal

#endif  // ENGINE_WAVELET_KERNELS_H_
