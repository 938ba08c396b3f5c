#ifndef INGEST_SPARSE_FIELDS_H_
#define INGEST_SPARSE_FIELDS_H_

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "engine/base/status.h"
#include "engine/store/dataset_writer.h"
#include "engine/volume/basis.h"
#include "engine/volume/brick_grid.h"

namespace fovea::ingest {

/// Sparse fields of a step on their way into a store. Of a large one, all threads make the layers
/// together; there is too little in the layers of a small one for that, so small ones wait for each
/// other, and each is made by one thread.
class SparseFields {
 public:
  /// `threads` as in IngestOptions.
  SparseFields(const Basis& basis, int threads) : basis_(basis), threads_(threads) {}

  void Add(std::string field, BrickGrid voxels);
  /// Write must be called before more is added.
  [[nodiscard]] bool IsFull() const { return bytes_ > kMostBytes; }
  [[nodiscard]] bool empty() const { return fields_.empty(); }
  /// Writes what was added, with its statistics, as fields of the step in hand.
  [[nodiscard]] Status Write(store::DatasetWriter* writer);

 private:
  static constexpr int64_t kMostBytes = 16 << 20;

  Basis basis_;
  int threads_;
  std::vector<std::pair<std::string, BrickGrid>> fields_;
  int64_t bytes_ = 0;  // of their bricks
};

}  // namespace fovea::ingest

#endif  // INGEST_SPARSE_FIELDS_H_
