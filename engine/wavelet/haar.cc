#include "engine/wavelet/haar.h"

#include <algorithm>
#include <vector>

#include "engine/base/parallel.h"
#include "engine/wavelet/kernels.h"

namespace fovea::wavelet {

void InverseHaarRow(const HaarBands& bands, int64_t count, const HaarRows& rows) {
  internal::InverseHaar(bands, count, rows);
}

namespace {

/// Fills the slices of children of one slice of parents, four rows at a time.
class SliceInverse {
 public:
  SliceInverse(const Grid& parent, const Box3& window, std::span<const float> detail,
               const Int3& child_dims, Grid* child)
      : parent_(parent),
        window_(window.IsEmpty() ? Box3{} : window),
        detail_(detail),
        child_(*child),
        inside_(Intersect(child->box, Box3::OfSize(child_dims))),
        middle_lo_(std::clamp((inside_.lo.x + 1) >> 1, window_.lo.x, window_.hi.x)),
        middle_hi_(std::clamp(inside_.hi.x >> 1, middle_lo_, window_.hi.x)) {}

  void Fill(int64_t pz) {
    for (int64_t py = inside_.lo.y >> 1; 2 * py < inside_.hi.y; ++py) {
      if (window_.Contains(Int3{window_.lo.x, py, pz})) {
        FillWithDetail(py, pz);
      } else {
        FillCopies(py, pz);
      }
    }
    RepeatBorderRows(pz);
  }

 private:
  /// Row (y, z) of the children, of x = 0; null if the box lacks it.
  float* ChildRow(int64_t y, int64_t z) {
    const bool has = y >= inside_.lo.y && y < inside_.hi.y && z >= inside_.lo.z && z < inside_.hi.z;
    return has ? child_.Row(y, z) - child_.box.lo.x : nullptr;
  }

  static void Copy(const float* means, int64_t first, int64_t last, float* row) {
    for (int64_t x = first; x < last; ++x) {
      row[x] = means[x >> 1];
    }
  }

  void RepeatBorderX(float* row) const {
    std::fill(row + child_.box.lo.x, row + inside_.lo.x, row[inside_.lo.x]);
    std::fill(row + inside_.hi.x, row + child_.box.hi.x, row[inside_.hi.x - 1]);
  }

  void FillCopies(int64_t py, int64_t pz) {
    const float* means = parent_.Row(py, pz) - parent_.box.lo.x;
    const float* first = nullptr;
    for (int i = 0; i < 4; ++i) {
      float* row = ChildRow(2 * py + i % 2, 2 * pz + i / 2);
      if (row == nullptr) {
        continue;
      }
      if (first != nullptr) {
        std::copy(first + child_.box.lo.x, first + child_.box.hi.x, row + child_.box.lo.x);
        continue;
      }
      Copy(means, inside_.lo.x, inside_.hi.x, row);
      RepeatBorderX(row);
      first = row;
    }
  }

  void FillWithDetail(int64_t py, int64_t pz) {
    const float* means = parent_.Row(py, pz) - parent_.box.lo.x;
    HaarRows rows{};
    for (int i = 0; i < 4; ++i) {
      float* row = ChildRow(2 * py + i % 2, 2 * pz + i / 2);
      rows[i] = row;
      if (row != nullptr) {
        Copy(means, inside_.lo.x, std::min(inside_.hi.x, 2 * window_.lo.x), row);
        Copy(means, std::max(inside_.lo.x, 2 * window_.hi.x), inside_.hi.x, row);
      }
    }
    Expand(py, pz, means, middle_lo_, middle_hi_, rows);
    for (const int64_t px : {inside_.lo.x >> 1, inside_.hi.x >> 1}) {  // pairs cut by an edge
      const bool cut = 2 * px < inside_.lo.x || 2 * px + 1 >= inside_.hi.x;
      if (cut && 2 * px < inside_.hi.x && px >= window_.lo.x && px < window_.hi.x) {
        ExpandOne(py, pz, means, px, rows);
      }
    }
    for (float* row : rows) {
      if (row != nullptr) {
        RepeatBorderX(row);
      }
    }
  }

  HaarBands BandsAt(int64_t px, int64_t py, int64_t pz, const float* means) const {
    const Int3 size = window_.Size();
    HaarBands bands{means + px};
    const float* at = detail_.data() + ((pz - window_.lo.z) * size.y + py - window_.lo.y) * size.x +
                      px - window_.lo.x;
    for (int band = 1; band < 8; ++band) {
      bands[band] = at + (band - 1) * size.Product();
    }
    return bands;
  }

  void Expand(int64_t py, int64_t pz, const float* means, int64_t first, int64_t last,
              HaarRows rows) {
    bool spare = false;
    for (float*& row : rows) {
      spare = spare || row == nullptr;
      row = row == nullptr ? nullptr : row + 2 * first;
    }
    if (spare) {  // rows that the box lacks are made too, and thrown away
      spare_.resize(static_cast<size_t>(8 * window_.Size().x));
      for (int i = 0; i < 4; ++i) {
        rows[i] = rows[i] != nullptr ? rows[i] : spare_.data() + 2 * i * window_.Size().x;
      }
    }
    InverseHaarRow(BandsAt(first, py, pz, means), last - first, rows);
  }

  void ExpandOne(int64_t py, int64_t pz, const float* means, int64_t px, const HaarRows& rows) {
    std::array<std::array<float, 2>, 4> pairs;
    InverseHaarRow(BandsAt(px, py, pz, means), 1,
                   {pairs[0].data(), pairs[1].data(), pairs[2].data(), pairs[3].data()});
    for (int i = 0; i < 4; ++i) {
      for (int64_t x = std::max(2 * px, inside_.lo.x); x < std::min(2 * px + 2, inside_.hi.x);
           ++x) {
        if (rows[i] != nullptr) {
          rows[i][x] = pairs[i][x - 2 * px];
        }
      }
    }
  }

  void RepeatBorderRows(int64_t pz) {
    const int64_t width = child_.box.Size().x;
    for (int64_t z = std::max(2 * pz, inside_.lo.z); z < std::min(2 * pz + 2, inside_.hi.z); ++z) {
      for (int64_t y = child_.box.lo.y; y < inside_.lo.y; ++y) {
        std::copy_n(child_.Row(inside_.lo.y, z), width, child_.Row(y, z));
      }
      for (int64_t y = inside_.hi.y; y < child_.box.hi.y; ++y) {
        std::copy_n(child_.Row(inside_.hi.y - 1, z), width, child_.Row(y, z));
      }
    }
  }

  const Grid& parent_;
  const Box3 window_;
  std::span<const float> detail_;
  Grid& child_;
  const Box3 inside_;
  const int64_t middle_lo_, middle_hi_;  // parents both of whose children along x are in the box
  std::vector<float> spare_;
};

}  // namespace

void InverseHaarSlices(const Grid& parent, const Box3& window, std::span<const float> detail,
                       const Int3& child_dims, int64_t pz, Grid* child) {
  SliceInverse(parent, window, detail, child_dims, child).Fill(pz);
}

void InverseHaarLevel(const Grid& parent, const Box3& window, std::span<const float> detail,
                      const Int3& child_dims, int threads, Grid* child) {
  const Box3 inside = Intersect(child->box, Box3::OfSize(child_dims));
  ParallelFor(inside.lo.z >> 1, (inside.hi.z + 1) >> 1, 4, threads,
              [&](int64_t first, int64_t last) {
                SliceInverse slices(parent, window, detail, child_dims, child);
                for (int64_t pz = first; pz < last; ++pz) {
                  slices.Fill(pz);
                }
              });
  const size_t slice = static_cast<size_t>(child->box.Size().x * child->box.Size().y);
  for (int64_t z = child->box.lo.z; z < inside.lo.z; ++z) {
    std::copy_n(child->Row(child->box.lo.y, inside.lo.z), slice, child->Row(child->box.lo.y, z));
  }
  for (int64_t z = inside.hi.z; z < child->box.hi.z; ++z) {
    std::copy_n(child->Row(child->box.lo.y, inside.hi.z - 1), slice,
                child->Row(child->box.lo.y, z));
  }
}

}  // namespace fovea::wavelet
