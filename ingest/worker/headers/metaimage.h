#ifndef INGEST_WORKER_HEADERS_METAIMAGE_H_
#define INGEST_WORKER_HEADERS_METAIMAGE_H_

#include <string_view>

#include "engine/base/status.h"
#include "ingest/worker/headers/dense_header.h"

namespace fovea::ingest {

/// The header of a MetaImage (MHA, MHD), which `bytes` begin with, up to its ElementDataFile. Two,
/// three or four dimensions (the fourth: steps). Binary data, plain or CompressedData.
[[nodiscard]] StatusOr<DenseHeader> ParseMetaImage(std::string_view bytes);

}  // namespace fovea::ingest

#endif  // INGEST_WORKER_HEADERS_METAIMAGE_H_
