#include "service/frames/marker.h"

#include <algorithm>
#include <cmath>

namespace fovea::frames {
namespace {

/// How much of a pixel a disc covers, from the distance of the pixel's centre to the disc's edge.
double Cover(double distance, double radius) {
  return std::clamp(radius - distance + 0.5, 0.0, 1.0);
}

}  // namespace

void DrawFoveaMarker(render::Image* image, double column, double row) {
  constexpr float kRimRed = 0.05F;
  const double radius = std::max(3.0, 0.008 * image->height);
  const double rim = std::max(1.0, 0.25 * radius);
  const double reach = radius + rim + 1;
  // Clamped before the cast: the fovea may lie far outside a zoomed picture.
  const auto first = [reach](double at, int size) {
    return static_cast<int>(std::clamp(std::floor(at - reach), 0.0, static_cast<double>(size)));
  };
  const auto last = [reach](double at, int size) {
    return static_cast<int>(std::clamp(std::ceil(at + reach), 0.0, static_cast<double>(size)));
  };
  for (int j = first(row, image->height); j < last(row, image->height); ++j) {
    for (int i = first(column, image->width); i < last(column, image->width); ++i) {
      const double distance = std::hypot(i + 0.5 - column, j + 0.5 - row);
      const auto outer = static_cast<float>(Cover(distance, radius + rim));
      const auto inner = static_cast<float>(Cover(distance, radius));
      float* pixel = &image->rgba[4 * (static_cast<size_t>(j) * image->width + i)];
      const float red = outer * (inner + (1 - inner) * kRimRed);
      pixel[0] = red + (1 - outer) * pixel[0];
      pixel[1] = (1 - outer) * pixel[1];
      pixel[2] = (1 - outer) * pixel[2];
      pixel[3] = outer + (1 - outer) * pixel[3];
    }
  }
}

}  // namespace fovea::frames
