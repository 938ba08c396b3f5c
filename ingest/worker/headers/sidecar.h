#ifndef INGEST_WORKER_HEADERS_SIDECAR_H_
#define INGEST_WORKER_HEADERS_SIDECAR_H_

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "engine/base/status.h"
#include "engine/volume/geometry.h"
#include "ingest/ingest.h"

namespace fovea::ingest {

/// What NAME.raw.json says of NAME.raw (docs/formats/inputs.md). Only dims_xyz and type must be
/// there; keys that are not known are passed over.
struct Sidecar {
  RawFormat raw;
  std::optional<Vec3> spacing, origin;  // the origin: where the first voxel begins
  std::string world_unit, value_unit;
  std::vector<double> times_s;  // one for each step, or none
};

[[nodiscard]] StatusOr<Sidecar> ParseSidecar(std::string_view text);

}  // namespace fovea::ingest

#endif  // INGEST_WORKER_HEADERS_SIDECAR_H_
