#ifndef ENGINE_RENDER_RENDERER_H_
#define ENGINE_RENDER_RENDERER_H_

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "engine/base/status.h"
#include "engine/fovea/reconstruct.h"
#include "engine/render/foveated_frame.h"
#include "engine/render/image.h"
#include "engine/render/perspective_view.h"
#include "engine/render/transfer_function.h"
#include "engine/render/view.h"
#include "engine/volume/geometry.h"
#include "engine/volume/grid.h"

namespace fovea::render {

/// The weighting function D of Yu et al., section 4: multiplies opacity.
struct Weighting {
  enum class Kind { kNone, kChop, kFalloff };
  Kind kind = Kind::kNone;
  double falloff_per_voxel = 0;  // a in 1/(1 + a * distance in voxels), 0 to 1e6; kFalloff only
  friend bool operator==(const Weighting&, const Weighting&) = default;
};

/// kEmissionAbsorption: Yu et al., eq. (3). kMaximum: the largest value along the ray, in the
/// colour and with the opacity that the transfer function gives it; knows no falloff and no
/// lighting.
enum class Compositing { kEmissionAbsorption, kMaximum };

/// Gradient shading (Blinn and Phong), on gradients of each level's own super-voxels, so that
/// coarse ones are lit like fine ones. Both sides of a surface are lit.
struct Lighting {
  bool enabled = false;
  float ambient = 0.3F, diffuse = 0.7F, specular = 0.2F;  // 0 to 1 each
  int shininess = 16;                                     // specular exponent: 1, 2, 4 ... 256
  /// World direction towards the light; {0, 0, 0} for a light beside the viewer.
  Vec3 to_light;
  friend bool operator==(const Lighting&, const Lighting&) = default;
};

/// Keeps the half-space normal . p >= offset; voxel coordinates.
struct ClipPlane {
  Vec3 normal;
  double offset = 0;
  friend bool operator==(const ClipPlane&, const ClipPlane&) = default;
};
inline constexpr int kMostClipPlanes = 6;

/// What is shown: all that lies in the box and in every half-space. A slab that is cut counts with
/// the part of its path inside.
struct Clip {
  std::optional<std::array<Vec3, 2>> box;  // lower and upper corner, voxel coordinates
  std::vector<ClipPlane> planes;           // at most kMostClipPlanes
  [[nodiscard]] bool IsEmpty() const { return !box && planes.empty(); }
  friend bool operator==(const Clip&, const Clip&) = default;
};

inline constexpr int kMaxPicturePixels = 16384;  // a side

struct RenderSettings {
  OrthographicView view;
  std::optional<PerspectiveView> perspective;  // if set, `view` is ignored
  TransferFunction transfer;
  /// With a second field (RenderFoveated's `color_volume`): its colours; `transfer` gives opacity.
  TransferFunction color_transfer;
  Compositing compositing = Compositing::kEmissionAbsorption;
  Lighting lighting;
  Clip clip;
  Weighting weighting;
  Smoothing smoothing = Smoothing::kFull;
  Basis basis = Basis::kBilinear;       // what kImage and kFull interpolate with
  int width_px = 512, height_px = 512;  // 1 to kMaxPicturePixels
  /// Where less of a ray is left than this, what lies behind is skipped: 0 (nothing is) to 0.1.
  float spent_transmittance = 1.0F / 4096;
  int threads = 0;  // 0: all processors; the picture does not depend on it
};

struct RenderStats {
  uint64_t samples = 0;  // scalar samples classified and composited
  double render_ms = 0;  // thick rays and combining
  double smooth_warp_ms = 0;
};

/// INVALID_ARGUMENT naming field, value and range.
[[nodiscard]] Status Validate(const RenderSettings& settings);

struct FrameScratch;  // frame_scratch.h

/// The rendering phase, O(n^2 + m): thick rays through the super-voxels, combined (RenderFrame),
/// then smoothed and warped to the picture (Expand). Depends on its arguments only, not on
/// threads. Thread-safe. `color_volume`, if given, is a second field of the same retained set,
/// whose values are coloured by settings.color_transfer; INVALID_ARGUMENT if it is of another.
[[nodiscard]] StatusOr<Image> RenderFoveated(const SuperVoxels& volume,
                                             const Matrix4& index_to_world,
                                             const RenderSettings& settings,
                                             RenderStats* stats = nullptr,
                                             const SuperVoxels* color_volume = nullptr);
/// The same into `image`, in buffers kept from frame to frame.
[[nodiscard]] Status RenderFoveated(const SuperVoxels& volume, const Matrix4& index_to_world,
                                    const RenderSettings& settings, FrameScratch* scratch,
                                    Image* image, RenderStats* stats = nullptr,
                                    const SuperVoxels* color_volume = nullptr);

/// The pyramid alone, O(m). Expand(frame, width_px, height_px, settings.smoothing) is
/// RenderFoveated's picture, bit by bit.
[[nodiscard]] StatusOr<FoveatedFrame> RenderFrame(const SuperVoxels& volume,
                                                  const Matrix4& index_to_world,
                                                  const RenderSettings& settings,
                                                  RenderStats* stats = nullptr,
                                                  const SuperVoxels* color_volume = nullptr);
/// The same into scratch->frame.
[[nodiscard]] Status RenderFrame(const SuperVoxels& volume, const Matrix4& index_to_world,
                                 const RenderSettings& settings, FrameScratch* scratch,
                                 RenderStats* stats = nullptr,
                                 const SuperVoxels* color_volume = nullptr);

/// Full-resolution direct rendering (Yu et al., eq. (3), every voxel) of a whole volume, on the
/// same sheared grid and with the same warp: what RenderFoveated is held against. The transfer
/// function is evaluated in double. `fovea` is needed by the weightings only. Ignores
/// `settings.smoothing` and skips nothing. Cost O(n^3). For speed at full resolution,
/// RenderFoveated(WholeVolume(..)).
[[nodiscard]] StatusOr<Image> RenderReference(const Grid& voxels, const Matrix4& index_to_world,
                                              const Vec3& fovea, const RenderSettings& settings,
                                              RenderStats* stats = nullptr,
                                              const Grid* color_voxels = nullptr);

/// The same, as a plain renderer does it: an RGB table, no skipping, no termination, no SIMD by
/// hand. What speed is measured against. INVALID_ARGUMENT with weighting, clipping, lighting or
/// maxima.
[[nodiscard]] StatusOr<Image> RenderPlainLoops(const Grid& voxels, const Matrix4& index_to_world,
                                               const RenderSettings& settings,
                                               RenderStats* stats = nullptr);

}  // namespace fovea::render

#endif  // ENGINE_RENDER_RENDERER_H_
