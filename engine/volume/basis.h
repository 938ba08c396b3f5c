#ifndef ENGINE_VOLUME_BASIS_H_
#define ENGINE_VOLUME_BASIS_H_

#include <cstdint>
#include <string>
#include <string_view>

#include "engine/base/status.h"

namespace fovea {

/// The wavelet transforms: Haar; CDF 5/3 (LeGall); CDF 9/7 (the paper's "Daubechies 7/9"). All
/// have low-pass gain 1 at zero frequency: a super-voxel is a value in data units.
enum class Wavelet { kHaar, kCdf53, kCdf97 };

/// What coefficients mean: which wavelet, and whether it is the reversible integer form. That one
/// takes whole numbers to whole numbers without loss; there is none of CDF 9/7.
struct Basis {
  Wavelet wavelet = Wavelet::kHaar;
  bool integer = false;
  friend bool operator==(const Basis&, const Basis&) = default;
};

/// The largest integer coefficient: exact in a float, and no step of the inverse overflows.
inline constexpr int32_t kMostInteger = 1 << 22;

/// "haar", "cdf53" or "cdf97": as in stores and on the command line.
[[nodiscard]] std::string_view WaveletName(Wavelet wavelet);
/// The reverse; INVALID_ARGUMENT, listing the names, for any other text.
[[nodiscard]] StatusOr<Wavelet> ParseWavelet(std::string_view name);

}  // namespace fovea

#endif  // ENGINE_VOLUME_BASIS_H_
