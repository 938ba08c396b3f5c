#ifndef ENGINE_STORE_FIELD_WRITER_H_
#define ENGINE_STORE_FIELD_WRITER_H_

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/store/dataset.h"
#include "engine/store/level_writer.h"
#include "engine/store/retention.h"
#include "engine/volume/coefficient_set.h"

namespace fovea::store {

/// Writes one field of a step as its coefficients are made: levels by turns, each in layers of
/// chunks (one z) from the first on. Memory is one layer a level, encoded. Made by
/// DatasetWriter::BeginField, which must outlive it; after an error, or when it goes without
/// Finish, the step in hand is gone. Several, of different fields, may be at work at once.
class FieldWriter {
 public:
  /// What became of the field: its statistics, or null; and its files.
  using OnEnd = std::function<void(const FieldStats* stats, FileBatch* files)>;

  /// `on_end` is called once.
  FieldWriter(FileSystem& files, const std::string& store_path, const DatasetInfo& info,
              std::string field, EncoderPool* encoders, OnEnd on_end);
  ~FieldWriter();
  FieldWriter(const FieldWriter&) = delete;
  FieldWriter& operator=(const FieldWriter&) = delete;

  /// Of the coefficients of a level: what `Add` takes.
  [[nodiscard]] const Coding& coding(int level) const {
    return levels_[static_cast<size_t>(level)]->layout().coding;
  }
  /// Encodes the chunk at `at` of detail level `level`: [7][z][y][x] values as coding() says, as in
  /// memory, zeros past the border; `largest` is their largest magnitude, above 0 (chunks of zeros
  /// are left out, and so are those that the store does not retain). From any number of threads,
  /// for chunks of one layer. INVALID_ARGUMENT if `largest` is not finite.
  [[nodiscard]] Status Add(int level, const Int3& at, std::span<const std::byte> values,
                           float largest);
  /// All chunks of `level` at this z were added; ascending. Layers without any may be left out.
  [[nodiscard]] Status EndLayer(int level, int64_t z);
  /// The last call. INVALID_ARGUMENT if `coarse` is not LLL_0, or something is not finite.
  [[nodiscard]] Status Finish(const Grid& coarse, const FieldStats& stats);

 private:
  [[nodiscard]] Status WriteCoarse(const Grid& coarse);
  [[nodiscard]] Status FinishFiles(const Grid& coarse, const FieldStats& stats);

  std::string store_path_, field_;
  Coding coarse_coding_;
  int64_t step_;
  Int3 coarse_dims_;
  RetainedChunks retained_;
  EncoderPool* encoders_;
  FileBatch batch_;
  OnEnd on_end_;
  std::vector<std::unique_ptr<LevelWriter>> levels_;
};

/// INVALID_ARGUMENT unless coefficients are of the store's dimensions, chunk edge, wavelet and, for
/// this field, type.
[[nodiscard]] Status CheckCoefficients(const DatasetInfo& info, const std::string& field,
                                       const CoefficientSet& coefficients);
/// Writes coefficients that are in memory, all detail of a field: what DatasetWriter::WriteField
/// does. `set` must fit the store.
[[nodiscard]] Status AddAllDetail(const CoefficientSet& set, FieldWriter* writer);

}  // namespace fovea::store

#endif  // ENGINE_STORE_FIELD_WRITER_H_
