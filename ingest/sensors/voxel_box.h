#ifndef INGEST_SENSORS_VOXEL_BOX_H_
#define INGEST_SENSORS_VOXEL_BOX_H_

#include "engine/base/status.h"
#include "engine/sensors/reading_binner.h"
#include "ingest/sensors/sensor_ingest.h"

namespace fovea::ingest {

/// Where readings lie, and how many there are in a step.
struct ReadingExtent {
  Vec3 lower, upper;
  int64_t readings = 0;
  int64_t steps = 0;
};

/// Whether `box` says all: bounds, and voxel or dims.
[[nodiscard]] bool IsComplete(const SensorBox& box);

/// The voxels of `box`, what it lacks chosen from the readings: bounds around them all; along the
/// longest axis as many voxels as the square root of the readings of a step, 16 to 512, their size
/// rounded up to two digits; voxels as high as wide, but an axis along which readings lie gets at
/// least 32 of them, so that flat boxes keep their heights apart. `extent` counts only where the
/// box is not complete. INVALID_ARGUMENT, naming the flag, for what cannot be; OUT_OF_RANGE for too
/// many voxels; FAILED_PRECONDITION if there are no readings to choose from.
[[nodiscard]] StatusOr<sensors::VoxelGrid> ChooseVoxels(const SensorBox& box,
                                                        const ReadingExtent& extent);

/// The flags that choose these voxels again.
[[nodiscard]] std::string BoxFlags(const sensors::VoxelGrid& grid);

/// The voxels of a store: its matrix must only scale and shift.
[[nodiscard]] StatusOr<sensors::VoxelGrid> VoxelsOfStore(const Hierarchy& hierarchy,
                                                         const Matrix4& index_to_world);

}  // namespace fovea::ingest

#endif  // INGEST_SENSORS_VOXEL_BOX_H_
