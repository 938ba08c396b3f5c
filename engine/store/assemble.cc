#include "engine/store/assemble.h"

#include <algorithm>
#include <map>
#include <utility>

#include "engine/store/codec.h"
#include "engine/store/metadata.h"

namespace fovea::store {
namespace {

constexpr int64_t kCopyBytes = 8 << 20;

/// The chunk of a shard, or of a block of a table, that is `place`-th, x fastest.
Int3 ChunkAt(const Int3& block, const Int3& size, int64_t place) {
  return {block.x * size.x + place % size.x, block.y * size.y + place / size.x % size.y,
          block.z * size.z + place / (size.x * size.y)};
}

struct StoredChunk {
  size_t place = 0;
  ShardEntry entry;
};

Status CopyChunks(const ReadableFile& from, const std::vector<StoredChunk>& chunks,
                  ShardWriter* to) {
  std::vector<std::byte> bytes;
  for (const StoredChunk& chunk : chunks) {
    bytes.resize(chunk.entry.bytes);
    FOVEA_RETURN_IF_ERROR(from.ReadAt(static_cast<int64_t>(chunk.entry.offset), bytes));
    FOVEA_RETURN_IF_ERROR(to->Append(chunk.place, bytes));
  }
  return to->Finish();
}

}  // namespace

StatusOr<Cut> CutShard(FileSystem& files, const LevelLayout& layout, const RetainedChunks& retained,
                       const Int3& shard, const std::string& from, const std::string& to,
                       FileBatch* batch, CutCounts* counts) {
  FOVEA_ASSIGN_OR_RETURN(const ReadableFile file, ReadableFile::Open(files, from));
  const auto places = static_cast<size_t>(layout.shard_chunks.Product());
  FOVEA_ASSIGN_OR_RETURN(const ShardIndex index,
                         ReadShardIndex(file, places, MaxEncodedBytes(layout.ChunkBytes())));
  std::vector<StoredChunk> kept;
  uint64_t dropped = 0;
  for (size_t place = 0; place < places; ++place) {
    if (!index[place]) {
      continue;
    }
    const Int3 chunk = ChunkAt(shard, layout.shard_chunks, static_cast<int64_t>(place));
    if (retained.Keeps(layout.level, chunk)) {
      kept.push_back({place, *index[place]});
    } else {
      ++dropped;
      counts->bytes_dropped += index[place]->bytes;
    }
  }
  counts->chunks_kept += kept.size();
  counts->chunks_dropped += dropped;
  if (dropped == 0) {
    return Cut::kKeep;
  }
  if (kept.empty()) {
    return Cut::kRemove;
  }
  std::sort(kept.begin(), kept.end(), [](const StoredChunk& a, const StoredChunk& b) {
    return a.entry.offset < b.entry.offset;
  });
  FOVEA_ASSIGN_OR_RETURN(ShardWriter writer, ShardWriter::Start(batch, to, places));
  FOVEA_RETURN_IF_ERROR(CopyChunks(file, kept, &writer));
  return Cut::kReplace;
}

StatusOr<Cut> CutTable(FileSystem& files, const LevelLayout& layout, const RetainedChunks& retained,
                       const Int3& block, const std::string& from, const std::string& to,
                       FileBatch* batch) {
  std::vector<float> largest(static_cast<size_t>(layout.table_edge.Product()));
  FOVEA_RETURN_IF_ERROR(
      ReadChunkFile(files, from, std::as_writable_bytes(std::span(largest))).status());
  bool any_kept = false;
  bool any_dropped = false;
  for (size_t place = 0; place < largest.size(); ++place) {
    if (largest[place] == 0) {
      continue;
    }
    const Int3 chunk = ChunkAt(block, layout.table_edge, static_cast<int64_t>(place));
    if (retained.Keeps(layout.level, chunk)) {
      any_kept = true;
    } else {
      any_dropped = true;
      largest[place] = 0;
    }
  }
  if (!any_dropped) {
    return Cut::kKeep;
  }
  if (!any_kept) {
    return Cut::kRemove;
  }
  Encoder encoder;
  FOVEA_ASSIGN_OR_RETURN(const std::vector<std::byte> encoded,
                         encoder.Encode(std::as_bytes(std::span(largest))));
  FOVEA_RETURN_IF_ERROR(batch->Write(to, encoded));
  return Cut::kReplace;
}

namespace {

Status CopyFile(FileSystem& files, const std::string& from, const std::string& to,
                FileBatch* batch) {
  FOVEA_ASSIGN_OR_RETURN(const ReadableFile in, ReadableFile::Open(files, from));
  FOVEA_ASSIGN_OR_RETURN(WritableFile out, batch->Start(to));
  std::vector<std::byte> bytes(static_cast<size_t>(std::min(in.size(), kCopyBytes)));
  for (int64_t at = 0; at < in.size();) {
    const auto some = std::span(bytes).first(
        static_cast<size_t>(std::min<int64_t>(in.size() - at, std::ssize(bytes))));
    FOVEA_RETURN_IF_ERROR(in.ReadAt(at, some));
    FOVEA_RETURN_IF_ERROR(out.Append(some));
    at += std::ssize(some);
  }
  return absl::OkStatus();
}

/// Rows of a small array over steps, of all pieces, written as chunks of one store.
class Rows {
 public:
  Rows(FileSystem& files, const std::string& path, std::span<const Piece> pieces, FileBatch* batch)
      : files_(files), path_(path), pieces_(pieces), batch_(batch) {}

  template <typename T>
  [[nodiscard]] Status Copy(const std::string& array, int64_t steps_in_chunk, int64_t width,
                            T fill) {
    const bool has_rows = width != 0;
    SeriesChunk<T> out(steps_in_chunk, has_rows ? width : 1, fill);
    int64_t step = 0;
    for (const Piece& piece : pieces_) {
      SeriesChunk<T> in = out;
      for (int64_t at = 0; at < piece.info.committed_steps; ++at, ++step) {
        if (at % steps_in_chunk == 0) {
          FOVEA_ASSIGN_OR_RETURN(
              in, ReadSeries<T>(files_, piece.path, array, at, steps_in_chunk, width));
        }
        const std::span<T> row = in.Row(at);
        std::copy(row.begin(), row.end(), out.Row(step).begin());
        if ((step + 1) % steps_in_chunk == 0) {
          FOVEA_RETURN_IF_ERROR(Write(array, step, has_rows, &out));
          std::fill(out.values.begin(), out.values.end(), fill);
        }
      }
    }
    return step % steps_in_chunk == 0 ? absl::OkStatus() : Write(array, step - 1, has_rows, &out);
  }

 private:
  template <typename T>
  [[nodiscard]] Status Write(const std::string& array, int64_t step, bool has_rows,
                             SeriesChunk<T>* chunk) {
    Encoder encoder;
    FOVEA_ASSIGN_OR_RETURN(const std::vector<std::byte> encoded, encoder.Encode(chunk->Bytes()));
    return batch_->Write(SeriesPath(path_, array, step, chunk->steps, has_rows), encoded);
  }

  FileSystem& files_;
  const std::string& path_;
  std::span<const Piece> pieces_;
  FileBatch* batch_;
};

class Assembler {
 public:
  Assembler(FileSystem& files, const std::string& path, const DatasetInfo& info,
            const RetainedChunks& retained, CutCounts* counts)
      : files_(files), path_(path), info_(info), retained_(retained), counts_(counts) {}

  /// The files of all steps of `piece`, which become the steps from `first` on.
  [[nodiscard]] Status AddSteps(const Piece& piece, int64_t first,
                                const std::function<bool()>& go_on);
  [[nodiscard]] Status Commit(std::span<const Piece> pieces);

 private:
  /// Cuts one file of detail or of its tables; kKeep for any other.
  [[nodiscard]] StatusOr<Cut> CutFile(const ArraySpec& array, const std::vector<int64_t>& indices,
                                      const std::string& from, const std::string& to,
                                      FileBatch* batch);
  [[nodiscard]] Status AddArray(const Piece& piece, const ArraySpec& array, int64_t first);
  [[nodiscard]] Status CheckTimes(std::span<const Piece> pieces);
  [[nodiscard]] DatasetInfo InfoAfter(std::span<const Piece> pieces) const;

  FileSystem& files_;
  const std::string& path_;
  const DatasetInfo& info_;
  const RetainedChunks& retained_;
  CutCounts* counts_;
  bool can_link_ = true;
};

StatusOr<Cut> Assembler::CutFile(const ArraySpec& array, const std::vector<int64_t>& indices,
                                 const std::string& from, const std::string& to, FileBatch* batch) {
  for (const FieldInfo& field : info_.fields) {
    for (int level = 0; !retained_.KeepsAll() && level < info_.hierarchy.finest(); ++level) {
      const LevelLayout layout = LevelLayout::Make(info_, field, level);
      const Int3 at{indices.back(), indices[indices.size() - 2], indices[indices.size() - 3]};
      if (array.path == DetailPath(field.name, layout.width)) {
        return CutShard(files_, layout, retained_, at, from, to, batch, counts_);
      }
      if (array.path == TablePath(field.name, layout.width)) {
        return CutTable(files_, layout, retained_, at, from, to, batch);
      }
    }
  }
  return Cut::kKeep;
}

Status Assembler::AddArray(const Piece& piece, const ArraySpec& array, int64_t first) {
  const std::string from_folder = fmt::format("{}/{}", piece.path, array.path);
  const std::string to_folder = fmt::format("{}/{}", path_, array.path);
  FOVEA_ASSIGN_OR_RETURN(std::vector<std::string> names, ListDirectory(files_, from_folder));
  std::sort(names.begin(), names.end());
  FileBatch batch(files_);
  int64_t added = 0;
  for (const std::string& name : names) {
    auto indices = ParseChunkName(name, array.shape.size() + 1);
    if (!indices || indices->front() >= piece.info.committed_steps) {
      continue;  // metadata, temporary files, a step that is not committed
    }
    const std::string from = fmt::format("{}/{}", from_folder, name);
    ++added;
    indices->front() += first;
    const std::string to = fmt::format("{}/{}", to_folder, ChunkName(*indices));
    FOVEA_ASSIGN_OR_RETURN(const Cut cut, CutFile(array, *indices, from, to, &batch));
    if (cut != Cut::kKeep) {
      continue;
    }
    can_link_ = can_link_ && files_.Link(from, to) >= 0;
    if (!can_link_) {  // another file system, or one without links
      FOVEA_RETURN_IF_ERROR(CopyFile(files_, from, to, &batch));
    }
  }
  for (const FieldInfo& field : piece.info.fields) {
    const int64_t steps = piece.info.committed_steps - std::ssize(field.lost_steps);
    if (array.path == CoarsePath(field.name) && added != steps) {
      return DataLoss("{} has {} files for {} steps: `fovea verify {}` says what is lost",
                      from_folder, added, steps, piece.path);
    }
  }
  FOVEA_RETURN_IF_ERROR(batch.Flush());
  FOVEA_RETURN_IF_ERROR(batch.Publish());
  return FlushDirectory(files_, to_folder);
}

Status Assembler::AddSteps(const Piece& piece, int64_t first, const std::function<bool()>& go_on) {
  for (const ArraySpec& array : AllArrays(info_)) {
    if (!go_on()) {
      return Cancelled("stopped; nothing was committed in {}: the same command begins again",
                       path_);
    }
    if (array.FileSteps() == 1) {
      FOVEA_RETURN_IF_ERROR(AddArray(piece, array, first));
    }
  }
  return absl::OkStatus();
}

/// Pieces must follow one another in time.
Status Assembler::CheckTimes(std::span<const Piece> pieces) {
  const Piece* before = nullptr;
  const auto time_of = [&](const Piece& piece, int64_t step) -> StatusOr<int64_t> {
    FOVEA_ASSIGN_OR_RETURN(
        SeriesChunk<int64_t> times,
        ReadSeries<int64_t>(files_, piece.path, std::string(kTimePath), step, kSeriesSteps, 0));
    return times.Row(step)[0];
  };
  for (const Piece& piece : pieces) {
    if (piece.info.committed_steps == 0) {
      continue;
    }
    if (before != nullptr) {
      FOVEA_ASSIGN_OR_RETURN(const int64_t last,
                             time_of(*before, before->info.committed_steps - 1));
      FOVEA_ASSIGN_OR_RETURN(const int64_t next, time_of(piece, 0));
      if (next < last) {
        return InvalidArgument("{} begins at {} ns, before the end of {} at {} ns", piece.path,
                               next, before->path, last);
      }
    }
    before = &piece;
  }
  return absl::OkStatus();
}

DatasetInfo Assembler::InfoAfter(std::span<const Piece> pieces) const {
  DatasetInfo info = info_;
  info.committed_steps = 0;
  for (const Piece& piece : pieces) {
    if (piece.info.committed_steps == 0) {
      continue;
    }
    for (size_t i = 0; i < info.fields.size(); ++i) {
      FieldInfo& field = info.fields[i];
      const FieldInfo& more = piece.info.fields[i];
      const bool first = info.committed_steps == 0;
      field.minimum = first ? more.minimum : std::min(field.minimum, more.minimum);
      field.maximum = first ? more.maximum : std::max(field.maximum, more.maximum);
      field.max_error = std::max(field.max_error, more.max_error);
      for (const int64_t lost : more.lost_steps) {
        field.lost_steps.push_back(info.committed_steps + lost);
      }
    }
    info.committed_steps += piece.info.committed_steps;
  }
  return info;
}

Status Assembler::Commit(std::span<const Piece> pieces) {
  FOVEA_RETURN_IF_ERROR(CheckTimes(pieces));
  const DatasetInfo info = InfoAfter(pieces);
  FileBatch batch(files_);
  Rows rows(files_, path_, pieces, &batch);
  FOVEA_RETURN_IF_ERROR(rows.Copy<int64_t>(std::string(kTimePath), kSeriesSteps, 0, 0));
  FOVEA_RETURN_IF_ERROR(
      rows.Copy<int64_t>(std::string(kFrameNumberPath), kSeriesSteps, 0, kNoFrameNumber));
  for (const FieldInfo& field : info.fields) {
    FOVEA_RETURN_IF_ERROR(rows.Copy<double>(StatsPath(field.name), kSeriesSteps, 2, 0));
    FOVEA_RETURN_IF_ERROR(rows.Copy<uint64_t>(HistogramPath(field.name), kHistogramSteps, 256, 0));
  }
  const auto write = [&](const std::string& folder, std::string_view text) {
    return batch.Write(fmt::format("{}/{}", folder, kMetadataName), std::as_bytes(std::span(text)));
  };
  for (const ArraySpec& array : AllArrays(info)) {
    FOVEA_RETURN_IF_ERROR(
        write(fmt::format("{}/{}", path_, array.path), ArrayJson(array, info.committed_steps)));
  }
  FOVEA_ASSIGN_OR_RETURN(const std::string copy, GroupCopyJson(info));
  FOVEA_RETURN_IF_ERROR(
      batch.Write(fmt::format("{}/{}", path_, kGroupCopyName), std::as_bytes(std::span(copy))));
  FOVEA_ASSIGN_OR_RETURN(const std::string group, GroupJson(info));
  FOVEA_RETURN_IF_ERROR(write(path_, group));
  FOVEA_RETURN_IF_ERROR(batch.Flush());
  return batch.Publish();
}

}  // namespace

Status Assemble(FileSystem& files, const std::string& path, const DatasetInfo& info,
                std::span<const Piece> pieces, const StepProgress& progress, CutCounts* counts) {
  FOVEA_ASSIGN_OR_RETURN(const RetainedChunks retained, RetainedChunks::Make(info));
  int64_t total = 0;
  for (const Piece& piece : pieces) {
    total += piece.info.committed_steps;
  }
  Assembler assembler(files, path, info, retained, counts);
  int64_t done = 0;
  for (const Piece& piece : pieces) {
    const auto go_on = [&] { return !progress || progress(done, total); };
    FOVEA_RETURN_IF_ERROR(assembler.AddSteps(piece, done, go_on));
    done += piece.info.committed_steps;
  }
  FOVEA_RETURN_IF_ERROR(assembler.Commit(pieces));
  if (progress) {
    static_cast<void>(progress(total, total));
  }
  return absl::OkStatus();
}

}  // namespace fovea::store
