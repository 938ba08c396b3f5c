#include "engine/render/perspective_warp.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <functional>
#include <utility>

#include "engine/base/parallel.h"
#include "engine/render/path_lengths.h"
#include "engine/render/rgba_vector.h"
#include "engine/render/smooth_sample.h"

namespace fovea::render {
namespace {

/// A position among the pixels of an image: the first of four taps, and how far to the next.
struct Place {
  int64_t u = 0, v = 0;
  float fu = 0, fv = 0;
};

constexpr double kFarthest = 1e15;  // voxels; whole numbers up to there are exact

/// `origin`: where taps are counted from, in pixels.
Place PlaceOf(double at_u, double at_v, double inverse_width, double origin) {
  const double x = at_u * inverse_width - origin;
  const double y = at_v * inverse_width - origin;
  const double floor_x = std::floor(x);
  const double floor_y = std::floor(y);
  return {static_cast<int64_t>(floor_x), static_cast<int64_t>(floor_y),
          static_cast<float>(x - floor_x), static_cast<float>(y - floor_y)};
}

/// How much of a point lies within reach of the sheet's pixels: 1 inside, falling to 0 over the
/// voxel around its edge.
float CoverOf(const Rect& sheet, double at_u, double at_v) {
  const double u =
      std::min(at_u - static_cast<double>(sheet.u0), static_cast<double>(sheet.u1) - at_u);
  const double v =
      std::min(at_v - static_cast<double>(sheet.v0), static_cast<double>(sheet.v1) - at_v);
  return static_cast<float>(std::clamp(u + 0.5, 0.0, 1.0) * std::clamp(v + 0.5, 0.0, 1.0));
}

Rgba ToRgba(RgbaVector value) {
  return {value[0], value[1], value[2], value[3]};
}

}  // namespace

FaceImage::FaceImage(const PerspectiveFace& face, const Rect& sheet, std::vector<FrameLevel> levels)
    : face_(face), sheet_(sheet), leaves_(std::move(levels)) {}

FaceImage::FaceImage(const PerspectiveFace& face, const Rect& sheet,
                     std::vector<SmoothLevel> levels)
    : face_(face), sheet_(sheet), smooth_(std::move(levels)) {}

/// The value of the leaf that the voxel-wide pixel (u, v) lies in.
Rgba FaceImage::Leaf(int64_t u, int64_t v) const {
  if (!sheet_.Contains(u, v)) {
    return {};
  }
  for (const FrameLevel& level : leaves_) {
    const int shift = std::countr_zero(static_cast<uint64_t>(level.width));
    const int64_t lu = u >> shift;
    const int64_t lv = v >> shift;
    if (!level.rect.Contains(lu, lv)) {
      break;
    }
    const size_t i = level.Index(lu, lv);
    if (level.kinds[i] != PixelKind::kSplit) {
      return level.values[i];
    }
  }
  return {};
}

Rgba FaceImage::Staircase(double at_u, double at_v) const {
  const Place place = PlaceOf(at_u, at_v, 1, 0.5);
  const auto leaf = [&](int64_t du, int64_t dv) { return Load(Leaf(place.u + du, place.v + dv)); };
  return ToRgba(
      Mix(Mix(leaf(0, 0), leaf(1, 0), place.fu), Mix(leaf(0, 1), leaf(1, 1), place.fu), place.fv));
}

/// As WarpSmooth: finest level first, coarser ones where its weight leaves room.
Rgba FaceImage::Smoothed(double at_u, double at_v) const {
  const float cover = CoverOf(sheet_, at_u, at_v);
  RgbaVector value = {};
  float left = cover > 0 ? 1 : 0;
  for (size_t l = smooth_.size(); l-- > 0 && left > 1e-6F;) {
    const SmoothLevel& level = smooth_[l];
    const Rect& rect = level.rect;
    const Place place =
        PlaceOf(at_u, at_v, 1 / static_cast<double>(level.width), TapOrigin(level.basis));
    if (place.u < rect.u0 - 1 || place.u > rect.u1 || place.v < rect.v0 - 1 || place.v > rect.v1) {
      continue;
    }
    RgbaVector own;
    float weight;
    if (SmoothSampler(level).At(level.Index(place.u, place.v), place.fu, place.fv, &own, &weight)) {
      // Between pixels one voxel wide the sheet's edge fades by itself.
      value += (level.width == 1 ? left : left * cover) * own;
      left *= 1 - weight;
    }
  }
  return ToRgba(value);
}

Rgba FaceImage::Along(const Vec3& ray) const {
  const double reach = face_.reference_z - face_.eye[face_.axis_k];
  const double scale = reach / ray[face_.axis_k];
  const double at_u = face_.eye[face_.axis_u] + scale * ray[face_.axis_u];
  const double at_v = face_.eye[face_.axis_v] + scale * ray[face_.axis_v];
  if (!(std::abs(at_u) < kFarthest && std::abs(at_v) < kFarthest)) {
    return {};  // a camera that came from elsewhere, without a direction
  }
  const auto path = static_cast<float>(Length(face_.WayAt(at_u, at_v)) / face_.common_path);
  return Lengthened(leaves_.empty() ? Smoothed(at_u, at_v) : Staircase(at_u, at_v), path);
}

Image WarpFaces(const Pinhole& pinhole, const std::array<std::optional<FaceImage>, 6>& faces,
                int threads) {
  Image image;
  image.width = pinhole.width_px;
  image.height = pinhole.height_px;
  image.rgba.resize(4 * static_cast<size_t>(image.width) * static_cast<size_t>(image.height));
  const auto rows = [&](int64_t first, int64_t last) {
    for (int64_t j = first; j < last; ++j) {
      float* out = image.rgba.data() + 4 * j * image.width;
      for (int64_t i = 0; i < image.width; ++i, out += 4) {
        const Vec3 ray = pinhole.Ray(static_cast<double>(i), static_cast<double>(j));
        const auto& face = faces[FaceOf(ray)];
        if (face) {
          Store(Load(face->Along(ray)), out);
        }
      }
    }
  };
  ParallelFor(0, image.height, 8, threads, std::ref(rows));
  return image;
}

}  // namespace fovea::render
