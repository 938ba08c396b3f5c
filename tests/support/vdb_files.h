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
  Vec3 vector = {};  // of grids of vectors, instead of value
};

/// A half-open box filled with one value; whole nodes become tiles.
struct VdbFill {
  Box3 box;
  double value = 1;
  bool active = true;
};

struct VdbGrid {
  std::string name = "density";
  /// float, double, half, int32, int64, bool, mask; vec3s, vec3d, vec3i (no fills); points, which
  /// holds nothing; shared: the tree of the first grid of the file.
  std::string type = "float";
  double background = 0;
  std::vector<VdbFill> fills = {};
  std::vector<VdbVoxel> voxels = {};  // after the fills
  double voxel_size = 1;
  Vec3 scale = {1, 1, 1};  // times voxel_size along each axis
  double turn_deg = 0;     // about z, after scaling
  Vec3 origin = {};        // world position of index (0, 0, 0)
  bool staggered = false;  // the grid's class
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
