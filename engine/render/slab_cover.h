#ifndef ENGINE_RENDER_SLAB_COVER_H_
#define ENGINE_RENDER_SLAB_COVER_H_

#include <array>

namespace fovea::render {

/// What a slab of a fixed length covers, 1 - (1 - opacity)^length, as opacity times a polynomial in
/// the opacity: a third of the work of a logarithm and an exponential. For opacities from 0 to
/// `most`; exact to kTolerance, or empty where that would take too many coefficients.
struct SlabCover {
  static constexpr int kMostCoefficients = 11;
  static constexpr double kTolerance = 5e-8;  // relative

  SlabCover() = default;
  SlabCover(double length, double most);

  std::array<float, kMostCoefficients> coefficients{};  // highest power first
  int count = 0;                                        // 0: none will do
};

}  // namespace fovea::render

#endif  // ENGINE_RENDER_SLAB_COVER_H_
