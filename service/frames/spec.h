#ifndef SERVICE_FRAMES_SPEC_H_
#define SERVICE_FRAMES_SPEC_H_

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "engine/fovea/reconstruct.h"
#include "engine/fovea/retained_set.h"
#include "engine/render/renderer.h"
#include "engine/render/transfer_function.h"
#include "engine/volume/geometry.h"

/// A frame as the command line and the server both understand it: the plain twin of
/// proto/fovea/v1/render.proto. Everything optional is chosen from the dataset if it is absent.
namespace fovea::frames {

struct Position {
  Vec3 at;
  bool world = false;  // false: voxel coordinates of the dataset
  friend bool operator==(const Position&, const Position&) = default;
};

/// A camera at a point; conventions of render::PerspectiveView.
struct PerspectiveSpec {
  Position eye;
  std::optional<Position> target;   // default: the middle of the volume
  std::optional<Vec3> up;           // world axes; default +z (+y when sight is along z)
  std::optional<double> fov_y_deg;  // 0.01 to 170; default 45
  friend bool operator==(const PerspectiveSpec&, const PerspectiveSpec&) = default;
};

/// Orthographic, unless `perspective` is given; then nothing else may be.
struct ViewSpec {
  std::optional<double> azimuth_deg, elevation_deg;
  std::optional<Position> center;
  std::optional<double> span_voxels;
  std::optional<PerspectiveSpec> perspective;
  friend bool operator==(const ViewSpec&, const ViewSpec&) = default;
};

/// A box to clip to: voxel coordinates, or world ones.
struct ClipBox {
  Vec3 lower, upper;
  bool world = false;
  friend bool operator==(const ClipBox&, const ClipBox&) = default;
};

/// Keeps normal . p >= offset, p in voxel coordinates, or in world ones.
struct ClipPlane {
  Vec3 normal;
  double offset = 0;
  bool world = false;
  friend bool operator==(const ClipPlane&, const ClipPlane&) = default;
};

struct ClipSpec {
  std::optional<ClipBox> box;
  std::vector<ClipPlane> planes;  // at most render::kMostClipPlanes
  [[nodiscard]] bool IsEmpty() const { return !box && planes.empty(); }
  friend bool operator==(const ClipSpec&, const ClipSpec&) = default;
};

/// Two phases keep all super-voxels of a frame; fused makes slices as rays reach them. A resolved
/// spec has one of these two.
enum class Mode { kTwoPhase, kFused, kAuto };

enum class Encoding { kPng, kJpeg, kRawRgba8, kRawRgbaF32, kFoveated };

struct FrameSpec {
  std::optional<std::string> field;
  ViewSpec view;
  std::optional<Position> fovea;
  std::optional<Rate> rate;
  std::optional<WindowShape> window;
  std::optional<Reconstruction> reconstruction;
  std::optional<render::TransferFunction> transfer;
  std::optional<render::Weighting> weighting;
  std::optional<render::Smoothing> smoothing;
  std::optional<render::Basis> basis;
  std::optional<render::Compositing> compositing;
  std::optional<render::Lighting> lighting;  // enabled, or absent: none
  ClipSpec clip;
  std::optional<std::string> color_field;                  // absent: none
  std::optional<render::TransferFunction> color_transfer;  // only with a color_field
  std::optional<Mode> mode;                                // default kTwoPhase
  std::optional<int64_t> width_px, height_px;              // 1 to 16384; default 512
  Encoding encoding = Encoding::kPng;
  std::optional<int64_t> jpeg_quality;      // 1 to 100; default 90
  std::optional<render::Color> background;  // PNG, JPEG, RAW_RGBA8; default black
  bool fovea_marker = false;                // the paper's red dot; not in RAW_RGBA_F32
  bool strict = false;                      // a damaged chunk is DATA_LOSS, not a warning
  friend bool operator==(const FrameSpec&, const FrameSpec&) = default;
};

/// As the engine takes it, which does not know the world: `spec` is in voxels, or only checked.
[[nodiscard]] render::Clip EngineClip(const ClipSpec& spec);

/// The fovea of a spec with nothing left to default, its position in voxels.
[[nodiscard]] inline Fovea FoveaOf(const FrameSpec& resolved) {
  return {resolved.fovea->at, *resolved.rate, resolved.window.value_or(WindowShape::kCube)};
}

struct FrameStats {
  uint64_t coefficients = 0;  // m
  uint64_t chunks_read = 0, chunks_total = 0, bytes_read = 0;
  uint64_t super_voxels = 0, samples = 0;
  double read_ms = 0, reconstruct_ms = 0, render_ms = 0, smooth_warp_ms = 0, encode_ms = 0;
};

struct Warning {
  enum class Code {
    kDataLoss,     // damaged chunks were left out
    kNotRetained,  // the window reaches where the dataset keeps no detail
  };
  std::string message;
  uint64_t count = 0;  // damaged chunks
  Code code = Code::kDataLoss;
};
[[nodiscard]] const char* WarningName(Warning::Code code);

struct Frame {
  std::string dataset;
  int64_t step = 0;
  int64_t time_ns = 0;
  std::optional<int64_t> frame_number;
  FrameSpec used;  // nothing left to default: rendered again, it gives the same bytes
  int width_px = 0, height_px = 0;
  Encoding encoding = Encoding::kPng;
  /// RAW: top row first, R G B A, no padding; F32 little-endian. kFoveated: ExpandFrame draws it.
  std::string pixels;
  FrameStats stats;
  uint64_t index = 0;  // within a sequence, from 0
  std::vector<Warning> warnings;
};

}  // namespace fovea::frames

#endif  // SERVICE_FRAMES_SPEC_H_
