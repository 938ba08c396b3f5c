#ifndef TESTS_SUPPORT_VDB_FILES_H_
#define TESTS_SUPPORT_VDB_FILES_H_

#include <optional>
#include <string>
#include <vector>

#include "engine/volume/geometry.h"

/// Small OpenVDB files, without OpenVDB's headers.
namespace fovea::testing {

struct VdbVoxel {
  Int3 at;
  double value = 1;
  bool active = true;
};

/// A half-open box filled with one value; whole nodes become tiles.
struct VdbFill {
  Box3 box;
  double value = 1;
  bool active = true;
};

struct VdbGrid {
  std::string name = "density";
  /// float, double, half, int32, int64, bool, mask; vec3s and points hold no values; shared: the
  /// tree of the first grid of the file.
  std::string type = "float";
  double background = 0;
  std::vector<VdbFill> fills = {};
  std::vector<VdbVoxel> voxels = {};  // after the fills
  double voxel_size = 1;
  Vec3 origin = {};       // world position of index (0, 0, 0)
  bool frustum = false;   // a transform that is not linear
  std::string unit = {};  // metadata "world_unit"
};

struct VdbFileOptions {
  bool stats_metadata = true;             // file_bbox_min and the like
  std::optional<Box3> declared_box = {};  // instead of the true one, in every grid
  bool grid_offsets = true;               // false: as if written to a pipe
};

/// Writes the file; throws if it cannot.
void WriteVdb(const std::string& path, const std::vector<VdbGrid>& grids,
              const VdbFileOptions& options = {});

}  // namespace fovea::testing

#endif  // TESTS_SUPPORT_VDB_FILES_H_
