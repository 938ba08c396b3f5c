#ifndef ENGINE_SENSORS_DENSITY_H_
#define ENGINE_SENSORS_DENSITY_H_

#include "engine/sensors/step_buffer.h"
#include "engine/volume/geometry.h"
#include "engine/volume/hierarchy.h"

namespace fovea::sensors {

/// Where the readings of a step are densest, and how wide they lie around it.
struct Density {
  Vec3 fovea;       // in voxels: the mean place of the readings around the fullest coarse cell
  double rate = 1;  // 90 % of the readings lie where this rate keeps full detail; 1 to n
};

/// Of at least one voxel. Weighs each voxel with its readings.
[[nodiscard]] Density MeasureDensity(const Hierarchy& hierarchy, const MeasuredVoxels& voxels);

}  // namespace fovea::sensors

#endif  // ENGINE_SENSORS_DENSITY_H_
