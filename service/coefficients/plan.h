#ifndef SERVICE_COEFFICIENTS_PLAN_H_
#define SERVICE_COEFFICIENTS_PLAN_H_

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/fovea/retained_set.h"
#include "engine/store/dataset.h"
#include "engine/store/stored_type.h"
#include "engine/volume/geometry.h"
#include "engine/volume/hierarchy.h"

/// Coefficients for clients that render by themselves: docs/formats/coefficient-stream.md in code.
/// Knows neither gRPC nor the disk.
namespace fovea::coefficients {

/// The level of `coarse` in a box; detail has 0 to L - 1.
inline constexpr int kCoarse = -1;
inline constexpr size_t kMaxBlockBytes = size_t{512} << 10;
/// The numbers of a block before they are compressed, at most.
inline constexpr int64_t kMaxNumberBytes = 458'752;
inline constexpr size_t kMaxBoxes = 512;
inline constexpr size_t kMaxHeld = 16;
inline constexpr size_t kMaxFields = 2;

/// What of `boxes`, which do not overlap, lies outside `what`, as boxes that do not overlap.
[[nodiscard]] std::vector<Box3> Subtract(std::vector<Box3> boxes, const Box3& what);

/// The rates at which a stream stops to be rendered, growing by about sqrt(2), `rate` the last.
[[nodiscard]] std::vector<Rate> StageRates(const Hierarchy& hierarchy, const Rate& rate);

/// How the numbers of a box are stored; of kCoarse too. `field` must be there.
[[nodiscard]] store::Coding CodingOf(const store::DatasetInfo& info, const std::string& field,
                                     int level);

struct PlannedBox {
  int level = kCoarse;
  Box3 box;
  bool difference = false;  // the client holds all of it of the base step
};

/// One block of a stream: boxes of one field and type that together are small enough.
struct PlannedBlock {
  int field = 0;
  std::vector<PlannedBox> boxes;
  std::optional<Rate> reached;  // once this block is there
  [[nodiscard]] int64_t Values() const;
};

struct PlanRequest {
  std::vector<std::string> fields;  // 1 or 2, which are there
  Fovea fovea;                      // of cubes
  std::vector<Fovea> held;          // of this step; with `base` at most kMaxHeld
  std::vector<Fovea> base;          // of the base step
};

struct Plan {
  std::vector<PlannedBlock> blocks;
  std::optional<Rate> reached;  // before the first block
  int64_t coefficients = 0;
};

/// What a stream sends, in order. Depends on nothing but the shape of the dataset and the request,
/// so that any server can go on where another stopped. INVALID_ARGUMENT for a fovea outside the
/// volume or a bad rate; RESOURCE_EXHAUSTED if what is held cuts the windows into too many boxes.
[[nodiscard]] StatusOr<Plan> MakePlan(const store::DatasetInfo& info, const PlanRequest& request);

}  // namespace fovea::coefficients

#endif  // SERVICE_COEFFICIENTS_PLAN_H_
