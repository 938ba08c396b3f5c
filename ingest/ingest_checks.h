#ifndef INGEST_INGEST_CHECKS_H_
#define INGEST_INGEST_CHECKS_H_

#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/store/dataset.h"
#include "ingest/ingest.h"
#include "ingest/series_plan.h"

namespace fovea::ingest {

/// Whether what is asked of the coefficients goes together: wavelet, lossless, tolerance.
[[nodiscard]] Status CheckCoding(const IngestOptions& options);

/// What can be known of options before any file is opened: INVALID_ARGUMENT names what does not go
/// together, ALREADY_EXISTS an output that is neither empty nor a store.
[[nodiscard]] Status CheckIngestOptions(const IngestOptions& options);

/// ALREADY_EXISTS: the output is there, `why` (", made of other files") it cannot be gone on with.
[[nodiscard]] Status IsThere(const IngestOptions& options, const std::string& why);

/// What `there`, which is not of the series `wanted`, was made of otherwise, for IsThere: the flag
/// that says it and both values where that can be told. `plan` has the steps of `wanted`.
[[nodiscard]] std::string SeriesDifference(const IngestOptions& options,
                                           const store::DatasetInfo& there,
                                           const store::SourceInfo& wanted, const SeriesPlan& plan);
/// The same of a store of the series that was made otherwise: `what` is
/// store::DifferenceInMaking's.
[[nodiscard]] std::string MakingDifference(const std::string& what, const store::DatasetInfo& there,
                                           const store::DatasetInfo& wanted);

/// What whole numbers of the files (SeriesPlan::source_types) become without loss: "int16" of 8
/// bits, "int32" of 16. INVALID_ARGUMENT for any other type.
[[nodiscard]] StatusOr<std::string> LosslessType(const std::vector<std::string>& source_types);

}  // namespace fovea::ingest

#endif  // INGEST_INGEST_CHECKS_H_
