#ifndef TESTS_SUPPORT_FAKE_DATASET_H_
#define TESTS_SUPPORT_FAKE_DATASET_H_

#include <memory>
#include <string>
#include <vector>

#include "engine/store/dataset.h"
#include "engine/volume/coefficient_set.h"

namespace fovea::testing {

/// A dataset in memory: fields "density" and "warm" of 40 x 32 x 48 voxels, a ball that moves up
/// by 4 voxels a step in empty space; "warm" is 100 x as large and its ball stands elsewhere. The
/// world is twice as large and shifted by (10, 20, 30). Steps are 0.5 s apart from 2 s on, frame
/// numbers are 100, 102, 104 ...
class FakeDataset final : public store::Dataset {
 public:
  explicit FakeDataset(int64_t steps);

  [[nodiscard]] const std::string& path() const override { return path_; }
  [[nodiscard]] store::DatasetInfo info() const override { return info_; }
  [[nodiscard]] Status Refresh() override { return absl::OkStatus(); }
  [[nodiscard]] StatusOr<int64_t> TimeNs(int64_t step) override;
  [[nodiscard]] StatusOr<std::optional<int64_t>> FrameNumber(int64_t step) override;
  [[nodiscard]] StatusOr<FieldStats> Stats(int64_t step, const std::string& field) override;
  [[nodiscard]] StatusOr<std::unique_ptr<store::StepSource>> OpenStep(
      int64_t step, const std::string& field, store::OnDamage on_damage) override;

  /// Steps opened from now on count this many damaged chunks (or fail, if asked to).
  void set_damaged_chunks(uint64_t count) { damaged_chunks_ = count; }
  /// From now on info() says that the volume is this large; what is stored stays as it is.
  void set_claimed_dims(const Int3& dims) { info_.hierarchy = *Hierarchy::Make(dims); }
  void set_wavelet(const std::string& name) { info_.wavelet = name; }
  void set_index_to_world(const Matrix4& matrix) { info_.index_to_world = matrix; }

 private:
  struct Step {
    CoefficientSet coefficients;
    FieldStats stats;
  };
  [[nodiscard]] Status CheckStep(int64_t step) const;

  std::string path_ = "fake.zarr";
  store::DatasetInfo info_;
  std::vector<std::vector<Step>> steps_;  // [field][step]
  uint64_t damaged_chunks_ = 0;
};

}  // namespace fovea::testing

#endif  // TESTS_SUPPORT_FAKE_DATASET_H_
