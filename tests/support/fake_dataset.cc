#include "tests/support/fake_dataset.h"

#include <algorithm>
#include <cmath>

#include "engine/wavelet/haar.h"

namespace fovea::testing {
namespace {

constexpr Int3 kDims{40, 32, 48};

BrickGrid Ball(const Vec3& center, double radius, float greatest) {
  BrickGrid grid(kDims, 16, 1, 0);
  const Box3 box = Box3::OfSize(kDims);
  std::vector<float> values;
  for (int64_t z = 0; z < kDims.z; ++z) {
    for (int64_t y = 0; y < kDims.y; ++y) {
      for (int64_t x = 0; x < kDims.x; ++x) {
        const Vec3 at{static_cast<double>(x) + 0.5, static_cast<double>(y) + 0.5,
                      static_cast<double>(z) + 0.5};
        const double depth = 1 - Length(at - center) / radius;
        values.push_back(greatest * static_cast<float>(std::clamp(2 * depth, 0.0, 1.0)));
      }
    }
  }
  grid.CopyIn(box, values);
  return grid;
}

class FakeSource final : public store::StepSource {
 public:
  FakeSource(const CoefficientSet& set, uint64_t damaged) : memory_(set), damaged_(damaged) {}
  [[nodiscard]] const Hierarchy& hierarchy() const override { return memory_.hierarchy(); }
  [[nodiscard]] Status ReadCoarse(std::span<float> out) override { return memory_.ReadCoarse(out); }
  [[nodiscard]] Status ReadDetail(int level, const Box3& window, std::span<float> out) override {
    return memory_.ReadDetail(level, window, out);
  }
  [[nodiscard]] store::ReadStats read_stats() const override { return {7, 30, 1234, damaged_}; }

 private:
  MemorySource memory_;
  uint64_t damaged_;
};

}  // namespace

FakeDataset::FakeDataset(int64_t steps) {
  info_.hierarchy = *Hierarchy::Make(kDims);
  info_.index_to_world.m = {2, 0, 0, 10, 0, 2, 0, 20, 0, 0, 2, 30, 0, 0, 0, 1};
  info_.committed_steps = steps;
  info_.default_field = "density";
  info_.fields = {{"density", "float32", 0, 1}, {"warm", "float32", 0, 100}};
  for (const bool warm : {false, true}) {
    std::vector<Step> field;
    for (int64_t step = 0; step < steps; ++step) {
      const double z = 12 + 4 * static_cast<double>(step);
      const BrickGrid voxels =
          warm ? Ball({10, 10, z}, 8, 100) : Ball({20, 16, z}, 9 + static_cast<double>(step), 1);
      field.push_back({wavelet::ForwardHaar(voxels, info_.hierarchy, 1), ComputeStats(voxels)});
    }
    steps_.push_back(std::move(field));
  }
}

Status FakeDataset::CheckStep(int64_t step) const {
  return step >= 0 && step < info_.committed_steps
             ? absl::OkStatus()
             : OutOfRange("step {} is not there: steps 0 to {}", step, info_.committed_steps - 1);
}

StatusOr<int64_t> FakeDataset::TimeNs(int64_t step) {
  FOVEA_RETURN_IF_ERROR(CheckStep(step));
  return 2'000'000'000 + step * 500'000'000;
}

StatusOr<std::optional<int64_t>> FakeDataset::FrameNumber(int64_t step) {
  FOVEA_RETURN_IF_ERROR(CheckStep(step));
  return std::optional<int64_t>(100 + 2 * step);
}

StatusOr<FieldStats> FakeDataset::Stats(int64_t step, const std::string& field) {
  FOVEA_RETURN_IF_ERROR(CheckStep(step));
  return steps_[field == "warm" ? 1 : 0][static_cast<size_t>(step)].stats;
}

StatusOr<std::unique_ptr<store::StepSource>> FakeDataset::OpenStep(int64_t step,
                                                                   const std::string& field,
                                                                   store::OnDamage on_damage) {
  FOVEA_RETURN_IF_ERROR(CheckStep(step));
  if (damaged_chunks_ > 0 && on_damage == store::OnDamage::kFail) {
    return DataLoss("chunk 0.0.0 of field {} at step {}: checksum", field, step);
  }
  return std::make_unique<FakeSource>(
      steps_[field == "warm" ? 1 : 0][static_cast<size_t>(step)].coefficients, damaged_chunks_);
}

}  // namespace fovea::testing
