#include <algorithm>
#include <cmath>
#include <limits>

#include "ingest/payload.h"
#include "ingest/protocol.h"
#include "ingest/raw_format.h"
#include "ingest/slab_ring.h"

namespace fovea::ingest {
namespace {

/// File indices are 32 bits; a half-open box may end one beyond.
constexpr int64_t kLeastIndex = std::numeric_limits<int32_t>::min();
constexpr int64_t kGreatestIndex = int64_t{std::numeric_limits<int32_t>::max()} + 1;

Status Malformed(const char* what) {
  return Internal("malformed message: {}", what);
}

Status CheckFrame(const FrameView& frame, FrameKind kind, const PayloadReader& reader,
                  const char* what) {
  if (frame.kind != kind || !reader.Complete()) {
    return Malformed(what);
  }
  return absl::OkStatus();
}

/// Within the index range; with positive extent, or all zero where it may be empty.
bool IsSaneBox(const Box3& box, bool may_be_empty) {
  if (box == Box3{}) {
    return may_be_empty;
  }
  for (int axis = 0; axis < 3; ++axis) {
    if (box.lo[axis] < kLeastIndex || box.hi[axis] > kGreatestIndex ||
        box.hi[axis] <= box.lo[axis]) {
      return false;
    }
  }
  return true;
}

/// Stops, with the reader failed, where there are fewer than are announced.
std::vector<std::string> ReadTexts(PayloadReader* reader) {
  std::vector<std::string> texts;
  const auto count = reader->Number<uint32_t>();
  for (uint32_t i = 0; i < count && !reader->failed(); ++i) {
    texts.push_back(reader->Text());
  }
  return texts;
}

ReaderHints ReadHints(PayloadReader* reader) {
  ReaderHints hints;
  if (reader->Number<uint8_t>() != 0) {
    RawFormat& raw = hints.raw.emplace();
    raw.dims.x = reader->Number<int64_t>();
    raw.dims.y = reader->Number<int64_t>();
    raw.dims.z = reader->Number<int64_t>();
    raw.type = reader->Text();
    raw.big_endian = reader->Number<uint8_t>() != 0;
    raw.header_bytes = reader->Number<int64_t>();
    raw.steps_per_file = reader->Number<int64_t>();
  }
  hints.channel = reader->Text();
  hints.axes = reader->Text();
  hints.slices_per_step = reader->Number<int64_t>();
  return hints;
}

/// The steps of a file: how many, and when they are, if that is known of all.
bool HasSaneSteps(const FileInfo& file) {
  constexpr int64_t kMaxSteps = 1'000'000;
  const auto is_finite = [](double time) { return std::isfinite(time); };
  return file.steps >= 1 && file.steps <= kMaxSteps &&
         (file.times_s.empty() || file.times_s.size() == static_cast<size_t>(file.steps)) &&
         std::all_of(file.times_s.begin(), file.times_s.end(), is_finite);
}

/// The length of the UTF-8 sequence at `position`, or 0 if there is none.
size_t Utf8Length(const std::string& text, size_t position) {
  const auto byte = [&](size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned char lead = byte(position);
  const size_t length = lead < 0x80   ? 1
                        : lead < 0xC2 ? 0
                        : lead < 0xE0 ? 2
                        : lead < 0xF0 ? 3
                        : lead < 0xF5 ? 4
                                      : 0;
  if (length == 0 || position + length > text.size()) {
    return 0;
  }
  for (size_t i = 1; i < length; ++i) {
    if ((byte(position + i) & 0xC0) != 0x80) {
      return 0;
    }
  }
  if (length < 3) {
    return length;
  }
  // Overlong forms, surrogates and what lies beyond U+10FFFF.
  const unsigned char second = byte(position + 1);
  const bool bad = (lead == 0xE0 && second < 0xA0) || (lead == 0xED && second > 0x9F) ||
                   (lead == 0xF0 && second < 0x90) || (lead == 0xF4 && second > 0x8F);
  return bad ? 0 : length;
}

}  // namespace

StatusOr<ScanRequest> DecodeScanRequest(const FrameView& frame) {
  PayloadReader reader(frame.payload);
  ScanRequest message;
  message.paths = ReadTexts(&reader);
  message.hints = ReadHints(&reader);
  message.from_voxels = reader.Number<uint8_t>() != 0;
  FOVEA_RETURN_IF_ERROR(CheckFrame(frame, FrameKind::kScan, reader, "scan request"));
  if (message.paths.empty()) {
    return Malformed("scan request of no file");
  }
  return message;
}

StatusOr<ReadRequest> DecodeReadRequest(const FrameView& frame) {
  PayloadReader reader(frame.payload);
  ReadRequest message;
  message.paths = ReadTexts(&reader);
  message.hints = ReadHints(&reader);
  message.step_in_file = reader.Number<int64_t>();
  message.extent = reader.Box();
  message.grids = ReadTexts(&reader);
  const bool has_lattice = reader.Number<uint8_t>() != 0;
  Matrix4 lattice;
  for (double& element : lattice.m) {
    element = reader.Number<double>();
  }
  if (has_lattice) {
    message.lattice = lattice;
  }
  FOVEA_RETURN_IF_ERROR(CheckFrame(frame, FrameKind::kRead, reader, "read request"));
  if (message.paths.empty() || !IsSaneBox(message.extent, false)) {
    return Malformed("read request");
  }
  return message;
}

StatusOr<PictureRequest> DecodePictureRequest(const FrameView& frame) {
  PayloadReader reader(frame.payload);
  PictureRequest message;
  message.format = reader.Text();
  message.width = reader.Number<int64_t>();
  message.height = reader.Number<int64_t>();
  FOVEA_RETURN_IF_ERROR(CheckFrame(frame, FrameKind::kPicture, reader, "picture request"));
  return message;
}

StatusOr<FileInfo> DecodeFileInfo(const FrameView& frame) {
  PayloadReader reader(frame.payload);
  FileInfo message;
  message.file_bytes = reader.Number<int64_t>();
  message.world_unit = Printable(reader.Text());
  message.is_dense = reader.Number<uint8_t>() != 0;
  message.steps = reader.Number<int64_t>();
  const auto times = reader.Number<uint32_t>();
  for (uint32_t i = 0; i < times && !reader.failed(); ++i) {
    message.times_s.push_back(reader.Number<double>());
  }
  message.needs = ReadTexts(&reader);
  for (const std::string& warning : ReadTexts(&reader)) {
    message.warnings.push_back(Printable(warning));
  }
  FOVEA_RETURN_IF_ERROR(CheckFrame(frame, FrameKind::kFile, reader, "file"));
  if (message.file_bytes < 0 || !HasSaneSteps(message)) {
    return Malformed("size or steps of a file");
  }
  return message;
}

StatusOr<GridInfo> DecodeGridInfo(const FrameView& frame) {
  PayloadReader reader(frame.payload);
  GridInfo message;
  message.name = reader.Text();
  message.type = Printable(reader.Text());
  message.problem = Printable(reader.Text());
  message.box = reader.Box();
  bool is_finite = true;
  for (double& element : message.index_to_world.m) {
    element = reader.Number<double>();
    is_finite = is_finite && std::isfinite(element);
  }
  message.declared_bytes = reader.Number<int64_t>();
  message.value_unit = Printable(reader.Text());
  message.on_request = reader.Number<uint8_t>() != 0;
  FOVEA_RETURN_IF_ERROR(CheckFrame(frame, FrameKind::kGrid, reader, "grid"));
  if (!IsSaneBox(message.box, true) || message.declared_bytes < 0) {
    return Malformed("box or size of a grid");
  }
  const double determinant = message.index_to_world.Determinant();
  if (!is_finite || !std::isfinite(determinant) || determinant == 0) {
    return Malformed("transform of a grid");
  }
  return message;
}

StatusOr<FieldStart> DecodeFieldStart(const FrameView& frame) {
  PayloadReader reader(frame.payload);
  FieldStart message;
  message.index = reader.Number<uint32_t>();
  message.background = reader.Number<float>();
  message.fill = reader.Number<float>();
  FOVEA_RETURN_IF_ERROR(CheckFrame(frame, FrameKind::kField, reader, "field"));
  if (!std::isfinite(message.background) || !std::isfinite(message.fill)) {
    return Malformed("background of a field");
  }
  return message;
}

StatusOr<FieldEnd> DecodeFieldEnd(const FrameView& frame) {
  PayloadReader reader(frame.payload);
  FieldEnd message;
  message.active = reader.Box();
  message.rounded = reader.Number<uint64_t>();
  FOVEA_RETURN_IF_ERROR(CheckFrame(frame, FrameKind::kFieldEnd, reader, "end of a field"));
  if (!IsSaneBox(message.active, true)) {
    return Malformed("box of a field");
  }
  return message;
}

int64_t BytesOf(DenseType type) {
  switch (type) {
    case DenseType::kUint8:
    case DenseType::kInt8:
      return 1;
    case DenseType::kUint16:
    case DenseType::kInt16:
      return 2;
    case DenseType::kFloat32:
      break;
  }
  return 4;
}

StatusOr<DenseStart> DecodeDenseStart(const FrameView& frame) {
  PayloadReader reader(frame.payload);
  DenseStart message;
  message.index = reader.Number<uint32_t>();
  const auto type = reader.Number<uint8_t>();
  message.type = static_cast<DenseType>(type);
  message.box = reader.Box();
  FOVEA_RETURN_IF_ERROR(CheckFrame(frame, FrameKind::kDense, reader, "dense field"));
  if (type > static_cast<uint8_t>(DenseType::kFloat32) || !IsSaneBox(message.box, false)) {
    return Malformed("type or box of a dense field");
  }
  return message;
}

StatusOr<SlabRows> DecodeSlabRows(const FrameView& frame) {
  PayloadReader reader(frame.payload);
  SlabRows message;
  message.slab = reader.Number<uint32_t>();
  message.rows = reader.Number<int64_t>();
  FOVEA_RETURN_IF_ERROR(CheckFrame(frame, FrameKind::kSlab, reader, "slab"));
  if (message.slab >= kSlabs || message.rows < 1) {
    return Malformed("slab");
  }
  return message;
}

StatusOr<uint32_t> DecodeSlabFree(const FrameView& frame) {
  PayloadReader reader(frame.payload);
  const auto slab = reader.Number<uint32_t>();
  FOVEA_RETURN_IF_ERROR(CheckFrame(frame, FrameKind::kSlabFree, reader, "free slab"));
  if (slab >= kSlabs) {
    return Malformed("free slab");
  }
  return slab;
}

StatusOr<Block> DecodeBlock(const FrameView& frame) {
  PayloadReader reader(frame.payload);
  Block message;
  message.box = reader.Box();
  if (!IsSaneBox(message.box, false)) {
    return Malformed("box of a block");
  }
  // Each size is at most 2^32: bounded one by one, their product cannot overflow.
  const Int3 size = message.box.Size();
  if (size.x > kMaxBlockValues || size.y > kMaxBlockValues / size.x ||
      size.z > kMaxBlockValues / (size.x * size.y)) {
    return Malformed("size of a block");
  }
  message.values = reader.Floats(size.Product());
  FOVEA_RETURN_IF_ERROR(CheckFrame(frame, FrameKind::kBlock, reader, "block"));
  return message;
}

StatusOr<Tile> DecodeTile(const FrameView& frame) {
  PayloadReader reader(frame.payload);
  Tile message;
  message.box = reader.Box();
  message.value = reader.Number<float>();
  FOVEA_RETURN_IF_ERROR(CheckFrame(frame, FrameKind::kTile, reader, "tile"));
  if (!IsSaneBox(message.box, false)) {
    return Malformed("box of a tile");
  }
  return message;
}

StatusOr<std::vector<std::string>> DecodeFiles(const FrameView& frame) {
  PayloadReader reader(frame.payload);
  std::vector<std::string> paths;
  while (reader.bytes_left() > 0 && !reader.failed()) {
    paths.push_back(reader.Text());
  }
  FOVEA_RETURN_IF_ERROR(CheckFrame(frame, FrameKind::kFiles, reader, "files"));
  return paths;
}

StatusOr<BeginRequest> DecodeBeginRequest(const FrameView& frame) {
  PayloadReader reader(frame.payload);
  BeginRequest message;
  message.pictures = reader.Number<uint8_t>() != 0;
  FOVEA_RETURN_IF_ERROR(CheckFrame(frame, FrameKind::kBegin, reader, "begin"));
  return message;
}

StatusOr<Hello> DecodeHello(const FrameView& frame) {
  PayloadReader reader(frame.payload);
  Hello message;
  message.version = reader.Number<uint32_t>();
  if (frame.kind == FrameKind::kHello && !reader.failed() && message.version != kProtocolVersion) {
    return FailedPrecondition("it is of another version: it speaks protocol {}, not {}",
                              message.version, kProtocolVersion);
  }
  message.landlock_abi = reader.Number<uint32_t>();
  message.system_calls_filtered = reader.Number<uint8_t>() != 0;
  message.openvdb = Printable(reader.Text());
  message.openimageio = Printable(reader.Text());
  FOVEA_RETURN_IF_ERROR(CheckFrame(frame, FrameKind::kHello, reader, "greeting"));
  return message;
}

Status DecodeError(const FrameView& frame) {
  PayloadReader reader(frame.payload);
  const auto code = static_cast<absl::StatusCode>(reader.Number<uint32_t>());
  const std::string text = Printable(reader.Text());
  FOVEA_RETURN_IF_ERROR(CheckFrame(frame, FrameKind::kError, reader, "error"));
  switch (code) {
    case absl::StatusCode::kInvalidArgument:
    case absl::StatusCode::kNotFound:
    case absl::StatusCode::kFailedPrecondition:
    case absl::StatusCode::kResourceExhausted:
    case absl::StatusCode::kDataLoss:
    case absl::StatusCode::kUnavailable:
      return MakeStatus(code, text);
    default:
      return Internal("{}", text);
  }
}

std::string Printable(const std::string& text) {
  constexpr size_t kMaxBytes = 1000;
  std::string result;
  for (size_t i = 0; i < text.size() && result.size() < kMaxBytes;) {
    const size_t length = Utf8Length(text, i);
    const auto byte = static_cast<unsigned char>(text[i]);
    const bool is_control =
        length == 1 ? byte < 0x20 || byte == 0x7F
                    : length == 2 && byte == 0xC2 && static_cast<unsigned char>(text[i + 1]) < 0xA0;
    if (length == 0 || is_control) {
      result += '?';
    } else {
      result.append(text, i, length);
    }
    i += length == 0 ? 1 : length;
  }
  return result;
}

}  // namespace fovea::ingest
