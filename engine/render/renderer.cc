#include "engine/render/renderer.h"

#include <cmath>
#include <utility>

#include "engine/base/stopwatch.h"
#include "engine/render/frame_scratch.h"
#include "engine/render/fused.h"
#include "engine/render/perspective.h"

namespace fovea::render {

namespace {

bool IsFinite(const Vec3& p) {
  return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z);
}

Status Validate(const Lighting& lighting) {
  for (const auto& [name, part] :
       {std::pair("ambient", lighting.ambient), std::pair("diffuse", lighting.diffuse),
        std::pair("specular", lighting.specular)}) {
    if (!(part >= 0 && part <= 1)) {
      return InvalidArgument("lighting.{} {} is outside its range, 0 to 1", name, part);
    }
  }
  const int n = lighting.shininess;
  if (n < 1 || n > 256 || (n & (n - 1)) != 0) {
    return InvalidArgument("lighting.shininess {} must be a power of two from 1 to 256", n);
  }
  if (!IsFinite(lighting.to_light)) {
    return InvalidArgument("lighting.to_light must be finite numbers");
  }
  return absl::OkStatus();
}

Status Validate(const Clip& clip) {
  if (clip.box) {
    const auto& [low, high] = *clip.box;
    for (int axis = 0; axis < 3; ++axis) {
      if (!(low[axis] < high[axis]) || !std::isfinite(high[axis] - low[axis])) {
        return InvalidArgument(
            "clip_box: its {} runs from {} to {}; it must grow, in finite numbers", "xyz"[axis],
            low[axis], high[axis]);
      }
    }
  }
  if (clip.planes.size() > kMostClipPlanes) {
    return InvalidArgument("clip_plane: {} of them; there may be at most {}", clip.planes.size(),
                           kMostClipPlanes);
  }
  for (const ClipPlane& plane : clip.planes) {
    if (!IsFinite(plane.normal) || !std::isfinite(plane.offset) || !(Length(plane.normal) > 0)) {
      return InvalidArgument(
          "clip_plane {},{},{},{}: it needs a normal of some length and finite "
          "numbers",
          plane.normal.x, plane.normal.y, plane.normal.z, plane.offset);
    }
  }
  return absl::OkStatus();
}

Status CheckOrthographic(const RenderSettings& settings, std::string_view what) {
  if (settings.perspective) {
    return InvalidArgument("perspective: {} is for orthographic views only", what);
  }
  return absl::OkStatus();
}

Status CheckColorVolume(const SuperVoxels& volume, const SuperVoxels& color,
                        const RenderSettings& settings) {
  FOVEA_RETURN_IF_ERROR(Validate(settings.color_transfer));
  for (int level = 0; level <= volume.retained.hierarchy().finest(); ++level) {
    if (volume.retained.hierarchy() != color.retained.hierarchy() ||
        volume.retained.box(level) != color.retained.box(level)) {
      return InvalidArgument(
          "the field of colours has another size or fovea than that of opacities");
    }
  }
  return absl::OkStatus();
}

/// scratch->trace.layers to scratch->frame.
void CombineLayers(const Int3& dims, const ShearView& view, const RenderSettings& settings,
                   FrameScratch* scratch) {
  FoveatedFrame& frame = scratch->frame;
  Combine(settings.smoothing == Smoothing::kFull, settings.threads, &scratch->trace.layers,
          &scratch->combine, &frame.levels);
  frame.sheet = SheetRect(dims, view);
  frame.warp = view.warp;
  frame.width_px = settings.width_px;
  frame.height_px = settings.height_px;
}

}  // namespace

Status Validate(const RenderSettings& settings) {
  FOVEA_RETURN_IF_ERROR(Validate(settings.view));
  FOVEA_RETURN_IF_ERROR(Validate(settings.transfer));
  const double a = settings.weighting.falloff_per_voxel;
  if (!(a >= 0 && a <= 1e6)) {
    return InvalidArgument("falloff_per_voxel {} is outside its range, 0 to 1e6", a);
  }
  if (!(settings.spent_transmittance >= 0 && settings.spent_transmittance <= 0.1F)) {
    return InvalidArgument("spent_transmittance {} is outside its range, 0 to 0.1",
                           settings.spent_transmittance);
  }
  FOVEA_RETURN_IF_ERROR(Validate(settings.lighting));
  FOVEA_RETURN_IF_ERROR(Validate(settings.clip));
  for (const auto& [name, size] :
       {std::pair("width_px", settings.width_px), std::pair("height_px", settings.height_px)}) {
    if (size < 1 || size > kMaxPicturePixels) {
      return InvalidArgument("{} {} is outside its range, 1 to {}", name, size, kMaxPicturePixels);
    }
  }
  return absl::OkStatus();
}

Status RenderFrame(const SuperVoxels& volume, const Matrix4& index_to_world,
                   const RenderSettings& settings, FrameScratch* scratch, RenderStats* stats,
                   const SuperVoxels* color_volume) {
  FOVEA_RETURN_IF_ERROR(Validate(settings));
  FOVEA_RETURN_IF_ERROR(CheckOrthographic(settings, "a foveated frame"));
  if (color_volume != nullptr) {
    FOVEA_RETURN_IF_ERROR(CheckColorVolume(volume, *color_volume, settings));
  }
  RenderStats counted;
  const Stopwatch watch;
  const Int3& dims = volume.retained.hierarchy().dims();
  const ShearView view =
      FactorView(settings.view, dims, index_to_world, settings.width_px, settings.height_px);
  counted.samples =
      TraceThickRays(volume, color_volume, view, index_to_world, settings, &scratch->trace);
  CombineLayers(dims, view, settings, scratch);
  counted.render_ms = watch.ElapsedMs();
  if (stats != nullptr) {
    *stats = counted;
  }
  return absl::OkStatus();
}

StatusOr<FoveatedFrame> RenderFrame(const SuperVoxels& volume, const Matrix4& index_to_world,
                                    const RenderSettings& settings, RenderStats* stats,
                                    const SuperVoxels* color_volume) {
  FrameScratch scratch;
  FOVEA_RETURN_IF_ERROR(
      RenderFrame(volume, index_to_world, settings, &scratch, stats, color_volume));
  return std::move(scratch.frame);
}

Status RenderFoveated(const SuperVoxels& volume, const Matrix4& index_to_world,
                      const RenderSettings& settings, FrameScratch* scratch, Image* image,
                      RenderStats* stats, const SuperVoxels* color_volume) {
  if (settings.perspective) {
    FOVEA_RETURN_IF_ERROR(Validate(settings));
    FOVEA_ASSIGN_OR_RETURN(
        *image, RenderPerspective(volume, color_volume, index_to_world, settings, stats));
    return absl::OkStatus();
  }
  FOVEA_RETURN_IF_ERROR(
      RenderFrame(volume, index_to_world, settings, scratch, stats, color_volume));
  const Stopwatch watch;
  Expand(scratch->frame, settings.width_px, settings.height_px, settings.smoothing, settings.basis,
         settings.threads, &scratch->expand, image);
  if (stats != nullptr) {
    stats->smooth_warp_ms = watch.ElapsedMs();
  }
  return absl::OkStatus();
}

StatusOr<Image> RenderFoveated(const SuperVoxels& volume, const Matrix4& index_to_world,
                               const RenderSettings& settings, RenderStats* stats,
                               const SuperVoxels* color_volume) {
  FrameScratch scratch;
  Image image;
  FOVEA_RETURN_IF_ERROR(
      RenderFoveated(volume, index_to_world, settings, &scratch, &image, stats, color_volume));
  return image;
}

StatusOr<FoveatedFrame> RenderFusedFrame(CoefficientSource& source, const RetainedSet& retained,
                                         const Matrix4& index_to_world,
                                         const RenderSettings& settings, FusedStats* stats,
                                         CoefficientSource* color) {
  FOVEA_RETURN_IF_ERROR(Validate(settings));
  FOVEA_RETURN_IF_ERROR(CheckOrthographic(settings, "fused rendering"));
  if (color != nullptr) {
    FOVEA_RETURN_IF_ERROR(Validate(settings.color_transfer));
    if (color->hierarchy() != retained.hierarchy()) {
      return InvalidArgument("the field of colours has another size than that of opacities");
    }
  }
  const Stopwatch watch;
  const Int3& dims = retained.hierarchy().dims();
  const ShearView view =
      FactorView(settings.view, dims, index_to_world, settings.width_px, settings.height_px);
  FrameScratch scratch;
  FusedStats counted;
  FOVEA_RETURN_IF_ERROR(TraceFused(source, color, retained, view, index_to_world, settings,
                                   &scratch.trace, &counted));
  CombineLayers(dims, view, settings, &scratch);
  counted.total_ms = watch.ElapsedMs();
  if (stats != nullptr) {
    *stats = counted;
  }
  return std::move(scratch.frame);
}

StatusOr<Image> RenderFused(CoefficientSource& source, const RetainedSet& retained,
                            const Matrix4& index_to_world, const RenderSettings& settings,
                            FusedStats* stats, CoefficientSource* color) {
  FusedStats counted;
  FOVEA_ASSIGN_OR_RETURN(
      const FoveatedFrame frame,
      RenderFusedFrame(source, retained, index_to_world, settings, &counted, color));
  const Stopwatch watch;
  Image image = Expand(frame, settings.width_px, settings.height_px, settings.smoothing,
                       settings.basis, settings.threads);
  counted.smooth_warp_ms = watch.ElapsedMs();
  counted.total_ms += counted.smooth_warp_ms;
  if (stats != nullptr) {
    *stats = counted;
  }
  return image;
}

}  // namespace fovea::render
