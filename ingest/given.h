#ifndef INGEST_GIVEN_H_
#define INGEST_GIVEN_H_

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "ingest/grid_choice.h"
#include "ingest/ingest.h"
#include "ingest/sequence.h"
#include "ingest/series_plan.h"

namespace fovea::ingest {

/// What an ingest need not find out, and which steps of its series it makes.
struct Given {
  std::vector<SequenceFile>
      files;  // of the series, in order; empty: those of IngestOptions::inputs
  std::vector<ScannedFile> scanned;  // what is in all of them; empty: the files are looked through
  int64_t part = 0, parts = 1;       // only this part of the steps (store::SourceInfo)
  std::string open_series;           // not empty: more files will come to this series
};

/// As Ingest.
[[nodiscard]] StatusOr<IngestReport> IngestGiven(
    const IngestOptions& options, const Given& given,
    const std::function<bool(const IngestProgress&)>& progress);

/// The first pass alone.
struct PlannedSeries {
  std::vector<ScannedFile> scanned;
  SeriesPlan plan;
  std::string series;  // SeriesIdentity
};
[[nodiscard]] StatusOr<PlannedSeries> PlanIngest(
    const IngestOptions& options, const std::function<bool(const IngestProgress&)>& progress);

/// 16 hex digits, the same for the same files (names without folders, and sizes) whose steps are
/// made of the same grids at the same times. How they are stored is not in it.
[[nodiscard]] std::string SeriesIdentity(const std::vector<ScannedFile>& files,
                                         const SeriesPlan& plan);
/// The same of a text.
[[nodiscard]] std::string IdentityOf(const std::string& text);

/// Bytes of the files that the steps of the plan are read from.
[[nodiscard]] uint64_t InputBytes(const std::vector<ScannedFile>& files, const SeriesPlan& plan);

}  // namespace fovea::ingest

#endif  // INGEST_GIVEN_H_
