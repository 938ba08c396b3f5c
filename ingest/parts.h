#ifndef INGEST_PARTS_H_
#define INGEST_PARTS_H_

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "ingest/given.h"
#include "ingest/ingest.h"

/// A series ingested in parts, on any machines that see its files: a plan is made once, each
/// machine makes parts of it, and `fovea merge` (engine/store/merge.h) joins them.
namespace fovea::ingest {

/// What a plan file says.
struct PlanFile {
  std::vector<std::string> arguments;  // of the command line that made it
  std::vector<ScannedFile> scanned;    // paths are absolute
  std::string series;                  // SeriesIdentity
  int64_t steps = 0;
};

/// Looks through all files and writes what is in them to `path`, a JSON file; it appears whole or
/// not at all. `arguments` are kept with it.
[[nodiscard]] StatusOr<PlannedSeries> WritePlan(
    const IngestOptions& options, const std::vector<std::string>& arguments,
    const std::string& path, const std::function<bool(const IngestProgress&)>& progress);

/// NOT_FOUND if there is none, DATA_LOSS if it is damaged or was edited, FAILED_PRECONDITION if it
/// is none or of another version.
[[nodiscard]] StatusOr<PlanFile> ReadPlan(const std::string& path);

/// Makes part `part` of `parts` of a plan in store::PartPath(options.output, ...); with one part,
/// in options.output itself. Goes on where it was stopped; does nothing if it is complete.
/// `options` are those that the plan was made with.
[[nodiscard]] StatusOr<IngestReport> IngestPart(
    const IngestOptions& options, const PlanFile& plan, int64_t part, int64_t parts,
    const std::function<bool(const IngestProgress&)>& progress);

}  // namespace fovea::ingest

#endif  // INGEST_PARTS_H_
