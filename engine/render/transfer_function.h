#ifndef ENGINE_RENDER_TRANSFER_FUNCTION_H_
#define ENGINE_RENDER_TRANSFER_FUNCTION_H_

#include <string>
#include <string_view>
#include <vector>

#include "engine/base/status.h"

namespace fovea::render {

/// Linear light, 0 to 1.
struct Color {
  float red = 0, green = 0, blue = 0;
  friend bool operator==(const Color&, const Color&) = default;
};

/// Scalar to colour and opacity: linear between points, constant outside; colour and opacity
/// interpolated separately, not premultiplied. Two points at one value make a step.
struct TransferFunction {
  struct Point {
    double value = 0;  // data units
    Color color;
    float opacity = 0;  // 0 to 1 per voxel length (smallest spacing)
    friend bool operator==(const Point&, const Point&) = default;
  };
  std::vector<Point> points;  // 1 to 4096, values not decreasing
  friend bool operator==(const TransferFunction&, const TransferFunction&) = default;
};

/// INVALID_ARGUMENT naming the point and what is wrong with it.
[[nodiscard]] Status Validate(const TransferFunction& transfer);

/// Reads 'V:R,G,B:A;V:R,G,B:A;...' or the JSON list [{"value":V,"color":[R,G,B],"opacity":A}, ...].
[[nodiscard]] StatusOr<TransferFunction> ParseTransferFunction(std::string_view text);
/// The 'V:R,G,B:A;...' form; parsing it gives the same function back, bit for bit.
[[nodiscard]] std::string FormatTransferFunction(const TransferFunction& transfer);

/// What a value looks like, in double; at a step, the side towards smaller values. NaN is as the
/// first point.
struct Appearance {
  double red = 0, green = 0, blue = 0;
  double opacity = 0;  // per voxel length
};
[[nodiscard]] Appearance AppearanceOf(const TransferFunction& transfer, double value);

/// The function as the kernels read it: extinction sigma = -ln(1 - opacity) per voxel length, and
/// colour, at equal steps of the value, each entry with its slope. Every level uses the same table
/// (a slab of thickness w has opacity 1 - exp(-sigma w d)), so thick and thin rays agree to
/// rounding whatever the table's resolution.
class TransferTable {
 public:
  struct Entry {
    float red, green, blue, sigma;
    float red_slope, green_slope, blue_slope, sigma_slope;
  };
  static constexpr int kEntries = 4096;

  explicit TransferTable(const TransferFunction& transfer);
  /// Table position of a value: (value - offset) * scale, clamped to [0, kEntries - 1).
  [[nodiscard]] float offset() const { return offset_; }
  [[nodiscard]] float scale() const { return scale_; }
  [[nodiscard]] const Entry* entries() const { return entries_.data(); }

 private:
  float offset_ = 0;
  float scale_ = 0;
  std::vector<Entry> entries_;
};

}  // namespace fovea::render

#endif  // ENGINE_RENDER_TRANSFER_FUNCTION_H_
