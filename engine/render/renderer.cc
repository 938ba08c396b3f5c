#include "engine/render/renderer.h"

#include <cmath>

#include "engine/base/stopwatch.h"
#include "engine/render/combine.h"
#include "engine/render/smooth.h"
#include "engine/render/thick_ray.h"
#include "engine/render/warp.h"

namespace fovea::render {

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
  for (const auto& [name, size] :
       {std::pair("width_px", settings.width_px), std::pair("height_px", settings.height_px)}) {
    if (size < 1 || size > kMaxPicturePixels) {
      return InvalidArgument("{} {} is outside its range, 1 to {}", name, size, kMaxPicturePixels);
    }
  }
  return absl::OkStatus();
}

StatusOr<Image> RenderFoveated(const SuperVoxels& volume, const Matrix4& index_to_world,
                               const RenderSettings& settings, RenderStats* stats) {
  FOVEA_RETURN_IF_ERROR(Validate(settings));
  RenderStats counted;
  Stopwatch watch;
  const ShearView view = FactorView(settings.view, volume.retained.hierarchy().dims(),
                                    index_to_world, settings.width_px, settings.height_px);
  const std::vector<PyramidLevel> pyramid =
      Combine(TraceThickRays(volume, view, index_to_world, settings, &counted.samples),
              settings.smoothing == Smoothing::kFull, settings.threads);
  counted.render_ms = watch.RestartMs();
  const Rect sheet = SheetRect(volume.retained.hierarchy().dims(), view);
  Image image = settings.smoothing == Smoothing::kNone
                    ? WarpLeaves(pyramid, sheet, view, settings.width_px, settings.height_px,
                                 settings.threads)
                    : WarpSmooth(Smooth(pyramid), sheet, view, settings.width_px,
                                 settings.height_px, settings.threads);
  counted.smooth_warp_ms = watch.RestartMs();
  if (stats != nullptr) {
    *stats = counted;
  }
  return image;
}

}  // namespace fovea::render
