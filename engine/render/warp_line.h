#ifndef ENGINE_RENDER_WARP_LINE_H_
#define ENGINE_RENDER_WARP_LINE_H_

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <utility>

#include "engine/render/sheared_slices.h"

/// A row of the picture as a line through the sheared image: which columns meet what, found once a
/// row, so that nothing is tested at a pixel.
namespace fovea::render {

/// Columns [begin, end) of a row of the picture.
struct Columns {
  int64_t begin = 0, end = 0;
  [[nodiscard]] bool Contains(int64_t i) const { return i >= begin && i < end; }
};

inline Columns Intersect(const Columns& a, const Columns& b) {
  return {std::max(a.begin, b.begin), std::min(a.end, b.end)};
}

/// U = u + du i, V = v + dv i for column i, in sheared coordinates.
struct SheetLine {
  double u = 0, v = 0, du = 0, dv = 0;
  int64_t width = 0;  // columns

  SheetLine(const std::array<double, 6>& m, int64_t row, int64_t columns)
      : u(m[1] * static_cast<double>(row) + m[2]),
        v(m[4] * static_cast<double>(row) + m[5]),
        du(m[0]),
        dv(m[3]),
        width(columns) {}

  /// The columns that lie in `rect`, of pixels `pixel` voxels wide, or at most `margin` voxels
  /// outside it: one interval, as the map is affine.
  [[nodiscard]] Columns Within(const Rect& rect, double pixel, double margin) const {
    return Intersect(Between(u, du, pixel * static_cast<double>(rect.u0) - margin,
                             pixel * static_cast<double>(rect.u1) + margin),
                     Between(v, dv, pixel * static_cast<double>(rect.v0) - margin,
                             pixel * static_cast<double>(rect.v1) + margin));
  }

 private:
  [[nodiscard]] Columns Between(double at, double step, double lo, double hi) const {
    if (step == 0) {
      return at >= lo && at <= hi ? Columns{0, width} : Columns{0, 0};
    }
    double first = (lo - at) / step;
    double last = (hi - at) / step;
    if (step < 0) {
      std::swap(first, last);
    }
    const auto columns = static_cast<double>(width);
    return {static_cast<int64_t>(std::clamp(std::ceil(first), 0.0, columns)),
            static_cast<int64_t>(std::clamp(std::floor(last) + 1, 0.0, columns))};
  }
};

/// Where the columns of a line lie among a level's pixels, in fixed-point numbers of 32 binary
/// places: a tap and its weight cost a shift, and no error builds up along the row.
class FixedLine {
 public:
  /// Whole pixels from the origin, and the rest.
  struct Point {
    int64_t u, v;
    float fu, fv;
  };

  FixedLine() = default;
  /// In pixels `pixel` voxels wide, from (origin_u, origin_v), also in pixels, on. For columns from
  /// `first` on that lie within 2^30 pixels of it.
  FixedLine(const SheetLine& line, int64_t first, double pixel, double origin_u, double origin_v)
      : x_(Fixed((line.u + line.du * static_cast<double>(first)) / pixel - origin_u)),
        y_(Fixed((line.v + line.dv * static_cast<double>(first)) / pixel - origin_v)),
        dx_(Fixed(line.du / pixel)),
        dy_(Fixed(line.dv / pixel)),
        first_(first) {}

  /// Whether all of these columns, from `first` on, lie on pixels `low` to below `high_u`,
  /// `high_v`. A view from far away can be so steep that rounding moves a column by many pixels.
  [[nodiscard]] bool StaysWithin(const Columns& columns, int64_t low, int64_t high_u,
                                 int64_t high_v) const {
    return columns.begin >= columns.end ||
           (HasBetween(columns, x_, dx_, low, high_u) && HasBetween(columns, y_, dy_, low, high_v));
  }

  [[nodiscard]] Point At(int64_t column) const {
    const int64_t x = x_ + dx_ * (column - first_);
    const int64_t y = y_ + dy_ * (column - first_);
    return {x >> 32, y >> 32, Fraction(x), Fraction(y)};
  }

 private:
  /// Both ends, as what lies between them does so too. In 128 bits, where nothing overflows.
  [[nodiscard]] bool HasBetween(const Columns& columns, int64_t at, int64_t step, int64_t low,
                                int64_t high) const {
    for (const int64_t column : {columns.begin, columns.end - 1}) {
      const __int128 place = at + static_cast<__int128>(step) * (column - first_);
      if (place < static_cast<__int128>(low) * (int64_t{1} << 32) ||
          place >= static_cast<__int128>(high) * (int64_t{1} << 32)) {
        return false;
      }
    }
    return true;
  }
  static int64_t Fixed(double value) {
    constexpr double kRange = int64_t{1} << 30;  // a longer step leaves any level at once
    return static_cast<int64_t>(std::floor(std::clamp(value, -kRange, kRange) * 0x1p32 + 0.5));
  }
  static float Fraction(int64_t value) {
    // The first 24 places, which a float holds exactly.
    return static_cast<float>(static_cast<int32_t>(static_cast<uint32_t>(value) >> 8)) * 0x1p-24F;
  }

  int64_t x_ = 0, y_ = 0, dx_ = 0, dy_ = 0;
  int64_t first_ = 0;
};

}  // namespace fovea::render

#endif  // ENGINE_RENDER_WARP_LINE_H_
