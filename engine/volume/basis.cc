#include "engine/volume/basis.h"

namespace fovea {

std::string_view WaveletName(Wavelet wavelet) {
  switch (wavelet) {
    case Wavelet::kHaar:
      return "haar";
    case Wavelet::kCdf53:
      return "cdf53";
    case Wavelet::kCdf97:
      return "cdf97";
  }
  return "unknown";
}

StatusOr<Wavelet> ParseWavelet(std::string_view name) {
  for (const Wavelet wavelet : {Wavelet::kHaar, Wavelet::kCdf53, Wavelet::kCdf97}) {
    if (name == WaveletName(wavelet)) {
      return wavelet;
    }
  }
  return InvalidArgument("wavelet '{}': it must be haar, cdf53 or cdf97", name.substr(0, 100));
}

}  // namespace fovea
