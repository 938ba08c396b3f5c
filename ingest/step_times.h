#ifndef INGEST_STEP_TIMES_H_
#define INGEST_STEP_TIMES_H_

#include <optional>
#include <vector>

#include "engine/base/status.h"
#include "ingest/series_plan.h"

namespace fovea::ingest {

/// Fills in when the steps of a plan are: as asked for (seconds, or frames a second), else as the
/// files say, else by their numbers at 24 a second. INVALID_ARGUMENT if that is beyond the range of
/// time, not in order, or before the last step of the store that is appended to.
[[nodiscard]] Status SetStepTimes(const IngestOptions& options,
                                  const std::vector<ScannedFile>& files,
                                  const std::optional<ExistingStore>& existing, SeriesPlan* plan);

}  // namespace fovea::ingest

#endif  // INGEST_STEP_TIMES_H_
