#ifndef INGEST_WORKER_HEADERS_NRRD_H_
#define INGEST_WORKER_HEADERS_NRRD_H_

#include <string_view>

#include "engine/base/status.h"
#include "ingest/worker/headers/dense_header.h"

namespace fovea::ingest {

/// The header of an NRRD or NHDR file, which `bytes` begin with; what follows the empty line is not
/// looked at. Format: teem.sourceforge.net/nrrd/format.html, versions 1 to 5. Axes of kind time or
/// list are steps, of vector, color and matrix kinds channels; of four axes that say nothing the
/// last is the steps. Encodings raw and gzip; other ones are an error that says what to do.
[[nodiscard]] StatusOr<DenseHeader> ParseNrrd(std::string_view bytes);

}  // namespace fovea::ingest

#endif  // INGEST_WORKER_HEADERS_NRRD_H_
