#ifndef SERVICE_COEFFICIENTS_HELD_STEP_H_
#define SERVICE_COEFFICIENTS_HELD_STEP_H_

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "engine/base/status.h"
#include "engine/fovea/retained_set.h"
#include "engine/volume/coefficient_set.h"
#include "service/coefficients/block.h"

namespace fovea::coefficients {

/// What a client holds of one step: coefficients of one or two fields, and of which foveas and
/// rates it has every one. Takes blocks from servers, which may be hostile. Not thread-safe; any
/// number may read while none adds.
class HeldStep {
 public:
  struct Field {
    std::string name;
    Basis basis;
    uint64_t content = 0;  // as the server said
    friend bool operator==(const Field&, const Field&) = default;
  };
  /// Foveas that are remembered; the oldest is forgotten with what only it needs.
  static constexpr size_t kMaxRegions = kMaxHeld / 2;

  /// `fields`: 1 or 2.
  HeldStep(const Hierarchy& hierarchy, int64_t step, std::vector<Field> fields);

  [[nodiscard]] int64_t step() const { return step_; }
  [[nodiscard]] const std::vector<Field>& fields() const { return fields_; }
  [[nodiscard]] const CoefficientSet& coefficients(size_t field) const { return sets_[field]; }

  /// Puts a block's coefficients in their places; returns how many. `base` is what differences are
  /// from, or null. DATA_LOSS for bytes that are no block of this step, FAILED_PRECONDITION for
  /// differences that are not from `base`.
  [[nodiscard]] StatusOr<int64_t> Add(std::string_view block, const HeldStep* base);

  /// Every coefficient of C(fovea, rate) is here.
  void Complete(const Fovea& fovea);
  /// Of what that was said, the newest last: what requests say is held.
  [[nodiscard]] const std::vector<Fovea>& regions() const { return regions_; }
  /// Whether one of them has all of C(fovea, rate).
  [[nodiscard]] bool Holds(const Fovea& fovea) const;

 private:
  /// Numbers of the boxes of `header`, as stored.
  [[nodiscard]] StatusOr<std::vector<std::byte>> NumbersOf(const BlockHeader& header) const;
  void Forget();

  Hierarchy hierarchy_;
  int64_t step_;
  std::vector<Field> fields_;
  std::vector<CoefficientSet> sets_;
  std::vector<Fovea> regions_;
};

}  // namespace fovea::coefficients

#endif  // SERVICE_COEFFICIENTS_HELD_STEP_H_
