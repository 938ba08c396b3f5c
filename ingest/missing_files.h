#ifndef INGEST_MISSING_FILES_H_
#define INGEST_MISSING_FILES_H_

#include <vector>

#include "ingest/grid_choice.h"
#include "ingest/ingest.h"
#include "ingest/series_plan.h"

namespace fovea::ingest {

/// Counts the numbers of a series for which there is no file (SeriesPlan::skipped_steps; held ones
/// are counted with their steps), and says in a warning which they are and what became of them.
void NoteMissingFiles(OnMissing on_missing, const std::vector<ScannedFile>& files,
                      SeriesPlan* plan);

}  // namespace fovea::ingest

#endif  // INGEST_MISSING_FILES_H_
