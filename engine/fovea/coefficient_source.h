#ifndef ENGINE_FOVEA_COEFFICIENT_SOURCE_H_
#define ENGINE_FOVEA_COEFFICIENT_SOURCE_H_

#include <cstdint>
#include <span>

#include "engine/base/status.h"
#include "engine/volume/basis.h"
#include "engine/volume/coefficient_set.h"
#include "engine/volume/geometry.h"
#include "engine/volume/hierarchy.h"

namespace fovea {

/// Where coefficients of one field of one time step come from: a store, memory, a network.
/// Implementations allow concurrent calls.
class CoefficientSource {
 public:
  virtual ~CoefficientSource() = default;
  [[nodiscard]] virtual const Hierarchy& hierarchy() const = 0;
  /// What the coefficients mean: the Haar wavelet in floats unless a source says otherwise.
  [[nodiscard]] virtual Basis basis() const { return {}; }
  /// Copies LLL_0 whole, x fastest: DimsAt(0).Product() values.
  [[nodiscard]] virtual Status ReadCoarse(std::span<float> out) = 0;
  /// Copies the seven detail sub-bands of `level` (0 .. L-1) inside `window` (within DimsAt(level))
  /// as [7][z][y][x], 7 * window.Volume() values. What is not stored reads as zero: a missing
  /// chunk is a value, not an error.
  [[nodiscard]] virtual Status ReadDetail(int level, const Box3& window, std::span<float> out) = 0;
};

/// Coefficients that are already in memory. Keeps a reference to `set`.
class MemorySource final : public CoefficientSource {
 public:
  explicit MemorySource(const CoefficientSet& set) : set_(set) {}
  [[nodiscard]] const Hierarchy& hierarchy() const override { return set_.hierarchy; }
  [[nodiscard]] Basis basis() const override { return set_.basis; }
  [[nodiscard]] Status ReadCoarse(std::span<float> out) override;
  [[nodiscard]] Status ReadDetail(int level, const Box3& window, std::span<float> out) override;

 private:
  const CoefficientSet& set_;
};

}  // namespace fovea

#endif  // ENGINE_FOVEA_COEFFICIENT_SOURCE_H_
