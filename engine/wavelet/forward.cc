#include <algorithm>
#include <memory>
#include <mutex>
#include <utility>

#include "engine/wavelet/forward_stream.h"
#include "engine/wavelet/transform.h"

namespace fovea::wavelet {
namespace {

/// Puts the bricks where a CoefficientSet has them.
class SetSink final : public DetailSink {
 public:
  explicit SetSink(CoefficientSet* set) : set_(*set) {}

  Status Take(const DetailBrick& brick) override {
    BrickGrid::Brick values(brick.values.size() / sizeof(float));
    if (set_.basis.integer) {
      const auto* const whole = reinterpret_cast<const int32_t*>(brick.values.data());
      std::copy(whole, whole + values.size(), values.begin());
    } else {
      const auto* const floats = reinterpret_cast<const float*>(brick.values.data());
      std::copy(floats, floats + values.size(), values.begin());
    }
    const std::lock_guard lock(mutex_);
    set_.detail[static_cast<size_t>(brick.level)].Put(brick.at, std::move(values));
    return absl::OkStatus();
  }
  Status EndLayer(int /*level*/, int64_t /*z*/) override { return absl::OkStatus(); }

 private:
  CoefficientSet& set_;
  std::mutex mutex_;
};

}  // namespace

CoefficientSet Forward(const BrickGrid& voxels, const Hierarchy& hierarchy, const Basis& basis,
                       int threads) {
  CoefficientSet set;
  set.hierarchy = hierarchy;
  set.basis = basis;
  for (int level = 0; level < hierarchy.finest(); ++level) {
    set.detail.emplace_back(hierarchy.DimsAt(level), voxels.edge(), 7, 0.0F);
  }
  SetSink sink(&set);
  const CoefficientType type = basis.integer ? CoefficientType::kInt32 : CoefficientType::kFloat32;
  auto stream = ForwardStream::Make(
      {hierarchy, basis, type, voxels.edge(), voxels.background(), threads}, &sink);
  if (!stream.ok()) {
    return set;
  }
  const std::shared_ptr<const BrickGrid> bricks(std::shared_ptr<const void>(), &voxels);
  const int64_t layers = (hierarchy.dims().z + voxels.edge() - 1) / voxels.edge();
  if ((*stream)->Push(bricks, layers).ok()) {
    set.coarse = (*stream)->Finish().value();
  }
  return set;
}

}  // namespace fovea::wavelet
