#ifndef ENGINE_STORE_DATASET_WRITER_H_
#define ENGINE_STORE_DATASET_WRITER_H_

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/store/dataset.h"
#include "engine/store/field_writer.h"
#include "engine/store/file_system.h"
#include "engine/volume/coefficient_set.h"

namespace fovea::store {

/// Appends time steps to a store, one or several a commit. One writer at a time: the lock says who
/// holds it (host, process, since when) and goes with its process. A writer that was killed loses
/// the step in hand and what was not published; the next one sweeps up behind it. Not thread-safe.
///
/// Commit order: shards written and flushed, arrays' `t` extended (each zarr.json replaced
/// atomically), last the group's zarr.json with the new committed_steps.
class DatasetWriter {
 public:
  /// A new, empty store. ALREADY_EXISTS if `path` exists (unless it is an empty directory).
  /// `info` gives all but committed_steps and value ranges; field names must be usable as folder
  /// names ([A-Za-z0-9_.-]+, not starting with '.').
  [[nodiscard]] static StatusOr<std::unique_ptr<DatasetWriter>> Create(
      const std::string& path, const DatasetInfo& info, FileSystem& files = RealFileSystem());
  /// Opens an existing store to append. FAILED_PRECONDITION if another writer holds it.
  [[nodiscard]] static StatusOr<std::unique_ptr<DatasetWriter>> Append(
      const std::string& path, FileSystem& files = RealFileSystem());
  virtual ~DatasetWriter() = default;

  [[nodiscard]] virtual const DatasetInfo& info() const = 0;
  /// Begins one field of the step in hand (behind all that were ended), to be written in layers.
  /// Every field once before Commit. Several may be begun and written at once, each by a thread of
  /// its own; the other calls have to wait for all. NOT_FOUND if there is no such field.
  [[nodiscard]] virtual StatusOr<std::unique_ptr<FieldWriter>> BeginField(
      const std::string& field) = 0;
  /// The same with coefficients that are all in memory. INVALID_ARGUMENT if the coefficients are
  /// not of this store's dimensions, chunk edge and wavelet, or not finite. After any error of this
  /// call or of Commit the step in hand is gone: write all its fields again, or stop.
  [[nodiscard]] virtual Status WriteField(const std::string& field,
                                          const CoefficientSet& coefficients,
                                          const FieldStats& stats) = 0;
  /// Of a quantised field of the step in hand: the largest difference between its voxels and what
  /// its coefficients give back.
  virtual void NoteMaxError(const std::string& field, double max_error) = 0;
  /// Ends the step in hand; it becomes visible with the next Commit of one behind it, or Publish,
  /// and is lost if the process dies before. Many small steps are far cheaper to publish together.
  /// After kMostStepsAtOnce (layout.h) of them it publishes by itself. Errors as of Commit.
  [[nodiscard]] virtual Status EndStep(int64_t time_ns, std::optional<int64_t> frame_number) = 0;
  /// Makes the steps that were ended visible, all at once. An error takes all of them.
  [[nodiscard]] virtual Status Publish() = 0;
  /// Both: makes the step in hand visible. `time_ns` must not be less than the last step's.
  /// RESOURCE_EXHAUSTED when the disk is full, and the store stays as it was. If the message says
  /// that the step may not have been committed, the disk failed between the first rename and the
  /// last flush: open the store again to know, and to go on.
  [[nodiscard]] Status Commit(int64_t time_ns, std::optional<int64_t> frame_number) {
    FOVEA_RETURN_IF_ERROR(EndStep(time_ns, frame_number));
    return Publish();
  }
};

}  // namespace fovea::store

#endif  // ENGINE_STORE_DATASET_WRITER_H_
