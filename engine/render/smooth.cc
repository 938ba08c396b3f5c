#include "engine/render/smooth.h"

#include <algorithm>
#include <array>
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

void TakeShape(const FrameLevel& from, SmoothLevel* to) {
  constexpr int64_t kBorders = 2 * SmoothLevel::kBorder;
  to->width = from.width;
  to->rect = from.rect;
  to->stride = from.rect.Width() + kBorders;
  const auto pixels = static_cast<size_t>(to->stride * (from.rect.Height() + kBorders));
  to->values.resize(pixels);
  to->weighted.resize(pixels);
  to->presence.resize(pixels);
  to->halves.resize(pixels);
  to->cells.resize(pixels);
}

/// A child whose ray leaves through a side of the volume does not speak for a pixel that has
/// others crossing from face to face: it would draw the volume's edge into the middle of the pixel.
RgbaVector MeanOfChildren(const SmoothLevel& finer, const Rect& crossing, int64_t u, int64_t v) {
  std::array<bool, 4> speaks{};
  for (int i = 0; i < 4; ++i) {
    speaks[i] = crossing.Contains(2 * u + (i & 1), 2 * v + (i >> 1));
  }
  if (speaks == std::array<bool, 4>{}) {
    speaks.fill(true);
  }
  const Rgba* first = &finer.values[finer.Index(2 * u, 2 * v)];
  const std::array<const Rgba*, 4> children = {first, first + 1, first + finer.stride,
                                               first + finer.stride + 1};
  RgbaVector sum = {};
  float count = 0;
  for (int i = 0; i < 4; ++i) {
    if (speaks[i]) {
      sum += Load(*children[i]);
      count += 1;
    }
  }
  return sum / count;
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
}

/// Calls `copy(to, from)` for every pixel of the border, `from` being the pixel of rect next to it
/// where the volume ends in that direction, and -1 where a coarser level goes on.
template <typename Copy>
void ForBorder(const FrameLevel& level, const SmoothLevel& smooth, const Copy& copy) {
  constexpr int64_t kBorder = SmoothLevel::kBorder;
  const Rect& rect = level.rect;
  for (int64_t v = rect.v0 - kBorder; v < rect.v1 + kBorder; ++v) {
    const bool beside = v >= rect.v0 && v < rect.v1;
    const bool ends_v = beside || (v < rect.v0 ? level.void_v0 : level.void_v1);
    for (int64_t u = rect.u0 - kBorder; u < rect.u1 + kBorder; ++u) {
      if (beside && u == rect.u0) {
        u = rect.u1;  // over the inside
      }
      const bool ends_u =
          (u >= rect.u0 && u < rect.u1) || (u < rect.u0 ? level.void_u0 : level.void_u1);
      const size_t nearest =
          smooth.Index(std::clamp(u, rect.u0, rect.u1 - 1), std::clamp(v, rect.v0, rect.v1 - 1));
      copy(smooth.Index(u, v), ends_u && ends_v ? static_cast<int64_t>(nearest) : -1);
    }
  }
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
  float scale = 1;
  for (int i = 0; i < 4; ++i) {
    const float change = std::abs(step[i]);
    if (change > 0.5F * own[i]) {
      scale = std::min(scale, 0.5F * own[i] / change);
    }
  }
  return own + scale * step;
}

/// What is missing for the interpolant to have the pixel's own mean over the pixel, by one step
/// towards the inverse: the mean of an interpolant of means is 3/4 of its own and 1/8 of each
/// neighbour's, on either axis.
class MeanDefect {
 public:
  MeanDefect(const FrameLevel& level, const SmoothLevel& smooth) : level_(level), smooth_(smooth) {}

  [[nodiscard]] RgbaVector At(int64_t u, int64_t v) const {
    return SeesAllAlike(u, v) ? Whole(smooth_.Index(u, v)) : Partial(u, v);
  }

 private:
  static constexpr float kOwn = 0.75F;
  static constexpr float kOther = 0.125F;

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
      return kOwn * Load(p[0]) + kOther * (Load(p[-1]) + Load(p[1]));
    };
    return Load(smooth_.values[at]) -
           (kOwn * line(at) + kOther * (line(at - stride) + line(at + stride)));
  }

  [[nodiscard]] RgbaVector Partial(int64_t u, int64_t v) const {
    constexpr float kShare[3] = {kOther, kOwn, kOther};
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
            kShare[tap % 3] * kShare[tap / 3] * (own - Load(smooth_.values[smooth_.Index(nu, nv)]));
      }
    }
    return defect;
  }

  const FrameLevel& level_;
  const SmoothLevel& smooth_;
};

/// Values whose interpolant nearly keeps each pixel's mean, times their weights. Pixels one voxel
/// wide stay as they are.
void WeightedRow(const FrameLevel& level, int64_t v, SmoothLevel* smooth) {
  const MeanDefect defect(level, *smooth);
  for (int64_t u = level.rect.u0; u < level.rect.u1; ++u) {
    const size_t at = smooth->Index(u, v);
    RgbaVector value = Load(smooth->values[at]);
    if (level.width > 1 && smooth->presence[at] != 0) {
      value = Sharpened(value, defect.At(u, v));
    }
    Store(0.5F * static_cast<float>(smooth->halves[at]) * value, &smooth->weighted[at]);
  }
}

/// Row number `row`, counted from the first of the border.
void ClassifyCells(int64_t row, SmoothLevel* smooth) {
  const auto stride = static_cast<size_t>(smooth->stride);
  const uint8_t* halves = &smooth->halves[static_cast<size_t>(row) * stride];
  CellKind* cells = &smooth->cells[static_cast<size_t>(row) * stride];
  for (size_t i = 0; i + 1 < stride; ++i) {
    const int sum = halves[i] + halves[i + 1] + halves[i + stride] + halves[i + stride + 1];
    cells[i] = sum == 0 ? CellKind::kNone : sum == 8 ? CellKind::kFull : CellKind::kMixed;
  }
}

void SmoothOne(const FrameLevel& level, const FrameLevel* finer, const SmoothLevel* finer_smooth,
               int threads, SmoothLevel* smooth) {
  TakeShape(level, smooth);
  const auto each_row = [&](int64_t begin, int64_t end, const auto& work) {
    const auto rows = [&work](int64_t first, int64_t last) {
      for (int64_t v = first; v < last; ++v) {
        work(v);
      }
    };
    ParallelFor(begin, end, RowsInPiece(level.rect), threads, std::ref(rows));
  };
  const Rect& rect = level.rect;
  each_row(rect.v0, rect.v1, [&](int64_t v) { FillRow(level, finer, finer_smooth, v, smooth); });
  ForBorder(level, *smooth, [smooth](size_t to, int64_t from) {
    smooth->presence[to] = from < 0 ? 0 : smooth->presence[from];
  });
  each_row(rect.v0, rect.v1, [&](int64_t v) {
    WeighRow(v, smooth);
    WeightedRow(level, v, smooth);
  });
  ForBorder(level, *smooth, [smooth](size_t to, int64_t from) {
    smooth->halves[to] = from < 0 ? 0 : smooth->halves[from];
    smooth->weighted[to] = from < 0 || smooth->width == 1 ? Rgba{} : smooth->weighted[from];
  });
  constexpr int64_t kBorders = 2 * SmoothLevel::kBorder;
  each_row(0, rect.Height() + kBorders - 1, [smooth](int64_t row) { ClassifyCells(row, smooth); });
}

}  // namespace

void Smooth(const std::vector<FrameLevel>& frame, int threads, std::vector<SmoothLevel>* levels) {
  levels->resize(frame.size());
  for (size_t l = frame.size(); l-- > 0;) {
    const bool has_finer = l + 1 < frame.size();
    SmoothOne(frame[l], has_finer ? &frame[l + 1] : nullptr,
              has_finer ? &(*levels)[l + 1] : nullptr, threads, &(*levels)[l]);
  }
}

}  // namespace fovea::render
