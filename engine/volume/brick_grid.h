#ifndef ENGINE_VOLUME_BRICK_GRID_H_
#define ENGINE_VOLUME_BRICK_GRID_H_

#include <array>
#include <cstdint>
#include <map>
#include <span>
#include <utility>
#include <vector>

#include "engine/volume/geometry.h"
#include "engine/volume/grid.h"

namespace fovea {

/// A grid cut into cubes of `edge` points, of which only those that were touched are stored; every
/// other point has the background value. Points carry `channels` values (1 for voxels, 7 for the
/// detail sub-bands of a level). Memory follows the bricks, never the bounding box.
/// Not thread-safe while being written; any number of readers afterwards.
class BrickGrid {
 public:
  /// One brick: [channel][z][y][x], edge^3 values a channel. At the far border it reaches past
  /// the grid; those values count for nothing.
  using Brick = std::vector<float>;
  /// Bricks by their position in units of bricks, in z, y, x order: {z, y, x}.
  using BrickMap = std::map<std::array<int64_t, 3>, Brick>;

  BrickGrid() = default;
  BrickGrid(const Int3& dims, int64_t edge, int channels, float background)
      : dims_(dims), edge_(edge), channels_(channels), background_(background) {}

  [[nodiscard]] const Int3& dims() const { return dims_; }
  [[nodiscard]] int64_t edge() const { return edge_; }
  [[nodiscard]] int channels() const { return channels_; }
  [[nodiscard]] float background() const { return background_; }
  [[nodiscard]] const BrickMap& bricks() const { return bricks_; }
  [[nodiscard]] int64_t brick_values() const { return channels_ * edge_ * edge_ * edge_; }

  /// The brick at `position` (in bricks), or null where all is background.
  [[nodiscard]] const Brick* Find(const Int3& position) const;
  /// The brick at `position`, made of background if it was not there.
  Brick& Touch(const Int3& position);
  /// Puts `brick`, of brick_values() values, at `position`, in the place of what was there.
  void Put(const Int3& position, Brick brick) {
    bricks_.insert_or_assign({position.z, position.y, position.x}, std::move(brick));
  }
  /// Drops the brick at `position`, if it is there.
  void Erase(const Int3& position) { bricks_.erase({position.z, position.y, position.x}); }

  /// Copies `box` of every channel to `out` ([channel][z][y][x]); the box may reach outside the
  /// grid, where the background is read. `out` holds channels * box.Volume() values.
  void CopyOut(const Box3& box, std::span<float> out) const;
  /// Writes the values of a one-channel box (x fastest) into the grid; what lies outside the grid
  /// is ignored.
  void CopyIn(const Box3& box, std::span<const float> values);

 private:
  Int3 dims_;
  int64_t edge_ = 16;
  int channels_ = 1;
  float background_ = 0;
  BrickMap bricks_;
};

/// Least, greatest and distribution of the values of one time step of one field.
struct FieldStats {
  double minimum = 0, maximum = 0;
  /// Voxels in 256 equal bins from minimum to maximum (the last includes it); one value only: all
  /// in bin 0.
  std::array<uint64_t, 256> histogram{};
};

/// Over all voxels of a one-channel grid, background included.
[[nodiscard]] FieldStats ComputeStats(const BrickGrid& voxels);

}  // namespace fovea

#endif  // ENGINE_VOLUME_BRICK_GRID_H_
