#ifndef ENGINE_WAVELET_FORWARD_STREAM_H_
#define ENGINE_WAVELET_FORWARD_STREAM_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <variant>

#include "engine/base/status.h"
#include "engine/volume/basis.h"
#include "engine/volume/brick_grid.h"
#include "engine/volume/geometry.h"
#include "engine/volume/grid.h"
#include "engine/volume/hierarchy.h"

/// The forward transform of transform.h for voxels that come slice by slice, from the first to the
/// last. Every brick of detail is handed out as soon as the slices that it depends on are there;
/// memory is a few layers of bricks a level, never the volume.
namespace fovea::wavelet {

/// What coefficients are computed as, and handed out as. kFloat32 is for the float bases. kInt16
/// and kInt32 are for the integer ones: voxels of at most kMostShortVoxel and kMostVoxel in
/// magnitude. A voxel beyond, or one that is not whole, is INVALID_ARGUMENT.
enum class CoefficientType { kFloat32, kInt16, kInt32 };
inline constexpr int32_t kMostShortVoxel = 1 << 10;  // 23 times that fits 16 bits
inline constexpr int32_t kMostVoxel = (1 << 17) - 1;

/// One brick of detail, not all zeros.
struct DetailBrick {
  int level = 0;
  /// Its place in units of bricks.
  Int3 at;
  /// [7][z][y][x] coefficients of the stream's type, edge^3 a sub-band, as in memory, aligned to
  /// 64 bytes; zeros past the border of the level. Valid during the call only.
  std::span<const std::byte> values;
  /// The largest |coefficient|, above 0. Infinite or NaN if a coefficient is.
  float largest = 0;
};

/// Takes the detail.
class DetailSink {
 public:
  virtual ~DetailSink() = default;
  /// Bricks of one layer (one level, one at.z) at a time, but within it in any order and from
  /// several threads at once: encode here. An error stops the stream.
  [[nodiscard]] virtual Status Take(const DetailBrick& brick) = 0;
  /// All bricks of layer z of `level` have been taken; what was not is zeros. One call a layer, in
  /// ascending z within a level, levels by turns, by the thread that pushes.
  [[nodiscard]] virtual Status EndLayer(int level, int64_t z) = 0;
};

struct ForwardStreamOptions {
  Hierarchy hierarchy = {};
  Basis basis = {};
  CoefficientType type = CoefficientType::kFloat32;
  /// Of bricks of voxels and of detail: an even number, 4 or more.
  int64_t edge = 16;
  /// The value of absent bricks of voxels.
  float background = 0;
  /// 0 for all processors. Results do not depend on it.
  int threads = 1;
};

/// Dense voxels of any of these types, x fastest.
using VoxelSpan =
    std::variant<std::span<const uint8_t>, std::span<const int8_t>, std::span<const uint16_t>,
                 std::span<const int16_t>, std::span<const float>>;

/// Used by one thread at a time. After an error every call returns it.
class ForwardStream {
 public:
  /// `sink` must outlive the stream. INVALID_ARGUMENT if the options do not go together.
  [[nodiscard]] static StatusOr<std::unique_ptr<ForwardStream>> Make(
      const ForwardStreamOptions& options, DetailSink* sink);
  virtual ~ForwardStream() = default;

  /// The next whole slices along z; fastest in pieces of 2 * edge. They are not copied: they must
  /// stay as they are until the last copy of `owner` is dropped (the stream keeps one as long as it
  /// reads them), or without an owner, until Finish. All slices of a stream are of one type.
  [[nodiscard]] virtual Status Push(const VoxelSpan& slices,
                                    std::shared_ptr<const void> owner = nullptr) = 0;

  /// The next `layers` layers of bricks: those of `bricks` (dims, edge and background as in the
  /// options) with a position z in there; the others are ignored. Cost follows what is stored. Not
  /// to be mixed with slices.
  [[nodiscard]] virtual Status Push(std::shared_ptr<const BrickGrid> bricks, int64_t layers) = 0;

  /// LLL_0, when all slices have been pushed; all detail was handed out before.
  [[nodiscard]] virtual StatusOr<Grid> Finish() = 0;
};

}  // namespace fovea::wavelet

#endif  // ENGINE_WAVELET_FORWARD_STREAM_H_
