#include "engine/render/perspective.h"

#include <algorithm>
#include <array>
#include <optional>
#include <utility>
#include <vector>

#include "engine/base/stopwatch.h"
#include "engine/render/combine.h"
#include "engine/render/perspective_slices.h"
#include "engine/render/perspective_trace.h"
#include "engine/render/perspective_view.h"
#include "engine/render/perspective_warp.h"
#include "engine/render/smooth.h"

namespace fovea::render {
namespace {

using FaceImages = std::array<std::optional<FaceImage>, 6>;

Pinhole PinholeOf(const Matrix4& index_to_world, const RenderSettings& settings) {
  return MakePinhole(*settings.perspective, index_to_world, settings.width_px, settings.height_px);
}

Status Check(const RenderSettings& settings, const Matrix4& index_to_world) {
  FOVEA_RETURN_IF_ERROR(Validate(*settings.perspective, index_to_world));
  if (settings.lighting.enabled) {
    return InvalidArgument("lighting is for orthographic views only");
  }
  if (settings.compositing == Compositing::kMaximum) {
    return InvalidArgument("maximum intensity is for orthographic views only");
  }
  return absl::OkStatus();
}

}  // namespace

StatusOr<Image> RenderPerspective(const SuperVoxels& volume, const SuperVoxels* color_volume,
                                  const Matrix4& index_to_world, const RenderSettings& settings,
                                  RenderStats* stats) {
  FOVEA_RETURN_IF_ERROR(Check(settings, index_to_world));
  RenderStats counted;
  Stopwatch watch;
  const Pinhole pinhole = PinholeOf(index_to_world, settings);
  const RetainedSet& retained = volume.retained;
  const auto faces =
      MakeFaces(pinhole, index_to_world, retained.hierarchy().dims(), retained.fovea().at);
  const PerspectiveInputs frame(settings, retained.fovea().at);
  CombineScratch scratch;
  FaceImages images;
  for (size_t f = 0; f < faces.size(); ++f) {
    if (!faces[f]) {
      continue;
    }
    std::vector<Layer> layers =
        TraceThickRays(frame, volume, color_volume, *faces[f], &counted.samples);
    if (layers.empty()) {
      continue;
    }
    std::vector<FrameLevel> levels;
    Combine(settings.smoothing == Smoothing::kFull, settings.threads, &layers, &scratch, &levels);
    counted.render_ms += watch.RestartMs();
    const Rect sheet = FaceRect(retained, *faces[f]);
    if (settings.smoothing == Smoothing::kNone) {
      images[f].emplace(*faces[f], sheet, std::move(levels));
    } else {
      std::vector<SmoothLevel> smooth;
      Smooth(levels, settings.basis, settings.threads, &smooth);
      images[f].emplace(*faces[f], sheet, std::move(smooth));
    }
    counted.smooth_warp_ms += watch.RestartMs();
  }
  Image image = WarpFaces(pinhole, images, settings.threads);
  counted.smooth_warp_ms += watch.RestartMs();
  if (stats != nullptr) {
    *stats = counted;
  }
  return image;
}

double PerspectiveBytes(const RetainedSet& retained, const PerspectiveView& view,
                        const Matrix4& index_to_world, int width_px, int height_px) {
  // Accumulators live for one face, what is looked up until the picture is done.
  constexpr double kPerTraced = 66;
  constexpr double kPerKept = 36;
  const Pinhole pinhole = MakePinhole(view, index_to_world, width_px, height_px);
  double traced = 0;
  double kept = 0;
  for (const auto& face :
       MakeFaces(pinhole, index_to_world, retained.hierarchy().dims(), retained.fovea().at)) {
    double pixels = 0;
    for (const PerspectiveLevel& level :
         face ? PlanLevels(retained, *face) : std::vector<PerspectiveLevel>{}) {
      const Rect& rect = level.plan.rect;
      pixels += static_cast<double>(rect.Width()) * static_cast<double>(rect.Height());
    }
    traced = std::max(traced, kPerTraced * pixels);
    kept += kPerKept * pixels;
  }
  return traced + kept;
}

StatusOr<Image> ReferencePerspective(const Grid& voxels, const Grid* color_voxels,
                                     const Matrix4& index_to_world, const Vec3& fovea,
                                     const RenderSettings& settings, RenderStats* stats) {
  FOVEA_RETURN_IF_ERROR(Check(settings, index_to_world));
  RenderStats counted;
  Stopwatch watch;
  const Int3 dims = voxels.box.Size();
  const Pinhole pinhole = PinholeOf(index_to_world, settings);
  const RetainedSet everything = RetainedSet::Whole(dims, fovea);
  const auto faces = MakeFaces(pinhole, index_to_world, dims, fovea);
  const PerspectiveInputs frame(settings, fovea);
  CombineScratch scratch;
  FaceImages images;
  for (size_t f = 0; f < faces.size(); ++f) {
    for (const PerspectiveLevel& level :
         faces[f] ? PlanLevels(everything, *faces[f]) : std::vector<PerspectiveLevel>{}) {
      std::vector<Layer> layers;
      layers.push_back(
          TraceLevel(frame, voxels, color_voxels, nullptr, level, *faces[f], &counted.samples));
      std::vector<FrameLevel> levels;
      Combine(false, settings.threads, &layers, &scratch, &levels);
      images[f].emplace(*faces[f], level.plan.rect, std::move(levels));
    }
  }
  counted.render_ms = watch.RestartMs();
  Image image = WarpFaces(pinhole, images, settings.threads);
  counted.smooth_warp_ms = watch.RestartMs();
  if (stats != nullptr) {
    *stats = counted;
  }
  return image;
}

}  // namespace fovea::render
