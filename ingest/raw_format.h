#ifndef INGEST_RAW_FORMAT_H_
#define INGEST_RAW_FORMAT_H_

#include <cstdint>
#include <string>

#include "engine/base/status.h"
#include "ingest/ingest.h"

namespace fovea::ingest {

/// Bytes of one value of `type`; 0 if it is none of RawFormat's types.
[[nodiscard]] int64_t BytesPerValue(const std::string& type);

/// INVALID_ARGUMENT unless the type is known, the sizes are positive and within bounds, and the
/// bytes of a file fit 63 bits.
[[nodiscard]] Status CheckRawFormat(const RawFormat& format);

/// Bytes of one time step, and of a file. `format` has passed CheckRawFormat.
[[nodiscard]] int64_t BytesPerStep(const RawFormat& format);
[[nodiscard]] int64_t BytesPerFile(const RawFormat& format);

/// How BytesPerFile comes about: "0 header bytes + 1 step x 2 x 3 x 4 voxels x 2 bytes (uint16)".
[[nodiscard]] std::string DescribeFileSize(const RawFormat& format);

}  // namespace fovea::ingest

#endif  // INGEST_RAW_FORMAT_H_
