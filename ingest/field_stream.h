#ifndef INGEST_FIELD_STREAM_H_
#define INGEST_FIELD_STREAM_H_

#include <memory>
#include <string>

#include "engine/base/status.h"
#include "engine/store/dataset_writer.h"
#include "engine/volume/basis.h"
#include "engine/volume/brick_grid.h"
#include "engine/wavelet/forward_stream.h"
#include "ingest/dense_field.h"

namespace fovea::ingest {

/// The one road of a field's voxels into a store: transformed, encoded and written as they come.
/// When it goes without Finish, the writer's step in hand is gone.
class FieldStream : private wavelet::DetailSink {
 public:
  /// The field `field` of the step in hand. `background` is that of sparse voxels.
  [[nodiscard]] static StatusOr<std::unique_ptr<FieldStream>> Start(store::DatasetWriter* writer,
                                                                    const std::string& field,
                                                                    const Basis& basis,
                                                                    float background, int threads);

  /// The next slices.
  [[nodiscard]] Status Push(DenseSlices slices);
  /// All voxels, at once.
  [[nodiscard]] Status Push(std::shared_ptr<const BrickGrid> voxels);
  [[nodiscard]] Status Finish(const FieldStats& stats);

 private:
  explicit FieldStream(std::unique_ptr<store::FieldWriter> writer) : writer_(std::move(writer)) {}

  [[nodiscard]] Status Take(const wavelet::DetailBrick& brick) override {
    return writer_->Add(brick.level, brick.at, brick.values, brick.largest);
  }
  [[nodiscard]] Status EndLayer(int level, int64_t z) override {
    return writer_->EndLayer(level, z);
  }

  std::unique_ptr<store::FieldWriter> writer_;
  std::unique_ptr<wavelet::ForwardStream> transform_;
};

}  // namespace fovea::ingest

#endif  // INGEST_FIELD_STREAM_H_
