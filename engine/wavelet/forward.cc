#include <algorithm>
#include <array>
#include <mutex>
#include <set>
#include <type_traits>
#include <vector>

#include "engine/base/parallel.h"
#include "engine/wavelet/haar.h"
#include "engine/wavelet/lifting.h"
#include "engine/wavelet/transform.h"

// A level is transformed brick by brick: each brick of coefficients from a block of children that
// reaches as far around it as the filters do. What lies on two blocks is computed twice, with the
// same result.

namespace fovea::wavelet {
namespace {

using internal::ForwardScale;
using internal::LiftLines;
using internal::LiftRow;
using internal::LineLength;
using Brick = BrickGrid::Brick;

/// The coefficients of the brick at `at`.
Box3 BrickBox(const Int3& at, int64_t edge) {
  return {{at.x * edge, at.y * edge, at.z * edge},
          {(at.x + 1) * edge, (at.y + 1) * edge, (at.z + 1) * edge}};
}

Box3 Doubled(const Box3& box) {
  return {{2 * box.lo.x, 2 * box.lo.y, 2 * box.lo.z}, {2 * box.hi.x, 2 * box.hi.y, 2 * box.hi.z}};
}

/// Blocks of the Haar transform in floats. Used by one thread.
class HaarBlock {
 public:
  explicit HaarBlock(const BrickGrid& finer) : finer_(finer) {}

  /// Fills a brick of means and one of detail.
  void Transform(const Int3& at, Brick& low, Brick& detail) {
    const int64_t edge = finer_.edge();
    const int64_t cube = edge * edge * edge;
    const int64_t row = 2 * edge;
    children_.box = Doubled(BrickBox(at, edge));
    children_.values.resize(static_cast<size_t>(8 * cube));
    finer_.CopyOut(children_.box, children_.values);
    // An odd last sample pairs with itself.
    RepeatBorder(Intersect(children_.box, Box3::OfSize(finer_.dims())), &children_);
    for (int64_t z = 0; z < edge; ++z) {
      for (int64_t y = 0; y < edge; ++y) {
        const float* c = children_.values.data() + (2 * z * row + 2 * y) * row;
        const int64_t to = (z * edge + y) * edge;
        std::array<float*, 8> bands{low.data() + to};
        for (int band = 1; band < 8; ++band) {
          bands[band] = detail.data() + (band - 1) * cube + to;
        }
        ForwardHaarRow({c, c + row, c + row * row, c + row * row + row}, edge, bands);
      }
    }
  }

 private:
  const BrickGrid& finer_;
  Grid children_;
};

/// Blocks of a wavelet made of lifting steps. Used by one thread.
template <typename Scheme>
class LiftingBlock {
 public:
  using Value = typename Scheme::Value;
  LiftingBlock(const BrickGrid& finer, const std::array<Scheme, 3>& schemes)
      : finer_(finer), schemes_(schemes), even_(CellsOfRow()), odd_(CellsOfRow()) {}

  void Transform(const Int3& at, Brick& low, Brick& detail) {
    const Int3& n = finer_.dims();
    const Box3 level = Box3::OfSize({(n.x + 1) / 2, (n.y + 1) / 2, (n.z + 1) / 2});
    part_ = Intersect(BrickBox(at, finer_.edge()), level);
    block_ = Intersect(Doubled(Intersect(part_.Grown(Scheme::kMargin), level)), Box3::OfSize(n));
    for (int axis = 0; axis < 3; ++axis) {
      lengths_[axis] = LineLength::Of(block_.Size()[axis]);
    }
    Load();
    const Int3 size = block_.Size();
    LiftLines</*kInverse=*/false>(schemes_[2], lengths_[2], size.x * size.y, size.x * size.y,
                                  values_.data());
    for (int64_t z = 2 * part_.lo.z; z < std::min(2 * part_.hi.z, block_.hi.z); ++z) {
      Value* const slice = values_.data() + (z - block_.lo.z) * size.x * size.y;
      LiftLines</*kInverse=*/false>(schemes_[1], lengths_[1], size.x, size.x, slice);
      for (int64_t y = 2 * part_.lo.y; y < std::min(2 * part_.hi.y, block_.hi.y); ++y) {
        FinishRow(y, z, slice + (y - block_.lo.y) * size.x, low, detail);
      }
    }
  }

 private:
  [[nodiscard]] size_t CellsOfRow() const {
    return static_cast<size_t>(finer_.edge() + 2 * Scheme::kMargin + 2);
  }

  /// Children, less the background, so that what is background gives zeros exactly.
  void Load() {
    children_.resize(static_cast<size_t>(block_.Volume()));
    finer_.CopyOut(block_, children_);
    values_.resize(children_.size());
    const float background = finer_.background();
    for (size_t i = 0; i < children_.size(); ++i) {
      values_[i] = static_cast<Value>(children_[i] - background);
    }
  }

  /// Lifts a row along x and puts its coefficients where they belong.
  void FinishRow(int64_t y, int64_t z, const Value* row, Brick& low, Brick& detail) {
    const auto [evens, odds] = lengths_[0];
    Value* const even = even_.data() + 1;
    Value* const odd = odd_.data() + 1;
    internal::Deinterleave(row, odds, even, odd);
    if (evens > odds) {
      even[odds] = row[2 * odds];
    }
    LiftRow</*kInverse=*/false>(schemes_[0], lengths_[0], even, odd);
    const int64_t edge = finer_.edge();
    const int64_t cube = edge * edge * edge;
    const int64_t at = ((z >> 1) % edge * edge + (y >> 1) % edge) * edge;
    const int64_t skip = part_.lo.x - block_.lo.x / 2;
    const int band = static_cast<int>(2 * (y & 1) + 4 * (z & 1));
    const auto scale = [&](int of) {
      float product = 1;
      for (int axis = 0; axis < 3; ++axis) {
        product *= ForwardScale<Scheme>(lengths_[axis], ((of >> axis) & 1) != 0);
      }
      return product;
    };
    const float offset = band == 0 ? finer_.background() : 0.0F;
    float* const evens_to = (band == 0 ? low.data() : detail.data() + (band - 1) * cube) + at;
    const float even_scale = scale(band);
    for (int64_t i = 0; i < part_.Size().x; ++i) {
      evens_to[i] = static_cast<float>(even[skip + i]) * even_scale + offset;
    }
    float* const odds_to = detail.data() + band * cube + at;
    const float odd_scale = scale(band + 1);
    for (int64_t i = 0; i < std::min(part_.Size().x, odds - skip); ++i) {
      odds_to[i] = static_cast<float>(odd[skip + i]) * odd_scale;
    }
  }

  const BrickGrid& finer_;
  const std::array<Scheme, 3>& schemes_;
  Box3 part_;   // the brick's coefficients
  Box3 block_;  // the children they come from
  std::array<LineLength, 3> lengths_;
  std::vector<float> children_;
  std::vector<Value> values_, even_, odd_;
};

bool AllEqual(const Brick& brick, float value) {
  return std::all_of(brick.begin(), brick.end(), [=](float v) { return v == value; });
}

/// The positions of the bricks of the coarser level that stored bricks have a part in.
std::vector<Int3> ParentBricks(const BrickGrid& finer, int64_t margin) {
  const int64_t edge = finer.edge();
  std::set<std::array<int64_t, 3>> parents;
  for (const auto& [key, brick] : finer.bricks()) {
    std::array<int64_t, 3> first{}, last{};
    for (int i = 0; i < 3; ++i) {
      const int64_t n = finer.dims()[2 - i];
      first[i] = std::max<int64_t>(key[i] * edge / 2 - margin, 0) / edge;
      last[i] = std::min((key[i] + 1) * edge / 2 - 1 + margin, (n + 1) / 2 - 1) / edge;
    }
    for (int64_t z = first[0]; z <= last[0]; ++z) {
      for (int64_t y = first[1]; y <= last[1]; ++y) {
        for (int64_t x = first[2]; x <= last[2]; ++x) {
          parents.insert({z, y, x});
        }
      }
    }
  }
  std::vector<Int3> positions;
  positions.reserve(parents.size());
  for (const auto& key : parents) {
    positions.push_back({key[2], key[1], key[0]});
  }
  return positions;
}

/// Level l+1 (`finer`) to level l: its means and its detail. `make_block` makes what transforms
/// bricks, one for each thread.
template <typename MakeBlock>
void TransformLevel(const BrickGrid& finer, int64_t margin, int threads,
                    const MakeBlock& make_block, BrickGrid* low, BrickGrid* detail) {
  const std::vector<Int3> parents = ParentBricks(finer, margin);
  std::mutex mutex;  // guards the two results
  ParallelFor(0, static_cast<int64_t>(parents.size()), 16, threads,
              [&](int64_t first, int64_t last) {
                auto block = make_block();
                for (int64_t i = first; i < last; ++i) {
                  Brick means(static_cast<size_t>(low->brick_values()), finer.background());
                  Brick bands(static_cast<size_t>(detail->brick_values()));
                  block.Transform(parents[i], means, bands);
                  const bool has_means = !AllEqual(means, finer.background());
                  const bool has_detail = !AllEqual(bands, 0.0F);
                  const std::lock_guard lock(mutex);
                  if (has_means) {
                    low->Touch(parents[i]) = std::move(means);
                  }
                  if (has_detail) {
                    detail->Touch(parents[i]) = std::move(bands);
                  }
                }
              });
}

template <typename Scheme>
void LiftLevel(const std::array<Scheme, 3>& schemes, const BrickGrid& finer, int threads,
               BrickGrid* low, BrickGrid* detail) {
  TransformLevel(
      finer, Scheme::kMargin, threads, [&] { return LiftingBlock<Scheme>(finer, schemes); }, low,
      detail);
}

void ForwardLevel(const Basis& basis, int level, const BrickGrid& finer, int threads,
                  BrickGrid* low, BrickGrid* detail) {
  if (basis.integer && basis.wavelet == Wavelet::kHaar) {
    LiftLevel(internal::ByAxis<internal::IntegerHaar>(level), finer, threads, low, detail);
  } else if (basis.integer) {
    LiftLevel(internal::ByAxis<internal::IntegerCdf53>(level), finer, threads, low, detail);
  } else if (basis.wavelet == Wavelet::kCdf53) {
    LiftLevel(std::array<internal::Cdf53, 3>{}, finer, threads, low, detail);
  } else if (basis.wavelet == Wavelet::kCdf97) {
    LiftLevel(std::array<internal::Cdf97, 3>{}, finer, threads, low, detail);
  } else {
    TransformLevel(
        finer, 0, threads, [&] { return HaarBlock(finer); }, low, detail);
  }
}

}  // namespace

CoefficientSet Forward(const BrickGrid& voxels, const Hierarchy& hierarchy, const Basis& basis,
                       int threads) {
  CoefficientSet set;
  set.hierarchy = hierarchy;
  set.basis = basis;
  set.detail.resize(static_cast<size_t>(hierarchy.finest()));
  BrickGrid level_values;
  const BrickGrid* finer = &voxels;
  for (int level = hierarchy.finest() - 1; level >= 0; --level) {
    const Int3 dims = hierarchy.DimsAt(level);
    BrickGrid low(dims, voxels.edge(), 1, voxels.background());
    set.detail[level] = BrickGrid(dims, voxels.edge(), 7, 0.0F);
    ForwardLevel(basis, level, *finer, threads, &low, &set.detail[level]);
    level_values = std::move(low);
    finer = &level_values;
  }
  set.coarse = Grid(Box3::OfSize(hierarchy.DimsAt(0)));
  finer->CopyOut(set.coarse.box, set.coarse.values);
  return set;
}

}  // namespace fovea::wavelet
