#include <algorithm>
#include <array>
#include <type_traits>
#include <vector>

#include "engine/base/parallel.h"
#include "engine/wavelet/haar.h"
#include "engine/wavelet/lifting.h"
#include "engine/wavelet/transform.h"

namespace fovea::wavelet {
namespace {

using internal::ForwardScale;
using internal::LiftLines;
using internal::LiftRow;
using internal::LineLength;

constexpr int64_t kLeastSlab = 16;

/// What one level of the inverse works on.
struct Level {
  const Grid& parent;
  const Box3& window;
  std::span<const float> detail;
};

/// Inverts a region of parents. Axes are taken back in the order x, y, z: slices of children are
/// made of one slice of coefficients each, and lifted along z as they come; few are held at a time.
template <typename Scheme>
class RegionInverse {
 public:
  using Value = typename Scheme::Value;

  RegionInverse(const std::array<Scheme, 3>& schemes, const Level& level, const Box3& parents,
                const Int3& child_dims)
      : schemes_(schemes), level_(level), parents_(parents) {
    for (int axis = 0; axis < 3; ++axis) {
      children_.lo[axis] = 2 * parents.lo[axis];
      children_.hi[axis] = std::min(2 * parents.hi[axis], child_dims[axis]);
      lengths_[axis] = LineLength::Of(children_.Size()[axis]);
    }
    for (int band = 0; band < 8; ++band) {
      scales_[band] = 1;
      for (int axis = 0; axis < 3; ++axis) {
        scales_[band] /= ForwardScale<Scheme>(lengths_[axis], ((band >> axis) & 1) != 0);
      }
    }
  }

  /// Fills the slices [first, last) of `child` where they lie inside the region.
  void FillSlab(int64_t first, int64_t last, Grid* child) const {
    Slab slab;
    slab.begin = std::max(parents_.lo.z, (first - Scheme::kHalo) >> 1);
    slab.end = std::min(parents_.hi.z, (last + Scheme::kHalo + 1) >> 1);
    slab.odd_end = std::min(slab.end, children_.hi.z >> 1);
    slab.slice = children_.Size().x * children_.Size().y;
    slab.values.resize(static_cast<size_t>(kHeld * 2 * slab.slice));
    slab.low.resize(static_cast<size_t>(lengths_[0].evens + 2));
    slab.high.resize(slab.low.size());
    // With the slices of pair k, step s has all it needs to change pair k - (s + 1) / 2.
    for (int64_t k = slab.begin; k < slab.end + kDelay; ++k) {
      if (k < slab.end) {
        FillSlice(k, /*band_z=*/0, slab.Even(k), &slab);
      }
      if (k < slab.odd_end) {
        FillSlice(k, /*band_z=*/4, slab.Odd(k), &slab);
      }
      for (int step = 0; step < Scheme::kSteps; ++step) {
        LiftSlices(step, k - (step + 1) / 2, &slab);
      }
      const int64_t done = 2 * (k - kDelay);
      for (int64_t z = std::max(done, first); z < std::min(done + 2, last); ++z) {
        CopyOut(z % 2 == 0 ? slab.Even(z / 2) : slab.Odd(z / 2), z, child);
      }
    }
  }

 private:
  static constexpr int64_t kDelay = Scheme::kSteps / 2;  // pairs from the newest to the finished
  static constexpr int64_t kHeld = kDelay + 1;
  using Row = std::vector<Value>;

  /// Pairs [begin, end) of slices on their way; the last may lack its odd slice.
  struct Slab {
    int64_t begin = 0, end = 0, odd_end = 0;
    int64_t slice = 0;  // values in a slice
    Row values, low, high;
    Value* Even(int64_t pair) { return values.data() + pair % kHeld * 2 * slice; }
    Value* Odd(int64_t pair) { return Even(pair) + slice; }
  };

  /// Integers are rounded, where a window weighs them, and held to what cannot overflow.
  static void Convert(const float* from, float scale, int64_t count, Value* to) {
    if constexpr (std::is_same_v<Value, float>) {
      internal::Scale(scale, from, count, to);
    } else {
      constexpr auto kMost = static_cast<float>(kMostInteger);
      for (int64_t i = 0; i < count; ++i) {
        const float held = std::min(std::max(-kMost, from[i]), kMost);
        to[i] = static_cast<Value>(held < 0 ? held - 0.5F : held + 0.5F);
      }
    }
  }

  /// One lifting step along z, of pair i.
  void LiftSlices(int step, int64_t i, Slab* slab) const {
    const bool is_even = step % 2 == 0;
    const int64_t end = is_even && !Scheme::kPairs ? slab->end : slab->odd_end;
    if (i < slab->begin || i >= end || slab->odd_end <= slab->begin) {
      return;
    }
    const Value* before = is_even ? slab->Odd(std::max(i - 1, slab->begin)) : slab->Even(i);
    const Value* after = is_even ? slab->Odd(std::min(i, slab->odd_end - 1))
                                 : slab->Even(std::min(i + 1, slab->end - 1));
    schemes_[2].Lift(step, is_even ? slab->Even(i) : slab->Odd(i), before, after, slab->slice);
  }

  void CopyOut(const Value* slice, int64_t z, Grid* child) const {
    const Box3 part = Intersect(child->box, children_);
    for (int64_t y = part.lo.y; y < part.hi.y; ++y) {
      const Value* from =
          slice + (y - children_.lo.y) * children_.Size().x + part.lo.x - children_.lo.x;
      std::copy_n(from, part.hi.x - part.lo.x, child->Row(y, z) + part.lo.x - child->box.lo.x);
    }
  }

  /// `count` values of one sub-band at (.., py, pz), scaled, from the region's first on; false,
  /// and zeros, if there are none.
  bool LoadRow(int band, int64_t py, int64_t pz, int64_t count, Value* out) const {
    const float scale = scales_[band];
    if (band == 0) {
      Convert(level_.parent.Row(py, pz) + parents_.lo.x - level_.parent.box.lo.x, scale, count,
              out);
      return true;
    }
    const Box3& window = level_.window;
    const int64_t first = std::max<int64_t>(window.lo.x - parents_.lo.x, 0);
    const int64_t last = std::min(window.hi.x - parents_.lo.x, count);
    if (!window.Contains(Int3{window.lo.x, py, pz}) || last <= first) {
      std::fill_n(out, count, Value{0});
      return false;
    }
    const Int3 size = window.Size();
    std::fill(out, out + first, Value{0});
    Convert(level_.detail.data() + (band - 1) * size.Product() +
                ((pz - window.lo.z) * size.y + py - window.lo.y) * size.x + parents_.lo.x + first -
                window.lo.x,
            scale, last - first, out + first);
    std::fill(out + last, out + count, Value{0});
    return true;
  }

  /// The slice of children that slice pz of four sub-bands gives (band_z: 0 low, 4 high in z).
  void FillSlice(int64_t pz, int band_z, Value* slice, Slab* slab) const {
    const Int3 size = children_.Size();
    Value* const low = slab->low.data() + 1;
    Value* const high = slab->high.data() + 1;
    const auto [evens, odds] = lengths_[0];
    bool any = false;
    for (int64_t y = 0; y < size.y; ++y) {
      const int64_t py = parents_.lo.y + y / 2;
      const int band = band_z + static_cast<int>(2 * (y % 2));
      Value* const row = slice + y * size.x;
      const bool has_low = LoadRow(band, py, pz, evens, low);
      const bool has_high = LoadRow(band + 1, py, pz, odds, high);
      if (!has_low && !has_high) {
        std::fill_n(row, size.x, Value{0});
        continue;
      }
      any = true;
      LiftRow(schemes_[0], lengths_[0], low, high);
      internal::Interleave(low, high, odds, row);
      if (evens > odds) {
        row[size.x - 1] = low[odds];
      }
    }
    if (any) {
      LiftLines(schemes_[1], lengths_[1], size.x, size.x, slice);
    }
  }

  const std::array<Scheme, 3>& schemes_;
  const Level& level_;
  const Box3 parents_;
  Box3 children_;  // of the parents
  std::array<LineLength, 3> lengths_;
  std::array<float, 8> scales_;
};

template <typename Scheme>
void InvertRegion(const std::array<Scheme, 3>& schemes, Wavelet wavelet, const Level& level,
                  const Int3& child_dims, int threads, Grid* child) {
  const Box3 inside = Intersect(child->box, Box3::OfSize(child_dims));
  const Box3 parents = Intersect(ParentsOf(wavelet, inside, child_dims), level.parent.box);
  const RegionInverse<Scheme> inverse(schemes, level, parents, child_dims);
  // One slab a thread: what lies on both sides of a cut is computed twice.
  const int64_t height = inside.Size().z;
  const int64_t workers = threads > 0 ? threads : HardwareThreads();
  const int64_t slab = std::max<int64_t>((height + workers - 1) / workers, kLeastSlab);
  ParallelFor(inside.lo.z, inside.hi.z, slab, threads,
              [&](int64_t first, int64_t last) { inverse.FillSlab(first, last, child); });
  RepeatBorder(inside, child);
}

}  // namespace

Box3 ParentsOf(Wavelet wavelet, const Box3& children, const Int3& child_dims) {
  const int64_t halo = wavelet == Wavelet::kHaar    ? 0
                       : wavelet == Wavelet::kCdf53 ? internal::Cdf53::kHalo
                                                    : internal::Cdf97::kHalo;
  const Box3 needed = Intersect(children.Grown(halo), Box3::OfSize(child_dims));
  return {{needed.lo.x >> 1, needed.lo.y >> 1, needed.lo.z >> 1},
          {(needed.hi.x + 1) >> 1, (needed.hi.y + 1) >> 1, (needed.hi.z + 1) >> 1}};
}

void InverseLevel(const Basis& basis, int level, const Grid& parent, const Box3& window,
                  std::span<const float> detail, const Int3& child_dims, int threads, Grid* child) {
  const Level input{parent, window, detail};
  if (basis.integer) {
    if (basis.wavelet == Wavelet::kHaar) {
      InvertRegion(internal::ByAxis<internal::IntegerHaar>(level), basis.wavelet, input, child_dims,
                   threads, child);
    } else {
      InvertRegion(internal::ByAxis<internal::IntegerCdf53>(level), basis.wavelet, input,
                   child_dims, threads, child);
    }
    return;
  }
  switch (basis.wavelet) {
    case Wavelet::kHaar:
      InverseHaarLevel(parent, window, detail, child_dims, threads, child);
      return;
    case Wavelet::kCdf53:
      InvertRegion(std::array<internal::Cdf53, 3>{}, basis.wavelet, input, child_dims, threads,
                   child);
      return;
    case Wavelet::kCdf97:
      InvertRegion(std::array<internal::Cdf97, 3>{}, basis.wavelet, input, child_dims, threads,
                   child);
      return;
  }
}

}  // namespace fovea::wavelet
