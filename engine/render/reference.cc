// Full-resolution direct rendering: the plain loops that thick rays are held against.
#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <optional>

#include "engine/base/parallel.h"
#include "engine/base/stopwatch.h"
#include "engine/render/composite.h"
#include "engine/render/expand.h"
#include "engine/render/lighting.h"
#include "engine/render/perspective.h"
#include "engine/render/renderer.h"
#include "engine/render/thick_ray.h"

namespace fovea::render {
namespace {

/// The first of four taps, and the weights of the second ones.
struct Tap {
  int64_t u, v, k;
  float fu, fv;
};

/// The value of a slice at (u, v) in cell-centre coordinates, the border repeated outside.
class SliceSampler {
 public:
  SliceSampler(const Grid& voxels, const ShearView& view) : voxels_(voxels), view_(view) {
    const Int3 size = voxels.box.Size();
    const int64_t strides[3] = {1, size.x, size.x * size.y};
    size_u_ = size[view.axis_u];
    size_v_ = size[view.axis_v];
    size_k_ = size[view.axis_k];
    stride_u_ = strides[view.axis_u];
    stride_v_ = strides[view.axis_v];
    stride_k_ = strides[view.axis_k];
  }

  [[nodiscard]] float At(const Tap& tap) const {
    const int64_t u0 = std::clamp<int64_t>(tap.u, 0, size_u_ - 1) * stride_u_;
    const int64_t u1 = std::clamp<int64_t>(tap.u + 1, 0, size_u_ - 1) * stride_u_;
    const int64_t v0 = std::clamp<int64_t>(tap.v, 0, size_v_ - 1) * stride_v_;
    const int64_t v1 = std::clamp<int64_t>(tap.v + 1, 0, size_v_ - 1) * stride_v_;
    const float* slice =
        voxels_.values.data() + std::clamp<int64_t>(tap.k, 0, size_k_ - 1) * stride_k_;
    const float near = (1 - tap.fu) * slice[u0 + v0] + tap.fu * slice[u1 + v0];
    const float far = (1 - tap.fu) * slice[u0 + v1] + tap.fu * slice[u1 + v1];
    return (1 - tap.fv) * near + tap.fv * far;
  }

  /// Central differences, (u, v, k).
  [[nodiscard]] std::array<float, 3> GradientAt(const Tap& tap) const {
    const auto difference = [&](int64_t du, int64_t dv, int64_t dk) {
      return 0.5F * (At({tap.u + du, tap.v + dv, tap.k + dk, tap.fu, tap.fv}) -
                     At({tap.u - du, tap.v - dv, tap.k - dk, tap.fu, tap.fv}));
    };
    return {difference(1, 0, 0), difference(0, 1, 0), difference(0, 0, 1)};
  }

  /// The rows v and v + 1 (the border repeated) of slice k, and the step along u.
  struct RowPair {
    const float* near;
    const float* far;
    int64_t stride;
  };
  [[nodiscard]] RowPair Rows(int64_t v, int64_t k) const {
    const float* slice = voxels_.values.data() + k * stride_k_;
    return {slice + std::clamp<int64_t>(v, 0, size_v_ - 1) * stride_v_,
            slice + std::clamp<int64_t>(v + 1, 0, size_v_ - 1) * stride_v_, stride_u_};
  }

 private:
  const Grid& voxels_;
  const ShearView& view_;
  int64_t size_u_ = 0, size_v_ = 0, size_k_ = 0, stride_u_ = 0, stride_v_ = 0, stride_k_ = 0;
};

Classified Classify(const TransferFunction& transfer, float value) {
  constexpr double kMostOpacity = 1.0 - 1.0 / (1 << 24);
  const Appearance a = AppearanceOf(transfer, value);
  return {static_cast<float>(a.red), static_cast<float>(a.green), static_cast<float>(a.blue),
          static_cast<float>(-std::log1p(-std::min(a.opacity, kMostOpacity)))};
}

/// The optical depth of one voxel-thick slab at pixel i.
float OpticalDepth(const WeightedRow& row, float sigma, int64_t i) {
  const float kept = row.side_count > 0 ? row.KeptLength(i) : static_cast<float>(row.length);
  return row.weighting.kind == Weighting::Kind::kFalloff ? FalloffDepth(sigma, row.Falloff(i), kept)
                                                         : sigma * kept;
}

/// Equation (3) for the rays of one row of the sheet, slice by slice from the viewer.
class RowTracer {
 public:
  RowTracer(const Grid& voxels, const Grid* color, const Matrix4& index_to_world, const Vec3& fovea,
            const RenderSettings& settings, const ShearView& view)
      : sampler_(voxels, view),
        dims_(voxels.box.Size()),
        index_to_world_(index_to_world),
        fovea_(fovea),
        settings_(settings),
        view_(view),
        light_(MakeLight(settings.lighting, settings.transfer, view, index_to_world)) {
    if (color != nullptr) {
      color_sampler_.emplace(*color, view);
    }
  }

  /// Fills `pixels` (pixels[0] is column `u0`); returns the samples taken.
  uint64_t Trace(int64_t v, int64_t u0, std::vector<Pixel>* pixels) const {
    const bool maximum = settings_.compositing == Compositing::kMaximum;
    const float start = maximum ? -std::numeric_limits<float>::infinity() : 0.0F;
    std::fill(pixels->begin(), pixels->end(), Pixel{start, 0, 0, 1});
    uint64_t samples = 0;
    const int64_t count = dims_[view_.axis_k];
    for (int64_t n = 0; n < count; ++n) {
      samples += TraceSlice(v, view_.ascending ? n : count - 1 - n, pixels->data() - u0);
    }
    if (maximum) {
      for (Pixel& pixel : *pixels) {
        const Appearance a =
            std::isfinite(pixel.red) ? AppearanceOf(settings_.transfer, pixel.red) : Appearance{};
        pixel = {static_cast<float>(a.opacity * a.red), static_cast<float>(a.opacity * a.green),
                 static_cast<float>(a.opacity * a.blue), static_cast<float>(1 - a.opacity)};
      }
    }
    return samples;
  }

 private:
  uint64_t TraceSlice(int64_t v, int64_t k, Pixel* pixels) const {
    const double z = static_cast<double>(k) + 0.5;
    const SliceShift shift{view_.slope_u * z, view_.slope_v * z};
    const Rect inside = PixelsInside(0, static_cast<double>(dims_[view_.axis_u]), 0,
                                     static_cast<double>(dims_[view_.axis_v]), shift);
    if (v < inside.v0 || v >= inside.v1) {
      return 0;
    }
    const WeightedRow row = MakeWeightedRow(view_, index_to_world_, fovea_, settings_, v, k, 1, 1);
    const double floor_u = std::floor(shift.u);
    const double floor_v = std::floor(shift.v);
    const int64_t tap_v = v + static_cast<int64_t>(floor_v);
    const auto fu = static_cast<float>(shift.u - floor_u);
    const auto fv = static_cast<float>(shift.v - floor_v);
    for (int64_t u = inside.u0; u < inside.u1; ++u) {
      const Tap tap{u + static_cast<int64_t>(floor_u), tap_v, k, fu, fv};
      if (settings_.compositing == Compositing::kMaximum) {
        const bool counts = row.side_count == 0 || row.KeptLength(u) > 0;
        const float value = sampler_.At(tap);
        pixels[u].red = counts ? std::max(pixels[u].red, value) : pixels[u].red;
        continue;
      }
      const Classified c = ClassifyAt(tap);
      Accumulate(c, OpticalDepth(row, c.sigma, u), &pixels[u]);
    }
    return static_cast<uint64_t>(inside.u1 - inside.u0);
  }

  [[nodiscard]] Classified ClassifyAt(const Tap& tap) const {
    Classified c = Classify(settings_.transfer, sampler_.At(tap));
    if (color_sampler_) {
      const float opacity = c.sigma;
      c = Classify(settings_.color_transfer, color_sampler_->At(tap));
      c.sigma = opacity;
    }
    if (settings_.lighting.enabled) {
      Shade(light_, sampler_.GradientAt(tap), &c);
    }
    return c;
  }

  SliceSampler sampler_;
  std::optional<SliceSampler> color_sampler_;
  Int3 dims_;
  const Matrix4& index_to_world_;
  Vec3 fovea_;
  const RenderSettings& settings_;
  const ShearView& view_;
  KernelLight light_;
};

/// Rows by table: colour and transmittance of a whole slab at equal steps of the value, as a plain
/// renderer would have them. No skipping, no termination, no weighting.
class TableRowTracer {
 public:
  TableRowTracer(const Grid& voxels, const RenderSettings& settings, const ShearView& view)
      : sampler_(voxels, view), dims_(voxels.box.Size()), view_(view), table_(settings.transfer) {
    const TransferTable::Entry* from = table_.entries();
    entries_.assign(from, from + TransferTable::kEntries);
    const auto length = static_cast<float>(view.step_length);
    for (TransferTable::Entry& entry : entries_) {
      const float near = ExpNegative(-entry.sigma * length);
      const float far = ExpNegative(-(entry.sigma + entry.sigma_slope) * length);
      entry.sigma = near;  // from here on what a slab lets through
      entry.sigma_slope = far - near;
    }
  }

  uint64_t Trace(int64_t v, int64_t u0, std::vector<Pixel>* pixels) const {
    std::fill(pixels->begin(), pixels->end(), Pixel{});
    uint64_t samples = 0;
    const int64_t count = dims_[view_.axis_k];
    for (int64_t n = 0; n < count; ++n) {
      samples += TraceSlice(v, view_.ascending ? n : count - 1 - n, pixels->data() - u0);
    }
    return samples;
  }

 private:
  uint64_t TraceSlice(int64_t v, int64_t k, Pixel* pixels) const {
    const double z = static_cast<double>(k) + 0.5;
    const SliceShift shift{view_.slope_u * z, view_.slope_v * z};
    const int64_t size_u = dims_[view_.axis_u];
    const Rect inside = PixelsInside(0, static_cast<double>(size_u), 0,
                                     static_cast<double>(dims_[view_.axis_v]), shift);
    if (v < inside.v0 || v >= inside.v1 || inside.u0 >= inside.u1) {
      return 0;
    }
    const auto whole_u = static_cast<int64_t>(std::floor(shift.u));
    const auto fu = static_cast<float>(shift.u - std::floor(shift.u));
    const auto whole_v = static_cast<int64_t>(std::floor(shift.v));
    const auto fv = static_cast<float>(shift.v - std::floor(shift.v));
    // Only the first and the last pixels of a row may need the border repeated.
    const int64_t first = std::clamp(-whole_u, inside.u0, inside.u1);
    const int64_t last = std::clamp(size_u - 1 - whole_u, first, inside.u1);
    for (int64_t u = inside.u0; u < first; ++u) {
      Composite(sampler_.At({u + whole_u, v + whole_v, k, fu, fv}), &pixels[u]);
    }
    const auto [near, far, stride] = sampler_.Rows(v + whole_v, k);
    for (int64_t u = first; u < last; ++u) {
      const int64_t at = (u + whole_u) * stride;
      const float a = near[at] + fu * (near[at + stride] - near[at]);
      const float b = far[at] + fu * (far[at + stride] - far[at]);
      Composite(a + fv * (b - a), &pixels[u]);
    }
    for (int64_t u = last; u < inside.u1; ++u) {
      Composite(sampler_.At({u + whole_u, v + whole_v, k, fu, fv}), &pixels[u]);
    }
    return static_cast<uint64_t>(inside.u1 - inside.u0);
  }

  void Composite(float value, Pixel* pixel) const {
    const Classified c = Classify(entries_.data(), table_.offset(), table_.scale(), value);
    const float weight = pixel->transmittance * (1.0F - c.sigma);
    pixel->red += weight * c.red;
    pixel->green += weight * c.green;
    pixel->blue += weight * c.blue;
    pixel->transmittance *= c.sigma;
  }

  SliceSampler sampler_;
  Int3 dims_;
  const ShearView& view_;
  TransferTable table_;
  std::vector<TransferTable::Entry> entries_;
};

/// All rows of the sheet, and the warp.
template <typename Tracer>
Image RenderSheet(const Tracer& tracer, const Int3& dims, const ShearView& view,
                  const RenderSettings& settings, RenderStats* stats) {
  Stopwatch watch;
  // A frame of one level, all of its pixels leaves.
  FoveatedFrame frame;
  frame.sheet = SheetRect(dims, view);
  frame.warp = view.warp;
  frame.width_px = settings.width_px;
  frame.height_px = settings.height_px;
  FrameLevel& sheet = frame.levels.emplace_back();
  const Rect rect = sheet.rect = frame.sheet;
  sheet.values.resize(static_cast<size_t>(rect.Width() * rect.Height()));
  sheet.kinds.assign(sheet.values.size(), PixelKind::kLeaf);
  std::atomic<uint64_t> samples{0};
  ParallelFor(rect.v0, rect.v1, 8, settings.threads, [&](int64_t first, int64_t last) {
    std::vector<Pixel> pixels(static_cast<size_t>(rect.Width()));
    for (int64_t v = first; v < last; ++v) {
      samples += tracer.Trace(v, rect.u0, &pixels);
      for (int64_t u = rect.u0; u < rect.u1; ++u) {
        const Pixel& p = pixels[u - rect.u0];
        sheet.values[sheet.Index(u, v)] = {p.red, p.green, p.blue, 1 - p.transmittance};
      }
    }
  });
  const double render_ms = watch.RestartMs();
  Image image = Expand(frame, settings.width_px, settings.height_px, Smoothing::kNone,
                       settings.basis, settings.threads);
  if (stats != nullptr) {
    *stats = {samples, render_ms, watch.RestartMs()};
  }
  return image;
}

}  // namespace

StatusOr<Image> RenderReference(const Grid& voxels, const Matrix4& index_to_world,
                                const Vec3& fovea, const RenderSettings& settings,
                                RenderStats* stats, const Grid* color_voxels) {
  FOVEA_RETURN_IF_ERROR(Validate(settings));
  if (settings.perspective) {
    return ReferencePerspective(voxels, color_voxels, index_to_world, fovea, settings, stats);
  }
  const Int3 dims = voxels.box.Size();
  const ShearView view =
      FactorView(settings.view, dims, index_to_world, settings.width_px, settings.height_px);
  return RenderSheet(RowTracer(voxels, color_voxels, index_to_world, fovea, settings, view), dims,
                     view, settings, stats);
}

StatusOr<Image> RenderPlainLoops(const Grid& voxels, const Matrix4& index_to_world,
                                 const RenderSettings& settings, RenderStats* stats) {
  FOVEA_RETURN_IF_ERROR(Validate(settings));
  if (settings.weighting.kind != Weighting::Kind::kNone || !settings.clip.IsEmpty() ||
      settings.lighting.enabled || settings.compositing != Compositing::kEmissionAbsorption) {
    return InvalidArgument(
        "the plain loops know neither weighting, clipping, lighting nor maxima; the reference "
        "does");
  }
  const Int3 dims = voxels.box.Size();
  const ShearView view =
      FactorView(settings.view, dims, index_to_world, settings.width_px, settings.height_px);
  return RenderSheet(TableRowTracer(voxels, settings, view), dims, view, settings, stats);
}

}  // namespace fovea::render
