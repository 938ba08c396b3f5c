#include "engine/wavelet/haar.h"

#include <algorithm>
#include <mutex>
#include <set>
#include <vector>

#include "engine/base/parallel.h"

namespace fovea::wavelet {
namespace {

/// A cube of `2 * edge` children a side, [z][y][x], becomes one brick of means and seven bricks of
/// detail. Sums are in double and rounded once, so that a coefficient is exact to half an ulp.
void TransformCube(const std::vector<float>& children, int64_t edge, BrickGrid::Brick& low,
                   BrickGrid::Brick& detail) {
  const int64_t cube = edge * edge * edge;
  const int64_t row = 2 * edge;
  for (int64_t z = 0; z < edge; ++z) {
    for (int64_t y = 0; y < edge; ++y) {
      for (int64_t x = 0; x < edge; ++x) {
        const float* c = children.data() + ((2 * z) * row + 2 * y) * row + 2 * x;
        double v[8] = {c[0],
                       c[1],
                       c[row],
                       c[row + 1],
                       c[row * row],
                       c[row * row + 1],
                       c[row * row + row],
                       c[row * row + row + 1]};
        for (int axis = 1; axis < 8; axis *= 2) {
          for (int i = 0; i < 8; ++i) {
            if ((i & axis) == 0) {
              const double p = v[i];
              const double q = v[i | axis];
              v[i] = (p + q) / 2;
              v[i | axis] = (p - q) / 2;
            }
          }
        }
        const int64_t at = (z * edge + y) * edge + x;
        low[at] = static_cast<float>(v[0]);
        for (int band = 1; band < 8; ++band) {
          detail[(band - 1) * cube + at] = static_cast<float>(v[band]);
        }
      }
    }
  }
}

/// Past the border of a grid with `dims` points, an odd last sample pairs with itself.
void RepeatBorder(const Int3& dims, const Box3& box, std::vector<float>& values) {
  const Int3 size = box.Size();
  const auto at = [&](int64_t x, int64_t y, int64_t z) -> float& {
    return values[(z * size.y + y) * size.x + x];
  };
  const Int3 in{std::min(size.x, dims.x - box.lo.x), std::min(size.y, dims.y - box.lo.y),
                std::min(size.z, dims.z - box.lo.z)};
  for (int64_t z = 0; z < in.z; ++z) {
    for (int64_t y = 0; y < in.y; ++y) {
      for (int64_t x = in.x; x < size.x; ++x) {
        at(x, y, z) = at(in.x - 1, y, z);
      }
    }
    for (int64_t y = in.y; y < size.y; ++y) {
      std::copy_n(&at(0, in.y - 1, z), size.x, &at(0, y, z));
    }
  }
  for (int64_t z = in.z; z < size.z; ++z) {
    std::copy_n(&at(0, 0, in.z - 1), size.x * size.y, &at(0, 0, z));
  }
}

bool AllZero(const BrickGrid::Brick& brick) {
  return std::all_of(brick.begin(), brick.end(), [](float value) { return value == 0.0F; });
}

/// The positions of the bricks of the coarser level that have at least one stored child brick.
std::vector<Int3> ParentBricks(const BrickGrid& finer) {
  std::set<std::array<int64_t, 3>> parents;
  for (const auto& [key, brick] : finer.bricks()) {
    parents.insert({key[0] / 2, key[1] / 2, key[2] / 2});
  }
  std::vector<Int3> positions;
  for (const auto& key : parents) {
    positions.push_back({key[2], key[1], key[0]});
  }
  return positions;
}

/// Level l+1 (`finer`) to level l: its means and its detail.
void TransformLevel(const BrickGrid& finer, int threads, BrickGrid* low, BrickGrid* detail) {
  const int64_t edge = finer.edge();
  const std::vector<Int3> parents = ParentBricks(finer);
  std::mutex mutex;  // guards the two results
  ParallelFor(
      0, static_cast<int64_t>(parents.size()), 1, threads, [&](int64_t first, int64_t last) {
        std::vector<float> children(static_cast<size_t>(8 * edge * edge * edge));
        for (int64_t i = first; i < last; ++i) {
          const Int3& at = parents[i];
          const Box3 box{{2 * edge * at.x, 2 * edge * at.y, 2 * edge * at.z},
                         {2 * edge * (at.x + 1), 2 * edge * (at.y + 1), 2 * edge * (at.z + 1)}};
          finer.CopyOut(box, children);
          RepeatBorder(finer.dims(), box, children);
          BrickGrid::Brick means(static_cast<size_t>(low->brick_values()));
          BrickGrid::Brick bands(static_cast<size_t>(detail->brick_values()));
          TransformCube(children, edge, means, bands);
          const bool has_detail = !AllZero(bands);
          const std::lock_guard lock(mutex);
          low->Touch(at) = std::move(means);
          if (has_detail) {
            detail->Touch(at) = std::move(bands);
          }
        }
      });
}

}  // namespace

CoefficientSet ForwardHaar(const BrickGrid& voxels, const Hierarchy& hierarchy, int threads) {
  CoefficientSet set;
  set.hierarchy = hierarchy;
  set.detail.resize(static_cast<size_t>(hierarchy.finest()));
  BrickGrid level_values;
  const BrickGrid* finer = &voxels;
  for (int level = hierarchy.finest() - 1; level >= 0; --level) {
    const Int3 dims = hierarchy.DimsAt(level);
    BrickGrid low(dims, voxels.edge(), 1, voxels.background());
    set.detail[level] = BrickGrid(dims, voxels.edge(), 7, 0.0F);
    TransformLevel(*finer, threads, &low, &set.detail[level]);
    level_values = std::move(low);
    finer = &level_values;
  }
  set.coarse = Grid(Box3::OfSize(hierarchy.DimsAt(0)));
  finer->CopyOut(set.coarse.box, set.coarse.values);
  return set;
}

namespace {

/// Rows of children from rows of parents and, where the window has them, of detail.
class RowInverse {
 public:
  RowInverse(const Grid& parent, const Box3& window, std::span<const float> detail,
             const Int3& child_dims)
      : parent_(parent), window_(window), detail_(detail), child_dims_(child_dims) {}

  /// Fills the row of `child` at (y, z), which may lie outside the volume.
  void Fill(int64_t y, int64_t z, Grid* child) const {
    const int64_t py = std::clamp<int64_t>(y, 0, child_dims_.y - 1);
    const int64_t pz = std::clamp<int64_t>(z, 0, child_dims_.z - 1);
    const int64_t first = std::max<int64_t>(child->box.lo.x, 0);
    const int64_t last = std::min(child->box.hi.x, child_dims_.x);
    float* row = child->Row(y, z) - child->box.lo.x;  // of x = 0
    const float* means = parent_.Row(py >> 1, pz >> 1) - parent_.box.lo.x;
    for (int64_t x = first; x < last; ++x) {
      row[x] = means[x >> 1];
    }
    if (window_.Contains(Int3{window_.lo.x, py >> 1, pz >> 1})) {
      AddDetail(means, py, pz, first, last, row);
    }
    std::fill(row + child->box.lo.x, row + first, row[first]);
    std::fill(row + last, row + child->box.hi.x, row[last - 1]);
  }

 private:
  /// The eight children of a parent are its mean with all combinations of signs of its detail.
  void AddDetail(const float* means, int64_t y, int64_t z, int64_t first, int64_t last,
                 float* row) const {
    const Int3 size = window_.Size();
    const int64_t plane = size.Product();
    const float* d = detail_.data() +
                     (((z >> 1) - window_.lo.z) * size.y + (y >> 1) - window_.lo.y) * size.x -
                     window_.lo.x;  // of parent x = 0
    const double sy = (y & 1) != 0 ? -1.0 : 1.0;
    const double sz = (z & 1) != 0 ? -1.0 : 1.0;
    for (int64_t px = window_.lo.x; px < window_.hi.x; ++px) {
      const float* at = d + px;
      const double low = means[px] + sy * at[plane] + sz * (at[3 * plane] + sy * at[5 * plane]);
      const double high = at[0] + sy * at[2 * plane] + sz * (at[4 * plane] + sy * at[6 * plane]);
      if (2 * px >= first && 2 * px < last) {
        row[2 * px] = static_cast<float>(low + high);
      }
      if (2 * px + 1 >= first && 2 * px + 1 < last) {
        row[2 * px + 1] = static_cast<float>(low - high);
      }
    }
  }

  const Grid& parent_;
  const Box3& window_;
  std::span<const float> detail_;
  const Int3& child_dims_;
};

}  // namespace

void InverseHaarLevel(const Grid& parent, const Box3& window, std::span<const float> detail,
                      const Int3& child_dims, int threads, Grid* child) {
  const RowInverse inverse(parent, window, detail, child_dims);
  ParallelFor(child->box.lo.z, child->box.hi.z, 4, threads, [&](int64_t first, int64_t last) {
    for (int64_t z = first; z < last; ++z) {
      for (int64_t y = child->box.lo.y; y < child->box.hi.y; ++y) {
        inverse.Fill(y, z, child);
      }
    }
  });
}

}  // namespace fovea::wavelet
