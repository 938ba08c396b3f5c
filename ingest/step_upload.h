#ifndef INGEST_STEP_UPLOAD_H_
#define INGEST_STEP_UPLOAD_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/store/dataset.h"
#include "engine/store/dataset_writer.h"
#include "engine/volume/basis.h"
#include "engine/volume/geometry.h"
#include "ingest/dense_field.h"
#include "ingest/field_stream.h"
#include "ingest/protocol.h"

namespace fovea::ingest {

/// One field of a step that comes as bytes.
struct UploadField {
  std::string name;
  DenseType type = DenseType::kFloat32;  // little-endian
  std::string value_unit;                // of a new dataset
};

/// A step that comes as bytes, and the dataset that it is to be a step of.
struct UploadPlan {
  int64_t step = 0;
  int64_t time_ns = 0;
  std::optional<int64_t> frame_number;
  Int3 dims;
  std::vector<UploadField> fields;  // in the order in which they come; at least one
  /// Where the dataset is there they must be as it has them, if they are given.
  std::optional<Wavelet> wavelet;  // default Haar
  bool lossless = false;
  std::optional<int64_t> chunk_edge;      // 8, 16 or 32; default 16
  std::optional<Matrix4> index_to_world;  // of a new one: the identity
  std::optional<store::SourceInfo> source;
  std::string world_unit;  // of a new dataset
};

/// The bytes of one field.
[[nodiscard]] int64_t BytesOf(const UploadPlan& plan, size_t field);
/// Voxels of one step, in pieces as they come, into a store whose writer it is: transformed,
/// encoded and written on the way, by what ingest does it with, so that the store is what `fovea
/// ingest` would make of the same voxels. Not thread-safe.
class StepUpload {
 public:
  /// What it may take at a time, in bytes: some layers of voxels and of coefficients.
  [[nodiscard]] static int64_t WorkingBytes(const UploadPlan& plan);

  /// Makes the store at `path`, or goes on with it. FAILED_PRECONDITION if another writes to it, it
  /// is otherwise than `plan` says, or the step is neither its next one nor one that it has, of
  /// that time and number; INVALID_ARGUMENT if a new one cannot be so. `threads` as in ingest.
  [[nodiscard]] static StatusOr<std::unique_ptr<StepUpload>> Open(const std::string& path,
                                                                  const UploadPlan& plan,
                                                                  int threads);
  /// Removes a store that it made and that has no step. A step that was not committed is dropped.
  ~StepUpload();
  StepUpload(const StepUpload&) = delete;
  StepUpload& operator=(const StepUpload&) = delete;

  /// The step is committed, from the start (no bytes are wanted then) or by Commit.
  [[nodiscard]] bool committed() const { return plan_.step < committed_steps(); }
  [[nodiscard]] int64_t committed_steps() const { return writer_->info().committed_steps; }
  [[nodiscard]] uint64_t nonfinite_values() const { return nonfinite_; }

  /// Which bytes are the next ones: x fastest, then y, then z, then the next field.
  struct Awaited {
    size_t field = 0;
    int64_t offset = 0;  // of the first one, in its field
    int64_t bytes = 0;   // to the end of the field; 0: all came
  };
  [[nodiscard]] Awaited awaited() const;
  /// Takes bytes of the field that is awaited, at most to its end. NaN and infinity become 0, and
  /// are counted. After an error it can only be destroyed.
  [[nodiscard]] Status Add(std::span<const std::byte> bytes);
  /// All bytes came.
  [[nodiscard]] bool complete() const { return field_ == plan_.fields.size(); }
  /// Of a step that is complete.
  [[nodiscard]] Status Commit();

 private:
  StepUpload(std::string path, UploadPlan plan, int threads)
      : path_(std::move(path)), plan_(std::move(plan)), threads_(threads) {}

  [[nodiscard]] Status OpenStore();
  [[nodiscard]] Status Create();
  [[nodiscard]] Status CheckStore() const;
  [[nodiscard]] Status CheckStep() const;
  [[nodiscard]] StatusOr<std::string> StoredType() const;
  [[nodiscard]] Status StartField();
  [[nodiscard]] Status EndField();
  [[nodiscard]] Status AddRows(std::span<const std::byte> bytes);

  const std::string path_;
  const UploadPlan plan_;
  const int threads_;
  std::unique_ptr<store::DatasetWriter> writer_;
  bool made_store_ = false;
  Basis basis_;
  // The field in hand:
  size_t field_ = 0;
  int64_t came_ = 0;             // bytes
  std::vector<std::byte> part_;  // of a row
  std::unique_ptr<DenseField> dense_;
  std::unique_ptr<FieldStream> stream_;
  uint64_t nonfinite_ = 0;
};

}  // namespace fovea::ingest

#endif  // INGEST_STEP_UPLOAD_H_
