#include "engine/render/smooth.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include "engine/base/parallel.h"
#include "engine/render/rgba_vector.h"

namespace fovea::render {
namespace {

/// Rows in a piece of work: small levels are not worth waking threads for.
int64_t RowsInPiece(const Rect& rect) {
  constexpr int64_t kPixels = 16384;
  return std::max<int64_t>(4, kPixels / rect.Width());
}

void TakeShape(const FrameLevel& from, Basis basis, SmoothLevel* to) {
  constexpr int64_t kBorders = 2 * SmoothLevel::kBorder;
  to->width = from.width;
  to->rect = from.rect;
  to->basis = from.width > 1 ? basis : Basis::kBilinear;
  to->stride = from.rect.Width() + kBorders;
  const auto pixels = static_cast<size_t>(to->stride * (from.rect.Height() + kBorders));
  to->values.resize(pixels);
  to->presence.resize(pixels);
  to->weighted.resize(pixels);
  to->halves.resize(pixels);
  to->cells.resize(pixels);
}

/// Fills a row's border: with the outermost pixel where `repeat` says so, else with nothing.
template <typename T>
void ExtendRow(const SmoothLevel& level, int64_t v, bool repeat_u0, bool repeat_u1,
               std::vector<T>* plane) {
  T* row = plane->data() + level.Index(level.rect.u0, v);
  const int64_t count = level.rect.Width();
  std::fill_n(row - SmoothLevel::kBorder, SmoothLevel::kBorder, repeat_u0 ? row[0] : T{});
  std::fill_n(row + count, SmoothLevel::kBorder, repeat_u1 ? row[count - 1] : T{});
}

/// The border above and below, once every row has its own.
template <typename T>
void ExtendColumns(const SmoothLevel& level, bool repeat_v0, bool repeat_v1,
                   std::vector<T>* plane) {
  const int64_t stride = level.stride;
  const auto row = [&](int64_t v) {
    return plane->data() + level.Index(level.rect.u0 - SmoothLevel::kBorder, v);
  };
  const auto extend = [&](bool repeat, int64_t from, int64_t to) {
    if (repeat) {
      std::copy_n(row(from), stride, row(to));
    } else {
      std::fill_n(row(to), stride, T{});
    }
  };
  for (int64_t i = 1; i <= SmoothLevel::kBorder; ++i) {
    extend(repeat_v0, level.rect.v0, level.rect.v0 - i);
    extend(repeat_v1, level.rect.v1 - 1, level.rect.v1 - 1 + i);
  }
}

/// A child whose ray leaves through a side of the volume does not speak for a pixel that has
/// others crossing from face to face: it would draw the volume's edge into the middle of the pixel.
RgbaVector MeanOfChildren(const SmoothLevel& finer, const Rect& crossing, int64_t u, int64_t v) {
  const Rgba* first = &finer.values[finer.Index(2 * u, 2 * v)];
  const Rgba* below = first + finer.stride;
  if (crossing.Contains(2 * u, 2 * v) && crossing.Contains(2 * u + 1, 2 * v + 1)) {
    return 0.25F * ((Load(first[0]) + Load(first[1])) + (Load(below[0]) + Load(below[1])));
  }
  RgbaVector all = {};
  RgbaVector speaking = {};
  float count = 0;
  for (int i = 0; i < 4; ++i) {
    const RgbaVector child = Load(i < 2 ? first[i] : below[i - 2]);
    all += child;
    if (crossing.Contains(2 * u + (i & 1), 2 * v + (i >> 1))) {
      speaking += child;
      count += 1;
    }
  }
  return count > 0 ? speaking / count : 0.25F * all;
}

/// The values of row v: leaves as they are, split pixels as the mean of their children, absent
/// ones 0.
void FillRow(const FrameLevel& level, const FrameLevel* finer, const SmoothLevel* finer_smooth,
             int64_t v, SmoothLevel* smooth) {
  const Rect& rect = level.rect;
  const size_t from = level.Index(rect.u0, v);
  const size_t to = smooth->Index(rect.u0, v);
  for (int64_t i = 0; i < rect.Width(); ++i) {
    const PixelKind kind = level.kinds[from + i];
    RgbaVector value = {};
    if (kind == PixelKind::kLeaf) {
      value = Load(level.values[from + i]);
    } else if (kind == PixelKind::kSplit) {
      value = MeanOfChildren(*finer_smooth, finer->crossing, rect.u0 + i, v);
    }
    Store(value, &smooth->values[to + i]);
    smooth->presence[to + i] = kind != PixelKind::kAbsent ? 1 : 0;
  }
  ExtendRow(*smooth, v, level.void_u0, level.void_u1, &smooth->presence);
}

/// Pixels from the edge of a level's own take over from the coarser level at half weight, the next
/// ones wholly. Where there is no volume there is no edge.
void WeighRow(int64_t v, SmoothLevel* smooth) {
  const size_t at = smooth->Index(smooth->rect.u0, v);
  const auto stride = static_cast<size_t>(smooth->stride);
  const uint8_t* row = &smooth->presence[at];
  uint8_t* halves = &smooth->halves[at];
  for (int64_t i = 0; i < smooth->rect.Width(); ++i) {
    uint8_t around = 1;
    for (const uint8_t* line : {row - stride, row, row + stride}) {
      around &= line[i - 1] & line[i] & line[i + 1];
    }
    halves[i] = static_cast<uint8_t>(row[i] + (row[i] & around));
  }
}

/// At a sharp edge the step towards the inverse overshoots. It goes at most as far as half of the
/// value in any channel, in all channels alike, so that the hue stays.
RgbaVector Sharpened(RgbaVector own, RgbaVector step) {
  const RgbaVector most = 0.5F * own;
  float scale = 1;
  if (AnyGreater(Absolute(step), most)) {
    for (int i = 0; i < 4; ++i) {
      const float change = std::abs(step[i]);
      scale = change > most[i] ? std::min(scale, most[i] / change) : scale;
    }
  }
  return own + scale * step;
}

/// The step that brings the interpolant's mean over a pixel towards the pixel's own. On either axis
/// the mean of an interpolant of means is 3/4 of its own and 1/8 of each neighbour's (bilinear), or
/// 2/3 and 1/6 (quadratic B-spline), whose longer step makes up for its stronger blur.
class MeanStep {
 public:
  MeanStep(const FrameLevel& level, const SmoothLevel& smooth)
      : level_(level),
        smooth_(smooth),
        other_(smooth.basis == Basis::kBspline ? 1.0F / 6 : 1.0F / 8),
        own_(1 - 2 * other_),
        length_(smooth.basis == Basis::kBspline ? 1.5F : 1.0F) {}

  [[nodiscard]] RgbaVector At(int64_t u, int64_t v) const {
    return length_ * (SeesAllAlike(u, v) ? Whole(smooth_.Index(u, v)) : Partial(u, v));
  }

 private:
  /// Whether all neighbours count.
  [[nodiscard]] bool SeesAllAlike(int64_t u, int64_t v) const {
    const Rect& rect = level_.rect;
    const Rect& crossing = level_.crossing;
    return smooth_.halves[smooth_.Index(u, v)] == 2 && u > rect.u0 && u + 1 < rect.u1 &&
           v > rect.v0 && v + 1 < rect.v1 &&
           (!crossing.Contains(u, v) ||
            (crossing.Contains(u - 1, v - 1) && crossing.Contains(u + 1, v + 1)));
  }

  [[nodiscard]] RgbaVector Whole(size_t at) const {
    const auto stride = static_cast<size_t>(smooth_.stride);
    const auto line = [this](size_t middle) {
      const Rgba* p = &smooth_.values[middle];
      return own_ * Load(p[0]) + other_ * (Load(p[-1]) + Load(p[1]));
    };
    return Load(smooth_.values[at]) -
           (own_ * line(at) + other_ * (line(at - stride) + line(at + stride)));
  }

  [[nodiscard]] RgbaVector Partial(int64_t u, int64_t v) const {
    const float share[3] = {other_, own_, other_};
    const RgbaVector own = Load(smooth_.values[smooth_.Index(u, v)]);
    const bool crosses = level_.crossing.Contains(u, v);
    RgbaVector defect = {};
    for (int tap = 0; tap < 9; ++tap) {
      const int64_t nu = u + tap % 3 - 1;
      const int64_t nv = v + tap / 3 - 1;
      // A neighbour across the volume's edge would draw the edge into this pixel.
      if (level_.rect.Contains(nu, nv) && smooth_.presence[smooth_.Index(nu, nv)] != 0 &&
          (!crosses || level_.crossing.Contains(nu, nv))) {
        defect +=
            share[tap % 3] * share[tap / 3] * (own - Load(smooth_.values[smooth_.Index(nu, nv)]));
      }
    }
    return defect;
  }

  const FrameLevel& level_;
  const SmoothLevel& smooth_;
  float other_, own_, length_;
};

/// Values whose interpolant nearly keeps each pixel's mean, times their weights. Pixels one voxel
/// wide stay as they are.
void WeightedRow(const FrameLevel& level, int64_t v, SmoothLevel* smooth) {
  const MeanStep step(level, *smooth);
  for (int64_t u = level.rect.u0; u < level.rect.u1; ++u) {
    const size_t at = smooth->Index(u, v);
    RgbaVector value = Load(smooth->values[at]);
    if (level.width > 1 && smooth->presence[at] != 0) {
      value = Sharpened(value, step.At(u, v));
    }
    Store(0.5F * static_cast<float>(smooth->halves[at]) * value, &smooth->weighted[at]);
  }
}

void ClassifyRow(int64_t v, SmoothLevel* smooth) {
  constexpr int64_t kBorder = SmoothLevel::kBorder;
  const auto stride = static_cast<size_t>(smooth->stride);
  const size_t at = smooth->Index(smooth->rect.u0 - kBorder, v);
  const uint8_t* halves = &smooth->halves[at];
  CellKind* cells = &smooth->cells[at];
  if (smooth->basis == Basis::kBilinear) {
    for (size_t i = 0; i + 1 < stride; ++i) {
      const int sum = halves[i] + halves[i + 1] + halves[i + stride] + halves[i + stride + 1];
      cells[i] = sum == 0 ? CellKind::kNone : sum == 8 ? CellKind::kFull : CellKind::kMixed;
    }
    return;
  }
  for (size_t i = 1; i + 1 < stride; ++i) {
    int sum = 0;
    for (const uint8_t* line : {halves + i - stride, halves + i, halves + i + stride}) {
      sum += line[-1] + line[0] + line[1];
    }
    cells[i] = sum == 0 ? CellKind::kNone : sum == 18 ? CellKind::kFull : CellKind::kMixed;
  }
}

void SmoothOne(const FrameLevel& level, const FrameLevel* finer, const SmoothLevel* finer_smooth,
               int threads, SmoothLevel* smooth) {
  const Rect& rect = level.rect;
  const auto each_row = [&](int64_t begin, int64_t end, const auto& work) {
    const auto rows = [&work](int64_t first, int64_t last) {
      for (int64_t v = first; v < last; ++v) {
        work(v);
      }
    };
    ParallelFor(begin, end, RowsInPiece(rect), threads, std::ref(rows));
  };
  each_row(rect.v0, rect.v1, [&](int64_t v) { FillRow(level, finer, finer_smooth, v, smooth); });
  ExtendColumns(*smooth, level.void_v0, level.void_v1, &smooth->presence);
  // Beyond the volume, pixels one voxel wide end in transparency.
  const bool wide = level.width > 1;
  each_row(rect.v0, rect.v1, [&](int64_t v) {
    WeighRow(v, smooth);
    ExtendRow(*smooth, v, level.void_u0, level.void_u1, &smooth->halves);
    WeightedRow(level, v, smooth);
    ExtendRow(*smooth, v, wide && level.void_u0, wide && level.void_u1, &smooth->weighted);
  });
  ExtendColumns(*smooth, level.void_v0, level.void_v1, &smooth->halves);
  ExtendColumns(*smooth, wide && level.void_v0, wide && level.void_v1, &smooth->weighted);
  constexpr int64_t kReach = SmoothLevel::kBorder - 1;
  each_row(rect.v0 - kReach, rect.v1 + kReach, [smooth](int64_t v) { ClassifyRow(v, smooth); });
}

}  // namespace

void Smooth(const std::vector<FrameLevel>& frame, Basis basis, int threads,
            std::vector<SmoothLevel>* levels) {
  levels->resize(frame.size());
  for (size_t l = frame.size(); l-- > 0;) {
    const bool has_finer = l + 1 < frame.size();
    TakeShape(frame[l], basis, &(*levels)[l]);
    SmoothOne(frame[l], has_finer ? &frame[l + 1] : nullptr,
              has_finer ? &(*levels)[l + 1] : nullptr, threads, &(*levels)[l]);
  }
}

}  // namespace fovea::render
