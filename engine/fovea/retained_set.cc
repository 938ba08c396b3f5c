#include "engine/fovea/retained_set.h"

#include <algorithm>
#include <cmath>
#include <numbers>

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
    if (!(fovea.rate[axis] >= 1 && fovea.rate[axis] <= kMaxDimension)) {
      return InvalidArgument("rate {} is outside its range, 1 to {}", FormatRate(fovea.rate),
                             kMaxDimension);
    }
  }
  return absl::OkStatus();
}

/// Whether the axis is kept whole.
bool IsWhole(const Hierarchy& hierarchy, const Fovea& fovea, int axis) {
  return fovea.rate[axis] >= static_cast<double>(hierarchy.dims().Max());
}

double RoundedRate(const Fovea& fovea, int axis) {
  return std::floor(fovea.rate[axis] + 0.5);
}

/// Yu et al., eq. (1); sub-band coordinates (the printed factor is inverted).
Box3 WindowAt(const Hierarchy& hierarchy, const Fovea& fovea, int level) {
  const Int3 dims = hierarchy.DimsAt(level);
  const auto scale = static_cast<double>(hierarchy.WidthAt(level));
  Box3 window = Box3::OfSize(dims);
  for (int axis = 0; axis < 3; ++axis) {
    if (IsWhole(hierarchy, fovea, axis)) {
      continue;
    }
    const double width = RoundedRate(fovea, axis);
    const double centre = fovea.at[axis] / scale;
    // Always floor(x + 1/2): std::round and half-to-even do not nest.
    const auto lo = static_cast<int64_t>(std::floor(centre - width / 2 + 0.5));
    window.lo[axis] = std::clamp<int64_t>(lo, 0, dims[axis]);
    window.hi[axis] = std::clamp<int64_t>(lo + static_cast<int64_t>(width), 0, dims[axis]);
  }
  return window;
}

/// 1 up to half of the way, then half a period of a cosine, which reaches 0 at 1.
double RaisedCosine(double distance) {
  constexpr double kFlat = 0.5;
  if (distance <= kFlat) {
    return 1;
  }
  return 0.5 + 0.5 * std::cos(std::numbers::pi * (distance - kFlat) / (1 - kFlat));
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

/// What a coefficient's place on one axis adds to its squared distance from the fovea in half
/// diameters (kSphere), or the factor of its weight (kSmooth).
double RetainedSet::Term(int level, int axis, int64_t p) const {
  const bool sphere = fovea_.window == WindowShape::kSphere;
  if (IsWhole(hierarchy_, fovea_, axis)) {
    return sphere ? 0 : 1;
  }
  const double centre = fovea_.at[axis] / static_cast<double>(hierarchy_.WidthAt(level));
  const double offset = static_cast<double>(p) + 0.5 - centre;
  if (sphere) {
    // A ball of one coefficient would not nest: the parent's centre may lie outside.
    const double distance = offset / (std::max(fovea_.rate[axis], 2.0) / 2);
    return distance * distance;
  }
  const double width = RoundedRate(fovea_, axis);
  // Centres lie at most width/2 away: half a coefficient farther out the weight would be 0.
  return RaisedCosine(std::abs(offset) / ((width + 1) / 2));
}

std::vector<double> RetainedSet::Terms(int level, int axis, const Box3& box) const {
  std::vector<double> terms;
  for (int64_t p = box.lo[axis]; p < box.hi[axis]; ++p) {
    terms.push_back(Term(level, axis, p));
  }
  return terms;
}

float RetainedSet::Weight(int level, const Int3& p) const {
  if (!windows_[level].Contains(p)) {
    return 0;
  }
  if (fovea_.window == WindowShape::kCube) {
    return 1;
  }
  const double x = Term(level, 0, p.x);
  const double y = Term(level, 1, p.y);
  const double z = Term(level, 2, p.z);
  if (fovea_.window == WindowShape::kSphere) {
    return x + (y + z) <= 1 ? 1.0F : 0.0F;
  }
  return static_cast<float>(x * (y * z));
}

void RetainedSet::Weigh(int level, const Box3& box, std::span<float> detail) const {
  if (fovea_.window == WindowShape::kCube || box.IsEmpty()) {
    return;
  }
  const bool sphere = fovea_.window == WindowShape::kSphere;
  const std::vector<double> along_x = Terms(level, 0, box);
  const std::vector<double> along_y = Terms(level, 1, box);
  const std::vector<double> along_z = Terms(level, 2, box);
  std::vector<float> weights(along_x.size());
  const size_t band_stride = detail.size() / 7;
  float* row = detail.data();
  for (const double z : along_z) {
    for (const double y : along_y) {
      for (size_t i = 0; i < weights.size(); ++i) {
        weights[i] = sphere ? (along_x[i] + (y + z) <= 1 ? 1.0F : 0.0F)
                            : static_cast<float>(along_x[i] * (y * z));
      }
      for (size_t band = 0; band < 7; ++band) {
        float* values = row + band * band_stride;
        for (size_t i = 0; i < weights.size(); ++i) {
          values[i] *= weights[i];
        }
      }
      row += weights.size();
    }
  }
}

int64_t RetainedSet::CountInBall(int level) const {
  const Box3& window = windows_[level];
  std::vector<double> along_x = Terms(level, 0, window);
  std::sort(along_x.begin(), along_x.end());
  const std::vector<double> along_y = Terms(level, 1, window);
  int64_t count = 0;
  for (const double z : Terms(level, 2, window)) {
    for (const double y : along_y) {
      const auto end = std::partition_point(along_x.begin(), along_x.end(),
                                            [&](double x) { return x + (y + z) <= 1; });
      count += end - along_x.begin();
    }
  }
  return count;
}

int64_t RetainedSet::CoefficientCount() const {
  int64_t count = boxes_[0].Volume();
  for (int level = 0; level < hierarchy_.finest(); ++level) {
    count +=
        7 * (fovea_.window == WindowShape::kSphere ? CountInBall(level) : windows_[level].Volume());
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

std::string FormatRate(const Rate& rate) {
  return rate.IsIsotropic() ? fmt::format("{}", rate.x)
                            : fmt::format("{},{},{}", rate.x, rate.y, rate.z);
}

}  // namespace fovea
