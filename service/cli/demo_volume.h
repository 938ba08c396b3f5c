#ifndef SERVICE_CLI_DEMO_VOLUME_H_
#define SERVICE_CLI_DEMO_VOLUME_H_

#include "engine/volume/brick_grid.h"

namespace fovea::cli {

/// A plume that rises from the floor and swirls, as density 0 to 1, `edge` voxels a side.
/// `phase` is the part of the series that has passed, from 0. Empty space has no bricks.
[[nodiscard]] BrickGrid DemoPlume(int64_t edge, double phase, int threads);

}  // namespace fovea::cli

#endif  // SERVICE_CLI_DEMO_VOLUME_H_
