#include "engine/render/warp.h"

#include <algorithm>
#include <functional>

#include "engine/base/parallel.h"
#include "engine/render/rgba_vector.h"
#include "engine/render/warp_line.h"

namespace fovea::render {
namespace {

constexpr int64_t kRowsInPiece = 16;

/// Columns of a row over which the finest level that can matter is the same.
struct Segment {
  Columns columns;
  int finest = -1;   // -1: nothing is drawn
  bool edge = true;  // whether a column may be less than half a voxel inside the sheet's edge
};

/// Cuts the row into segments. `levels[l]` is where level l has weight; these intervals nest.
template <typename Work>
void ForSegments(const SheetLine& line, const Rect& sheet,
                 const std::array<Columns, kMostFrameLevels>& levels, int count, const Work& work) {
  const Columns inner = line.Within(sheet, 1, -0.5);
  int64_t at = 0;
  while (at < line.width) {
    Segment segment;
    segment.columns = {at, line.width};
    for (int l = 0; l < count; ++l) {
      if (levels[l].Contains(at)) {
        segment.finest = l;
        segment.columns.end = std::min(segment.columns.end, levels[l].end);
      } else if (levels[l].begin > at && levels[l].begin < levels[l].end) {
        segment.columns.end = std::min(segment.columns.end, levels[l].begin);
      }
    }
    segment.edge = !inner.Contains(at);
    const int64_t cut = segment.edge ? inner.begin : inner.end;
    if (cut > at) {
      segment.columns.end = std::min(segment.columns.end, cut);
    }
    work(segment);
    at = segment.columns.end;
  }
}

template <typename Row>
void ForRows(Image* image, int threads, const Row& draw) {
  const auto rows = [&](int64_t first, int64_t last) {
    for (int64_t j = first; j < last; ++j) {
      draw(j, image->rgba.data() + 4 * j * image->width);
    }
  };
  ParallelFor(0, image->height, kRowsInPiece, threads, std::ref(rows));
}

void Clear(const Columns& columns, float* row) {
  std::fill(row + 4 * columns.begin, row + 4 * columns.end, 0.0F);
}

RgbaVector Bilinear(const Rgba* row0, const Rgba* row1, float fu, float fv) {
  return Mix(Mix(Load(row0[0]), Load(row0[1]), fu), Mix(Load(row1[0]), Load(row1[1]), fu), fv);
}

/// How much of a point lies within reach of the sheet's pixels, which end between pixel centres:
/// 1 inside, falling to 0 over the voxel around its edge.
float CoverOf(const Rect& sheet, double at_u, double at_v) {
  const double u =
      std::min(at_u - static_cast<double>(sheet.u0), static_cast<double>(sheet.u1) - at_u);
  const double v =
      std::min(at_v - static_cast<double>(sheet.v0), static_cast<double>(sheet.v1) - at_v);
  return static_cast<float>(std::clamp(u + 0.5, 0.0, 1.0) * std::clamp(v + 0.5, 0.0, 1.0));
}

/// One row of the smoothed picture.
class SmoothRow {
 public:
  SmoothRow(const std::vector<SmoothLevel>& levels, const Rect& sheet, const SheetLine& line)
      : levels_(levels.data()), sheet_(sheet), line_(line) {
    constexpr int64_t kBorder = SmoothLevel::kBorder;
    const Columns drawn = line.Within(sheet, 1, 0.5);
    for (const SmoothLevel& level : levels) {
      // Bilinear interpolation reaches half a pixel beyond a level's edge.
      const auto width = static_cast<double>(level.width);
      const Columns columns = Intersect(drawn, line.Within(level.rect, width, width / 2));
      lines_[count_] =
          FixedLine(line, columns.begin, width, level.rect.u0 - kBorder, level.rect.v0 - kBorder);
      columns_[count_++] = columns;
    }
  }

  void Draw(float* row) const {
    ForSegments(line_, sheet_, columns_, count_, [&](const Segment& segment) {
      if (segment.finest < 0) {
        Clear(segment.columns, row);
      } else if (segment.edge) {
        DrawSegment<true>(segment, row);
      } else {
        DrawSegment<false>(segment, row);
      }
    });
  }

 private:
  template <bool kEdge>
  void DrawSegment(const Segment& segment, float* row) const {
    for (int64_t i = segment.columns.begin; i < segment.columns.end; ++i) {
      float cover = 1;
      if (kEdge) {
        const auto column = static_cast<double>(i);
        cover = CoverOf(sheet_, line_.u + line_.du * column, line_.v + line_.dv * column);
      }
      RgbaVector value = {};
      float left = 1;
      for (int l = segment.finest; l >= 0 && left > 1e-6F; --l) {
        const SmoothLevel& level = levels_[l];
        const FixedLine::Point p = lines_[l].At(i);
        const auto at = static_cast<size_t>(p.v * level.stride + p.u);
        const CellKind cell = level.cells[at];
        if (cell == CellKind::kNone) {
          continue;
        }
        const RgbaVector own =
            Bilinear(&level.weighted[at], &level.weighted[at + level.stride], p.fu, p.fv);
        // Between pixels one voxel wide the sheet's edge fades by itself.
        value += (!kEdge || level.width == 1 ? left : left * cover) * own;
        left *= cell == CellKind::kFull ? 0 : 1 - WeightAt(level, at, p);
      }
      Store(value, row + 4 * i);
    }
  }

  static float WeightAt(const SmoothLevel& level, size_t at, const FixedLine::Point& p) {
    const auto weigh = [&](size_t tap) {
      const auto first = static_cast<float>(level.halves[tap]);
      return first + p.fu * (static_cast<float>(level.halves[tap + 1]) - first);
    };
    const float near = weigh(at);
    return 0.5F * (near + p.fv * (weigh(at + level.stride) - near));
  }

  const SmoothLevel* levels_;
  const Rect& sheet_;
  const SheetLine& line_;
  std::array<Columns, kMostFrameLevels> columns_;
  std::array<FixedLine, kMostFrameLevels> lines_;
  int count_ = 0;
};

/// One row of the picture without smoothing.
class LeafRow {
 public:
  LeafRow(const std::vector<FrameLevel>& levels, const Rect& sheet, const SheetLine& line)
      : levels_(levels.data()), coarsest_width_log2_(0), sheet_(sheet), line_(line) {
    const Columns drawn = line.Within(sheet, 1, 0.5);
    for (const FrameLevel& level : levels) {
      columns_[count_++] =
          Intersect(drawn, line.Within(level.rect, static_cast<double>(level.width), 0.5));
    }
    while ((int64_t{1} << coarsest_width_log2_) < levels.front().width) {
      ++coarsest_width_log2_;
    }
    voxels_ = FixedLine(line, columns_[0].begin, 1, sheet.u0, sheet.v0);
  }

  void Draw(float* row) const {
    ForSegments(line_, sheet_, columns_, count_, [&](const Segment& segment) {
      if (segment.finest < 0) {
        Clear(segment.columns, row);
        return;
      }
      for (int64_t i = segment.columns.begin; i < segment.columns.end; ++i) {
        const FixedLine::Point p = voxels_.At(i);
        Store(Between(p.u + sheet_.u0, p.v + sheet_.v0, p, segment.finest), row + 4 * i);
      }
    });
  }

 private:
  [[nodiscard]] RgbaVector Between(int64_t u, int64_t v, const FixedLine::Point& p,
                                   int finest) const {
    const FrameLevel& level = levels_[finest];
    if (level.width == 1 && level.rect.Contains(u, v) && level.rect.Contains(u + 1, v + 1)) {
      const size_t at = level.Index(u, v);
      const PixelKind* kinds = &level.kinds[at];
      const int64_t below = level.rect.Width();
      if (kinds[0] == PixelKind::kLeaf && kinds[1] == PixelKind::kLeaf &&
          kinds[below] == PixelKind::kLeaf && kinds[below + 1] == PixelKind::kLeaf) {
        return Bilinear(&level.values[at], &level.values[at + below], p.fu, p.fv);
      }
    }
    return Mix(Mix(LeafAt(u, v, finest), LeafAt(u + 1, v, finest), p.fu),
               Mix(LeafAt(u, v + 1, finest), LeafAt(u + 1, v + 1, finest), p.fu), p.fv);
  }

  /// The value of the leaf that the voxel-wide pixel (u, v) lies in.
  [[nodiscard]] RgbaVector LeafAt(int64_t u, int64_t v, int finest) const {
    for (int l = finest; l >= 0 && sheet_.Contains(u, v); --l) {
      const FrameLevel& level = levels_[l];
      const int shift = coarsest_width_log2_ - l;
      const int64_t lu = u >> shift;
      const int64_t lv = v >> shift;
      if (level.rect.Contains(lu, lv) && level.kinds[level.Index(lu, lv)] == PixelKind::kLeaf) {
        return Load(level.values[level.Index(lu, lv)]);
      }
    }
    return RgbaVector{};
  }

  const FrameLevel* levels_;
  int coarsest_width_log2_;  // of level 0's width
  const Rect& sheet_;
  const SheetLine& line_;
  std::array<Columns, kMostFrameLevels> columns_;
  int count_ = 0;
  FixedLine voxels_;
};

}  // namespace

void WarpLeaves(const std::vector<FrameLevel>& levels, const Rect& sheet,
                const std::array<double, 6>& warp, int threads, Image* image) {
  ForRows(image, threads, [&](int64_t j, float* row) {
    const SheetLine line(warp, j, image->width);
    LeafRow(levels, sheet, line).Draw(row);
  });
}

void WarpSmooth(const std::vector<SmoothLevel>& levels, const Rect& sheet,
                const std::array<double, 6>& warp, int threads, Image* image) {
  ForRows(image, threads, [&](int64_t j, float* row) {
    const SheetLine line(warp, j, image->width);
    SmoothRow(levels, sheet, line).Draw(row);
  });
}

}  // namespace fovea::render
