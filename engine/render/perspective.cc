#include "engine/render/perspective.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
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

/// By face: pixels of all levels.
std::vector<int64_t> PixelsOfFaces(const RetainedSet& retained, const PerspectiveView& view,
                                   const Matrix4& index_to_world, int width_px, int height_px) {
  const Pinhole pinhole = MakePinhole(view, index_to_world, width_px, height_px);
  std::vector<int64_t> faces;
  for (const auto& face :
       MakeFaces(pinhole, index_to_world, retained.hierarchy().dims(), retained.fovea().at)) {
    int64_t& pixels = faces.emplace_back(0);
    for (const PerspectiveLevel& level :
         face ? PlanLevels(retained, *face) : std::vector<PerspectiveLevel>{}) {
      pixels += level.plan.rect.Width() * level.plan.rect.Height();
    }
  }
  return faces;
}

/// As FaceOf of its rays.
int IndexOf(const PerspectiveFace& face) {
  return 2 * face.axis_k + (face.ascending ? 0 : 1);
}

Status CheckReach(const Vec3& p) {
  constexpr double kFarthest = 1e18;  // beyond what any view asks for
  // Written so that NaN fails too.
  if (!(std::abs(p.x) <= kFarthest && std::abs(p.y) <= kFarthest && std::abs(p.z) <= kFarthest)) {
    return InvalidArgument("foveated frame: its camera is out of range");
  }
  return absl::OkStatus();
}

}  // namespace

Status Validate(const PerspectiveFrame& frame) {
  const Pinhole& pinhole = frame.pinhole;
  for (const Vec3& p : {pinhole.eye, pinhole.first, pinhole.column_step, pinhole.row_step}) {
    FOVEA_RETURN_IF_ERROR(CheckReach(p));
  }
  if (pinhole.width_px < 1 || pinhole.height_px < 1 || frame.faces.size() > 6) {
    return InvalidArgument("foveated frame: picture size or number of faces is out of range");
  }
  int last = -1;
  for (const FaceFrame& image : frame.faces) {
    const PerspectiveFace& face = image.face;
    for (const Vec3& p :
         {face.world_u, face.world_v, face.world_k, Vec3{face.reference_z, face.common_path, 0}}) {
      FOVEA_RETURN_IF_ERROR(CheckReach(p));
    }
    const int index = IndexOf(face);
    if (index <= last || !(face.common_path > 0) || face.reference_z == face.eye[face.axis_k]) {
      return InvalidArgument("foveated frame: face {} is out of order, or has no depth", index);
    }
    last = index;
    FOVEA_RETURN_IF_ERROR(Validate(image.levels, image.sheet));
  }
  return absl::OkStatus();
}

StatusOr<PerspectiveFrame> RenderPerspectiveFrame(const SuperVoxels& volume,
                                                  const SuperVoxels* color_volume,
                                                  const Matrix4& index_to_world,
                                                  const RenderSettings& settings,
                                                  RenderStats* stats) {
  FOVEA_RETURN_IF_ERROR(Check(settings, index_to_world));
  RenderStats counted;
  const Stopwatch watch;
  PerspectiveFrame frame;
  frame.pinhole = PinholeOf(index_to_world, settings);
  const RetainedSet& retained = volume.retained;
  const PerspectiveInputs inputs(settings, retained.fovea().at);
  CombineScratch scratch;
  for (const auto& face :
       MakeFaces(frame.pinhole, index_to_world, retained.hierarchy().dims(), retained.fovea().at)) {
    if (!face) {
      continue;
    }
    std::vector<Layer> layers =
        TraceThickRays(inputs, volume, color_volume, *face, &counted.samples);
    if (layers.empty()) {
      continue;
    }
    FaceFrame& image = frame.faces.emplace_back();
    image.face = *face;
    image.sheet = FaceRect(retained, *face);
    Combine(settings.smoothing == Smoothing::kFull, settings.threads, &layers, &scratch,
            &image.levels);
  }
  counted.render_ms = watch.ElapsedMs();
  if (stats != nullptr) {
    *stats = counted;
  }
  return frame;
}

Image ExpandPerspective(PerspectiveFrame frame, Smoothing smoothing, Basis basis, int threads) {
  FaceImages images;
  for (FaceFrame& image : frame.faces) {
    std::optional<FaceImage>& place = images[IndexOf(image.face)];
    std::vector<FrameLevel> levels = std::move(image.levels);  // go as soon as they are used
    if (smoothing == Smoothing::kNone) {
      place.emplace(image.face, image.sheet, std::move(levels));
    } else {
      std::vector<SmoothLevel> smooth;
      Smooth(levels, basis, threads, &smooth);
      place.emplace(image.face, image.sheet, std::move(smooth));
    }
  }
  return WarpFaces(frame.pinhole, images, threads);
}

StatusOr<Image> RenderPerspective(const SuperVoxels& volume, const SuperVoxels* color_volume,
                                  const Matrix4& index_to_world, const RenderSettings& settings,
                                  RenderStats* stats) {
  FOVEA_ASSIGN_OR_RETURN(
      PerspectiveFrame frame,
      RenderPerspectiveFrame(volume, color_volume, index_to_world, settings, stats));
  const Stopwatch watch;
  Image image =
      ExpandPerspective(std::move(frame), settings.smoothing, settings.basis, settings.threads);
  if (stats != nullptr) {
    stats->smooth_warp_ms = watch.ElapsedMs();
  }
  return image;
}

int64_t PerspectivePixels(const RetainedSet& retained, const PerspectiveView& view,
                          const Matrix4& index_to_world, int width_px, int height_px) {
  const std::vector<int64_t> faces =
      PixelsOfFaces(retained, view, index_to_world, width_px, height_px);
  return std::accumulate(faces.begin(), faces.end(), int64_t{0});
}

double PerspectiveBytes(const RetainedSet& retained, const PerspectiveView& view,
                        const Matrix4& index_to_world, int width_px, int height_px) {
  // Accumulators live for one face, what is looked up until the picture is done.
  constexpr double kPerTraced = 66;
  constexpr double kPerKept = 36;
  double traced = 0;
  double kept = 0;
  for (const int64_t pixels : PixelsOfFaces(retained, view, index_to_world, width_px, height_px)) {
    traced = std::max(traced, kPerTraced * static_cast<double>(pixels));
    kept += kPerKept * static_cast<double>(pixels);
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
