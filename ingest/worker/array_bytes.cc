#include "ingest/worker/array_bytes.h"

#include <algorithm>
#include <array>
#include <filesystem>
#include <limits>
#include <utility>

#include <zlib.h>

#include "ingest/worker/input_file.h"

namespace fovea::ingest {
namespace {

constexpr int64_t kMaxInflation = 1032;  // what deflate can make of a byte at most
constexpr size_t kPieceBytes = 256U << 10;

std::string NameOf(const std::string& path) {
  return std::filesystem::path(path).filename().string();
}

/// A file and where in it (or in what it inflates to) its part of the array lies.
struct Part {
  std::string path;
  int64_t file_bytes = 0;
  int64_t begin = 0;  // in the file
  int64_t skip = 0;   // bytes after inflation
  int64_t count = 0;  // of the array
};

/// Where the line after the first `lines` begins.
StatusOr<int64_t> SkipLines(const InputFile& file, int64_t lines) {
  int64_t position = 0;
  std::vector<std::byte> piece(kPieceBytes);
  while (lines > 0) {
    const int64_t count =
        std::min<int64_t>(static_cast<int64_t>(piece.size()), file.size() - position);
    if (count == 0) {
      return InvalidArgument("has fewer lines than are to be skipped");
    }
    const std::span<std::byte> bytes(piece.data(), static_cast<size_t>(count));
    FOVEA_RETURN_IF_ERROR(file.ReadAt(position, bytes));
    for (size_t i = 0; i < bytes.size() && lines > 0; ++i, ++position) {
      lines -= bytes[i] == std::byte{'\n'} ? 1 : 0;
    }
  }
  return position;
}

/// Uncompressed: any byte is one step away.
class PlainBytes : public ArrayBytes {
 public:
  explicit PlainBytes(std::vector<Part> parts) : parts_(std::move(parts)) {}

  Status Read(std::span<std::byte> out) override {
    while (!out.empty()) {
      FOVEA_RETURN_IF_ERROR(Settle());
      const auto count =
          std::min<int64_t>(static_cast<int64_t>(out.size()), parts_[part_].count - position_);
      FOVEA_RETURN_IF_ERROR(file_.front().ReadAt(parts_[part_].begin + position_,
                                                 out.first(static_cast<size_t>(count))));
      position_ += count;
      out = out.subspan(static_cast<size_t>(count));
    }
    return absl::OkStatus();
  }

  Status Skip(int64_t bytes) override {
    position_ += bytes;
    return absl::OkStatus();
  }

 private:
  /// Opens the part that the position is in.
  Status Settle() {
    while (part_ < parts_.size() && position_ >= parts_[part_].count) {
      position_ -= parts_[part_].count;
      ++part_;
      file_.clear();
    }
    if (part_ == parts_.size()) {
      return Internal("reading beyond the array");
    }
    if (file_.empty()) {
      FOVEA_ASSIGN_OR_RETURN(InputFile file, InputFile::Open(parts_[part_].path));
      file_.push_back(std::move(file));
    }
    return absl::OkStatus();
  }

  std::vector<Part> parts_;
  size_t part_ = 0;
  int64_t position_ = 0;         // in the part
  std::vector<InputFile> file_;  // of the part: one or none
};

/// gzip (of one or several members) or zlib.
class InflatedBytes : public ArrayBytes {
 public:
  explicit InflatedBytes(std::vector<Part> parts) : parts_(std::move(parts)), piece_(kPieceBytes) {}
  ~InflatedBytes() override { Close(); }

  Status Read(std::span<std::byte> out) override {
    while (!out.empty()) {
      if (left_ == 0) {
        FOVEA_RETURN_IF_ERROR(NextPart());
      }
      const auto count = std::min<int64_t>(static_cast<int64_t>(out.size()), left_);
      FOVEA_RETURN_IF_ERROR(Inflate(out.first(static_cast<size_t>(count))));
      left_ -= count;
      out = out.subspan(static_cast<size_t>(count));
      if (left_ == 0) {
        FOVEA_RETURN_IF_ERROR(CheckEnd());
      }
    }
    return absl::OkStatus();
  }

  Status Skip(int64_t bytes) override {
    std::vector<std::byte> ignored(kPieceBytes);
    while (bytes > 0) {
      const auto count = std::min<int64_t>(bytes, static_cast<int64_t>(ignored.size()));
      FOVEA_RETURN_IF_ERROR(Read(std::span(ignored).first(static_cast<size_t>(count))));
      bytes -= count;
    }
    return absl::OkStatus();
  }

 private:
  void Close() {
    if (open_) {
      ::inflateEnd(&stream_);
      open_ = false;
    }
    file_.clear();
  }

  Status NextPart() {
    Close();
    if (next_ == parts_.size()) {
      return Internal("reading beyond the array");
    }
    const Part& part = parts_[next_++];
    FOVEA_ASSIGN_OR_RETURN(InputFile file, InputFile::Open(part.path));
    file_.push_back(std::move(file));
    offset_ = part.begin;
    stream_ = {};
    constexpr int kGzipOrZlib = 15 + 32;
    if (::inflateInit2(&stream_, kGzipOrZlib) != Z_OK) {
      return ResourceExhausted("no memory to inflate it");
    }
    open_ = true;
    left_ = part.skip;
    std::vector<std::byte> ignored(kPieceBytes);
    while (left_ > 0) {
      const auto count = std::min<int64_t>(left_, static_cast<int64_t>(ignored.size()));
      FOVEA_RETURN_IF_ERROR(Inflate(std::span(ignored).first(static_cast<size_t>(count))));
      left_ -= count;
    }
    left_ = part.count;
    return absl::OkStatus();
  }

  /// More compressed bytes, if none are left; whether there are any.
  StatusOr<bool> Refill() {
    if (stream_.avail_in > 0) {
      return true;
    }
    const auto count =
        std::min<int64_t>(static_cast<int64_t>(piece_.size()), file_.front().size() - offset_);
    if (count <= 0) {
      return false;
    }
    FOVEA_RETURN_IF_ERROR(
        file_.front().ReadAt(offset_, std::span(piece_).first(static_cast<size_t>(count))));
    offset_ += count;
    stream_.next_in = reinterpret_cast<Bytef*>(piece_.data());
    stream_.avail_in = static_cast<uInt>(count);
    return true;
  }

  Status Inflate(std::span<std::byte> out) {
    stream_.next_out = reinterpret_cast<Bytef*>(out.data());
    stream_.avail_out = static_cast<uInt>(out.size());
    while (stream_.avail_out > 0) {
      FOVEA_ASSIGN_OR_RETURN(const bool more, Refill());
      if (!more) {
        return DataLoss("its compressed data end too early: it is cut short");
      }
      const int result = ::inflate(&stream_, Z_NO_FLUSH);
      if (result == Z_STREAM_END && stream_.avail_out > 0) {
        // Another member of a gzip file may follow.
        FOVEA_ASSIGN_OR_RETURN(const bool another, Refill());
        if (!another || ::inflateReset(&stream_) != Z_OK) {
          return DataLoss("its compressed data hold fewer voxels than its header says");
        }
      } else if (result != Z_OK && result != Z_STREAM_END) {
        return DataLoss("its compressed data are damaged ({})",
                        stream_.msg == nullptr ? "zlib" : stream_.msg);
      }
    }
    return absl::OkStatus();
  }

  /// After the last byte that is wanted: the checksum, where the stream ends there.
  Status CheckEnd() {
    std::byte one{};
    stream_.next_out = reinterpret_cast<Bytef*>(&one);
    stream_.avail_out = 1;
    FOVEA_ASSIGN_OR_RETURN(const bool more, Refill());
    if (more && ::inflate(&stream_, Z_NO_FLUSH) == Z_DATA_ERROR) {
      return DataLoss("its compressed data are damaged ({})",
                      stream_.msg == nullptr ? "zlib" : stream_.msg);
    }
    return absl::OkStatus();
  }

  std::vector<Part> parts_;
  size_t next_ = 0;
  std::vector<InputFile> file_;  // of the part: one or none
  int64_t offset_ = 0;           // of the next compressed byte
  int64_t left_ = 0;             // of the part
  std::vector<std::byte> piece_;
  z_stream stream_{};
  bool open_ = false;
};

/// Where in this file its `count` bytes of the array are.
StatusOr<Part> Locate(const DenseHeader& header, const std::string& path, int64_t count,
                      std::vector<std::string>* warnings) {
  const auto file = InputFile::Open(path);
  FOVEA_RETURN_IF_ERROR(Annotate(file.status(), NameOf(path)));
  Part part{path, file->size(), header.data_offset, 0, count};
  const bool detached = !header.data_files.empty();
  if (header.skip_lines > 0) {
    if (!detached) {
      return InvalidArgument("lines are to be skipped within the file of the header itself");
    }
    FOVEA_ASSIGN_OR_RETURN(part.begin, SkipLines(*file, header.skip_lines));
  }
  if (header.encoding == DataEncoding::kDeflate) {
    part.skip = header.skip_bytes;
    const int64_t packed = std::max<int64_t>(0, part.file_bytes - part.begin);
    int64_t needed = 0;
    if (__builtin_add_overflow(count, part.skip, &needed) || needed / kMaxInflation > packed) {
      return InvalidArgument(
          "{} should hold {} bytes of voxels, but {} compressed bytes cannot: cut short, or its "
          "header is wrong",
          NameOf(path), count, packed);
    }
    return part;
  }
  int64_t end = 0;
  if (__builtin_add_overflow(part.begin, header.skip_bytes, &part.begin) ||
      __builtin_add_overflow(part.begin, count, &end)) {
    return InvalidArgument("its sizes make more bytes than a file can have");
  }
  if (header.at_end) {
    part.begin = part.file_bytes - count;
    end = part.file_bytes;
  }
  if (part.begin < 0 || end > part.file_bytes) {
    return InvalidArgument(
        "{} has {} bytes, but its header asks for {} = {} before the voxels + {} of voxels: cut "
        "short, or the header is wrong",
        NameOf(path), part.file_bytes, end, end - count, count);
  }
  if (end < part.file_bytes) {
    warnings->push_back(
        fmt::format("'{}' is {} bytes longer than its header says; these were not "
                    "read",
                    path, part.file_bytes - end));
  }
  return part;
}

}  // namespace

StatusOr<std::unique_ptr<ArrayBytes>> OpenArray(const DenseHeader& header,
                                                const std::vector<std::string>& paths,
                                                int64_t* file_bytes,
                                                std::vector<std::string>* warnings) {
  const int64_t total = header.Samples() * BytesOf(header.type);
  const auto count = static_cast<int64_t>(paths.size());
  if (count == 0 || total % count != 0) {
    return InvalidArgument("its {} bytes of voxels cannot lie in {} files of one size", total,
                           count);
  }
  std::vector<Part> parts;
  for (const std::string& path : paths) {
    FOVEA_ASSIGN_OR_RETURN(Part part, Locate(header, path, total / count, warnings));
    *file_bytes += part.file_bytes;
    parts.push_back(std::move(part));
  }
  if (header.encoding == DataEncoding::kDeflate) {
    return std::unique_ptr<ArrayBytes>(std::make_unique<InflatedBytes>(std::move(parts)));
  }
  return std::unique_ptr<ArrayBytes>(std::make_unique<PlainBytes>(std::move(parts)));
}

}  // namespace fovea::ingest
