#include "engine/render/combine.h"

#include <algorithm>
#include <functional>

#include "engine/base/parallel.h"
#include "engine/render/combine_kernels.h"
#include "engine/render/path_lengths.h"

namespace fovea::render {
namespace {

/// Rows in a piece of work: small levels are not worth waking threads for.
int64_t RowsInPiece(const Rect& rect) {
  constexpr int64_t kPixels = 16384;
  return std::max<int64_t>(4, kPixels / rect.Width() & ~int64_t{1});
}

GatheredRun RunOf(Gathered* gathered, size_t at) {
  return {gathered->red.data() + at, gathered->green.data() + at, gathered->blue.data() + at,
          gathered->transmittance.data() + at, gathered->depth.data() + at};
}

/// The densities of one accumulator over a rectangle, with a border of zeros one pixel wide.
class DensityPlanes {
 public:
  /// `from` has room for FloatsFor(rect).
  DensityPlanes(float* from, const Rect& rect) : rect_(rect), stride_(StrideFor(rect)) {
    const int64_t plane = stride_ * (rect.Height() + 2);
    float* at = from + stride_ + 1;  // of pixel (u0, v0), past the border
    origin_ = {at, at + plane, at + 2 * plane, at + 3 * plane, at + 4 * plane};
    for (int channel = 0; channel < 5; ++channel) {
      std::fill_n(from + channel * plane, stride_, 0.0F);
      std::fill_n(from + (channel + 1) * plane - stride_, stride_, 0.0F);
    }
  }

  [[nodiscard]] static size_t FloatsFor(const Rect& rect) {
    return static_cast<size_t>(5 * StrideFor(rect) * (rect.Height() + 2));
  }

  /// From pixel (u, v) on.
  [[nodiscard]] DensityRun At(int64_t u, int64_t v) const {
    const int64_t at = (v - rect_.v0) * stride_ + u - rect_.u0;
    return {origin_.tau + at, origin_.red + at, origin_.green + at, origin_.blue + at,
            origin_.share + at};
  }

  /// Row v, its border included, from what the layer gathered there.
  void FillRow(Gathered* gathered, const Layer& layer, int64_t v) const {
    const DensityRun row = At(rect_.u0, v);
    const auto count = static_cast<size_t>(rect_.Width());
    for (float* plane : {row.tau, row.red, row.green, row.blue, row.share}) {
      plane[-1] = 0;
      std::fill(plane + count, plane + stride_ - 1, 0.0F);
    }
    const size_t at = layer.Index(rect_.u0, v);
    FindDensities(RunOf(gathered, at), &layer.split[at], count, row);
  }

 private:
  static int64_t StrideFor(const Rect& rect) {
    return rect.Width() + 2 + static_cast<int64_t>(kDensitySlack);
  }

  Rect rect_;
  int64_t stride_;
  DensityRun origin_{};
};

/// Passes what `coarser` has gathered down to `finer`.
class Splitting {
 public:
  Splitting(Layer* coarser, Layer* finer, bool smooth, std::vector<float>* buffer)
      : coarser_(*coarser),
        finer_(*finer),
        smooth_(smooth),
        parents_({finer->plan.rect.u0 / 2, finer->plan.rect.u1 / 2, finer->plan.rect.v0 / 2,
                  finer->plan.rect.v1 / 2}),
        front_(Room(parents_, buffer), parents_),
        back_(buffer->data() + DensityPlanes::FloatsFor(parents_), parents_) {}

  /// Before any row is passed down.
  void FindAllDensities(int threads) const {
    if (!smooth_) {
      return;
    }
    const auto fill = [this](int64_t first, int64_t last) {
      for (int64_t v = first; v < last; ++v) {
        front_.FillRow(&coarser_.front, coarser_, v);
        back_.FillRow(&coarser_.back, coarser_, v);
      }
    };
    ParallelFor(parents_.v0, parents_.v1, RowsInPiece(parents_), threads, std::ref(fill));
  }

  /// Row v of the finer level.
  void PassRow(int64_t v) const {
    Inheritance inherited;
    const int64_t step = static_cast<int64_t>(kParentBlock);
    for (int64_t u = parents_.u0; u < parents_.u1; u += step) {
      const auto count = static_cast<size_t>(std::min(step, parents_.u1 - u));
      const size_t own = finer_.Index(2 * u, v);
      Inherit(front_, &coarser_.front, u, v, count, &inherited);
      TakeOwnPaths(u, v, count, &inherited);
      CompositeBefore(inherited, 2 * count, RunOf(&finer_.front, own));
      Inherit(back_, &coarser_.back, u, v, count, &inherited);
      TakeOwnPaths(u, v, count, &inherited);
      CompositeBehind(inherited, 2 * count, RunOf(&finer_.back, own));
    }
  }

 private:
  static float* Room(const Rect& rect, std::vector<float>* buffer) {
    const size_t floats = 2 * DensityPlanes::FloatsFor(rect);
    buffer->resize(std::max(buffer->size(), floats));
    return buffer->data();
  }

  void Inherit(const DensityPlanes& densities, Gathered* gathered, int64_t u, int64_t v,
               size_t count, Inheritance* inherited) const {
    const int64_t parent = v >> 1;
    const size_t at = coarser_.Index(u, parent);
    if (smooth_) {
      const int64_t towards = (v & 1) != 0 ? parent + 1 : parent - 1;
      InheritSmoothly(densities.At(u, parent), densities.At(u, towards), &gathered->depth[at],
                      &coarser_.split[at], count, inherited);
    } else {
      InheritCopies(RunOf(gathered, at), &coarser_.split[at], count, inherited);
    }
  }

  /// In perspective a child's ray runs otherwise than its parent's, and its path through the same
  /// slices has another length.
  void TakeOwnPaths(int64_t u, int64_t v, size_t count, Inheritance* inherited) const {
    if (!coarser_.path.empty()) {
      LengthenInherited(&coarser_.path[coarser_.Index(u, v >> 1)],
                        &finer_.path[finer_.Index(2 * u, v)], count, inherited);
    }
  }

  Layer& coarser_;
  Layer& finer_;
  bool smooth_;
  Rect parents_;  // the finer level's rectangle, in the coarser one's pixels
  DensityPlanes front_, back_;
};

/// Row v as the frame shows it. `coarser` is null for level 0.
void ShowRow(Layer* layer, const Layer* coarser, int64_t v, FrameLevel* level) {
  const Rect& rect = level->rect;
  const size_t at = level->Index(rect.u0, v);
  PixelKind* kinds = &level->kinds[at];
  const uint8_t* split = &layer->split[at];
  const auto count = static_cast<size_t>(rect.Width());
  // The rectangle is made of whole parents.
  const uint8_t* parents =
      coarser != nullptr ? &coarser->split[coarser->Index(rect.u0 >> 1, v >> 1)] : nullptr;
  for (size_t i = 0; i < count; ++i) {
    const bool present = parents == nullptr || parents[i >> 1] != 0;
    kinds[i] = split[i] != 0 ? PixelKind::kSplit : present ? PixelKind::kLeaf : PixelKind::kAbsent;
  }
  ShowLeaves(RunOf(&layer->front, at), RunOf(&layer->back, at), kinds, count, &level->values[at]);
  if (!layer->path.empty()) {
    TakeCommonPath(&layer->path[at], count, &level->values[at]);
  }
}

void TakeShape(const LevelPlan& plan, FrameLevel* level) {
  level->width = plan.width;
  level->rect = plan.rect;
  level->void_u0 = plan.void_u0;
  level->void_u1 = plan.void_u1;
  level->void_v0 = plan.void_v0;
  level->void_v1 = plan.void_v1;
  level->crossing = plan.crossing;
  const auto pixels = static_cast<size_t>(plan.rect.Width() * plan.rect.Height());
  level->kinds.resize(pixels);
  level->values.resize(pixels);
}

}  // namespace

void Combine(bool smooth_splitting, int threads, std::vector<Layer>* layers,
             CombineScratch* scratch, std::vector<FrameLevel>* levels) {
  levels->resize(layers->size());
  for (size_t l = 0; l < layers->size(); ++l) {
    Layer* own = &(*layers)[l];
    Layer* coarser = l > 0 ? &(*layers)[l - 1] : nullptr;
    FrameLevel* level = &(*levels)[l];
    TakeShape(own->plan, level);
    const auto work = [&](const Splitting* splitting) {
      const auto rows = [&](int64_t first, int64_t last) {
        for (int64_t v = first; v < last; ++v) {
          if (splitting != nullptr) {
            splitting->PassRow(v);
          }
          ShowRow(own, coarser, v, level);
        }
      };
      ParallelFor(level->rect.v0, level->rect.v1, RowsInPiece(level->rect), threads,
                  std::ref(rows));
    };
    if (coarser == nullptr) {
      work(nullptr);
    } else {
      const Splitting splitting(coarser, own, smooth_splitting, &scratch->densities);
      splitting.FindAllDensities(threads);
      work(&splitting);
    }
  }
}

}  // namespace fovea::render
