#include "engine/fovea/retained_set.h"

#include <cmath>

namespace fovea {
namespace {

Status CheckFovea(const Hierarchy& hierarchy, const Fovea& fovea) {
  const Int3& dims = hierarchy.dims();
  for (int axis = 0; axis < 3; ++axis) {
    if (!(fovea.at[axis] >= 0 && fovea.at[axis] <= static_cast<double>(dims[axis]))) {
      return InvalidArgument(
          "fovea {:.6g},{:.6g},{:.6g} is outside the volume: its {} must be 0 to {} (voxels)",
          fovea.at.x, fovea.at.y, fovea.at.z, "xyz"[axis], dims[axis]);
    }
  }
  if (!(fovea.rate >= 1 && fovea.rate <= kMaxDimension)) {
    return InvalidArgument("rate {:.6g} is outside its range, 1 to {}", fovea.rate, kMaxDimension);
  }
  return absl::OkStatus();
}

/// Yu et al., eq. (1); sub-band coordinates (the printed factor is inverted).
Box3 WindowAt(const Hierarchy& hierarchy, const Fovea& fovea, int level) {
  const Int3 dims = hierarchy.DimsAt(level);
  if (fovea.rate >= static_cast<double>(hierarchy.dims().Max())) {
    return Box3::OfSize(dims);
  }
  const auto width = static_cast<int64_t>(std::floor(fovea.rate + 0.5));
  const auto scale = static_cast<double>(hierarchy.WidthAt(level));
  Box3 window;
  for (int axis = 0; axis < 3; ++axis) {
    const double centre = fovea.at[axis] / scale;
    // Always floor(x + 1/2): std::round and half-to-even do not nest.
    const auto lo = static_cast<int64_t>(std::floor(centre - static_cast<double>(width) / 2 + 0.5));
    window.lo[axis] = std::clamp<int64_t>(lo, 0, dims[axis]);
    window.hi[axis] = std::clamp<int64_t>(lo + width, 0, dims[axis]);
  }
  return window;
}

Box3 Doubled(const Box3& window, const Int3& finer_dims) {
  const Box3 box{{2 * window.lo.x, 2 * window.lo.y, 2 * window.lo.z},
                 {2 * window.hi.x, 2 * window.hi.y, 2 * window.hi.z}};
  return Intersect(box, Box3::OfSize(finer_dims));
}

}  // namespace

StatusOr<RetainedSet> RetainedSet::Make(const Hierarchy& hierarchy, const Fovea& fovea) {
  FOVEA_RETURN_IF_ERROR(CheckFovea(hierarchy, fovea));
  RetainedSet set;
  set.hierarchy_ = hierarchy;
  set.fovea_ = fovea;
  set.boxes_.push_back(Box3::OfSize(hierarchy.DimsAt(0)));
  for (int level = 0; level < hierarchy.finest(); ++level) {
    Box3 window = Intersect(WindowAt(hierarchy, fovea, level), set.boxes_[level]);
    if (window.IsEmpty()) {
      window = Box3{};
    }
    set.windows_.push_back(window);
    set.boxes_.push_back(Doubled(window, hierarchy.DimsAt(level + 1)));
  }
  return set;
}

RetainedSet RetainedSet::Whole(const Int3& dims, const Vec3& fovea) {
  RetainedSet set;
  set.hierarchy_ = Hierarchy::Flat(dims);
  set.fovea_ = {fovea, static_cast<double>(dims.Max())};
  set.boxes_.push_back(Box3::OfSize(dims));
  return set;
}

int64_t RetainedSet::CoefficientCount() const {
  int64_t count = boxes_[0].Volume();
  for (const Box3& window : windows_) {
    count += 7 * window.Volume();
  }
  return count;
}

int64_t RetainedSet::SuperVoxelCount() const {
  int64_t count = 0;
  for (size_t level = 0; level < boxes_.size(); ++level) {
    count += boxes_[level].Volume();
    if (level < windows_.size()) {
      count -= windows_[level].Volume();
    }
  }
  return count;
}

}  // namespace fovea
