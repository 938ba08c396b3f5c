#include "engine/volume/hierarchy.h"

namespace fovea {

StatusOr<Hierarchy> Hierarchy::Make(const Int3& dims) {
  for (int axis = 0; axis < 3; ++axis) {
    if (dims[axis] < 1 || dims[axis] > kMaxDimension) {
      return InvalidArgument("a volume of {} x {} x {} voxels: each axis must be 1 to {}", dims.x,
                             dims.y, dims.z, kMaxDimension);
    }
  }
  Hierarchy hierarchy;
  hierarchy.dims_ = dims;
  for (int64_t longest = dims.Max(); longest > kCoarsestDimension; longest = (longest + 1) / 2) {
    ++hierarchy.finest_;
  }
  return hierarchy;
}

Hierarchy Hierarchy::Flat(const Int3& dims) {
  Hierarchy hierarchy;
  hierarchy.dims_ = dims;
  return hierarchy;
}

Int3 Hierarchy::DimsAt(int level) const {
  const int64_t w = WidthAt(level);
  return {(dims_.x + w - 1) / w, (dims_.y + w - 1) / w, (dims_.z + w - 1) / w};
}

}  // namespace fovea
