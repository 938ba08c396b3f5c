#ifndef INGEST_WORKER_DENSE_SENDER_H_
#define INGEST_WORKER_DENSE_SENDER_H_

#include <cstddef>
#include <span>

#include "engine/base/status.h"
#include "engine/volume/geometry.h"
#include "ingest/channel.h"
#include "ingest/sample_type.h"

namespace fovea::ingest {

/// How the samples of one step of dense voxels are to be understood.
struct DenseFormat {
  Int3 dims;
  SampleType type = SampleType::kUint8;
  bool big_endian = false;
  double slope = 1, intercept = 0;  // value = slope x sample + intercept

  /// Whether a sample is its value.
  [[nodiscard]] bool IsIdentity() const { return slope == 1 && intercept == 0; }
};

/// The samples of one step, one after another: x fastest, then y, then z. Every reader of dense
/// voxels gives its samples out this way, as they lie in the file, and SendDense does the rest.
class DenseSamples {
 public:
  virtual ~DenseSamples() = default;
  /// Fills `out`, which is whole samples, with the next ones. Errors do not name the file.
  [[nodiscard]] virtual Status ReadNext(std::span<std::byte> out) = 0;
};

/// Sends one step as the only field of an answer; voxels of the extent beyond `format.dims` are 0.
/// Holds no more than a slab (slab_ring.h).
[[nodiscard]] Status SendDense(const DenseFormat& format, const Box3& extent, DenseSamples* samples,
                               Channel* channel);

}  // namespace fovea::ingest

#endif  // INGEST_WORKER_DENSE_SENDER_H_
