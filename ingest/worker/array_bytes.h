#ifndef INGEST_WORKER_ARRAY_BYTES_H_
#define INGEST_WORKER_ARRAY_BYTES_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "ingest/worker/headers/dense_header.h"

namespace fovea::ingest {

/// The bytes of the array that a header describes, decoded, in order, from wherever they lie.
class ArrayBytes {
 public:
  virtual ~ArrayBytes() = default;
  [[nodiscard]] virtual Status Read(std::span<std::byte> out) = 0;
  /// Passes over bytes.
  [[nodiscard]] virtual Status Skip(int64_t bytes) = 0;
};

/// `paths` are the files that hold the array, in order: the header's own file, or its data files.
/// What they can hold is checked against the header before anything is allocated: INVALID_ARGUMENT
/// with the sum where a file is too short. `file_bytes` gets the size of all of them, and
/// `warnings` what is odd (a file longer than it needs to be). Inflation stops at the declared
/// size.
[[nodiscard]] StatusOr<std::unique_ptr<ArrayBytes>> OpenArray(const DenseHeader& header,
                                                              const std::vector<std::string>& paths,
                                                              int64_t* file_bytes,
                                                              std::vector<std::string>* warnings);

}  // namespace fovea::ingest

#endif  // INGEST_WORKER_ARRAY_BYTES_H_
