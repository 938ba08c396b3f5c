#include "engine/render/warp.h"

#include <algorithm>
#include <functional>

#include "engine/base/parallel.h"
#include "engine/render/rgba_vector.h"
#include "engine/render/smooth_sample.h"
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

/// How much of a point lies within reach of the sheet's pixels, which end between pixel centres:
/// 1 inside, falling to 0 over the voxel around its edge.
float CoverOf(const Rect& sheet, double at_u, double at_v) {
  const double u =
      std::min(at_u - static_cast<double>(sheet.u0), static_cast<double>(sheet.u1) - at_u);
  const double v =
      std::min(at_v - static_cast<double>(sheet.v0), static_cast<double>(sheet.v1) - at_v);
  return static_cast<float>(std::clamp(u + 0.5, 0.0, 1.0) * std::clamp(v + 0.5, 0.0, 1.0));
}

/// One level of the smoothed picture along a row.
class SmoothLine {
 public:
  SmoothLine() = default;
  SmoothLine(const SmoothLevel& level, const SheetLine& line, const Columns& columns)
      : level_(&level) {
    const double border = SmoothLevel::kBorder;
    const double to_tap = TapOrigin(level.basis) - border;
    line_ = FixedLine(line, columns.begin, static_cast<double>(level.width),
                      static_cast<double>(level.rect.u0) + to_tap,
                      static_cast<double>(level.rect.v0) + to_tap);
  }

  /// Whether the level has the taps of all these columns.
  [[nodiscard]] bool Holds(const Columns& columns) const {
    const int64_t rows = level_->rect.Height() + 2 * SmoothLevel::kBorder;
    return line_.StaysWithin(columns, 1, level_->stride - 1, rows - 1);
  }

  [[nodiscard]] bool IsVoxelWide() const { return level_->width == 1; }

  /// The level's weighted value at a column, and its weight. Whether it has any.
  bool Sample(int64_t column, RgbaVector* weighted, float* weight) const {
    const FixedLine::Point p = line_.At(column);
    return SmoothSampler(*level_).At(static_cast<size_t>(p.v * level_->stride + p.u), p.fu, p.fv,
                                     weighted, weight);
  }

 private:
  const SmoothLevel* level_ = nullptr;
  FixedLine line_;
};

/// One row of the smoothed picture.
class SmoothRow {
 public:
  SmoothRow(const std::vector<SmoothLevel>& levels, const Rect& sheet, const SheetLine& line)
      : sheet_(sheet), line_(line) {
    const Columns drawn = line.Within(sheet, 1, 0.5);
    for (const SmoothLevel& level : levels) {
      // How far a level has weight beyond its edge.
      const auto width = static_cast<double>(level.width);
      const double reach = level.basis == Basis::kBilinear ? width / 2 : width;
      const Columns& coarser = count_ > 0 ? columns_[count_ - 1] : drawn;
      columns_[count_] = Intersect(coarser, line.Within(level.rect, width, reach));
      lines_[count_] = SmoothLine(level, line, columns_[count_]);
      if (!lines_[count_].Holds(columns_[count_])) {
        columns_[count_] = {};
      }
      ++count_;
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
        RgbaVector weighted;
        float weight;
        if (lines_[l].Sample(i, &weighted, &weight)) {
          // Between pixels one voxel wide the sheet's edge fades by itself.
          value += (!kEdge || lines_[l].IsVoxelWide() ? left : left * cover) * weighted;
          left *= 1 - weight;
        }
      }
      Store(value, row + 4 * i);
    }
  }

  const Rect& sheet_;
  const SheetLine& line_;
  std::array<Columns, kMostFrameLevels> columns_;
  std::array<SmoothLine, kMostFrameLevels> lines_;
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
    voxels_ = FixedLine(line, columns_[0].begin, 1, static_cast<double>(sheet.u0) + 0.5,
                        static_cast<double>(sheet.v0) + 0.5);
    if (!voxels_.StaysWithin(columns_[0], -16, sheet.Width() + 16, sheet.Height() + 16)) {
      columns_ = {};
    }
  }

  void Draw(float* row) const {
    ForSegments(line_, sheet_, columns_, count_, [&](const Segment& segment) {
      if (segment.finest < 0) {
        Clear(segment.columns, row);
        return;
      }
      DrawSegment(segment, row);
    });
  }

 private:
  void DrawSegment(const Segment& segment, float* row) const {
    RgbaVector taps[4] = {};
    int64_t last_u = 0;
    int64_t last_v = 0;
    for (int64_t i = segment.columns.begin; i < segment.columns.end; ++i) {
      const FixedLine::Point p = voxels_.At(i);
      // Several pixels of the picture often lie between the same four.
      if (i == segment.columns.begin || p.u != last_u || p.v != last_v) {
        last_u = p.u;
        last_v = p.v;
        FindTaps(p.u + sheet_.u0, p.v + sheet_.v0, segment.finest, taps);
      }
      Store(Mix(Mix(taps[0], taps[1], p.fu), Mix(taps[2], taps[3], p.fu), p.fv), row + 4 * i);
    }
  }

  void FindTaps(int64_t u, int64_t v, int finest, RgbaVector* taps) const {
    const FrameLevel& level = levels_[finest];
    if (level.width == 1 && level.rect.Contains(u, v) && level.rect.Contains(u + 1, v + 1)) {
      const size_t at = level.Index(u, v);
      const PixelKind* kinds = &level.kinds[at];
      const int64_t below = level.rect.Width();
      if (kinds[0] == PixelKind::kLeaf && kinds[1] == PixelKind::kLeaf &&
          kinds[below] == PixelKind::kLeaf && kinds[below + 1] == PixelKind::kLeaf) {
        taps[0] = Load(level.values[at]);
        taps[1] = Load(level.values[at + 1]);
        taps[2] = Load(level.values[at + below]);
        taps[3] = Load(level.values[at + below + 1]);
        return;
      }
    }
    for (int tap = 0; tap < 4; ++tap) {
      taps[tap] = LeafAt(u + (tap & 1), v + (tap >> 1), finest);
    }
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
