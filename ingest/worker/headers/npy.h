#ifndef INGEST_WORKER_HEADERS_NPY_H_
#define INGEST_WORKER_HEADERS_NPY_H_

#include <string>
#include <string_view>

#include "engine/base/status.h"
#include "ingest/worker/headers/dense_header.h"

namespace fovea::ingest {

/// The header of a NumPy array file, versions 1 to 3, which `bytes` begin with. `axes` says what
/// the axes of the array are, in the order of its shape: a letter of "txyzc" each (step, space,
/// channel). Empty: zyx of three, tzyx of four, yx of two, and five need it.
[[nodiscard]] StatusOr<DenseHeader> ParseNpy(std::string_view bytes, const std::string& axes);

}  // namespace fovea::ingest

#endif  // INGEST_WORKER_HEADERS_NPY_H_
