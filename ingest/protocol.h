#ifndef INGEST_PROTOCOL_H_
#define INGEST_PROTOCOL_H_

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "engine/base/status.h"
#include "engine/volume/geometry.h"
#include "ingest/ingest.h"

/// What the program and its worker say to each other (docs/formats/worker.md). Every message is one
/// frame: kind, length, payload, little-endian. The program trusts nothing that comes back: the
/// decoders here check every length, box and number, and fail with INTERNAL.
namespace fovea::ingest {

inline constexpr uint32_t kProtocolVersion = 3;
inline constexpr uint32_t kMaxPayloadBytes = 8U << 20;
/// Values in one block; a block of dense data never holds more.
inline constexpr int64_t kMaxBlockValues = 1 << 20;

enum class FrameKind : uint32_t {
  kHello = 1,      // worker: protocol version, and how it is confined
  kScan = 2,       // program: what is in this file?
  kRead = 3,       // program: the voxels of these grids
  kPicture = 4,    // program: encode the pixels that follow
  kBytes = 5,      // both ways: a piece of pixels or of an encoded picture
  kFile = 6,       // worker: about a scanned file
  kGrid = 7,       // worker: one grid of a scanned file
  kField = 8,      // worker: the voxels of one grid follow
  kBlock = 9,      // worker: a box of values
  kTile = 10,      // worker: a box of one value
  kFieldEnd = 11,  // worker: all voxels of the grid were sent
  kEnd = 12,       // worker: the request is done
  kError = 13,     // worker: the request failed
  kDense = 14,     // worker: the voxels of one grid follow, in slabs
  kSlab = 15,      // worker: rows of voxels lie in a slab (slab_ring.h)
  kSlabFree = 16,  // program: they were taken out, the slab may be filled again
  kFiles = 20,     // program, first of all: files that may be read
  kBegin = 21,     // program, once: those were all; to be answered with kHello
};

/// A frame as it came: its payload lies in the buffer of the channel, until the next one is
/// received.
struct FrameView {
  FrameKind kind = FrameKind::kEnd;
  std::string_view payload;
};

/// A frame to send.
struct Frame {
  FrameKind kind = FrameKind::kEnd;
  std::string payload;
  operator FrameView() const { return {kind, payload}; }  // NOLINT(google-explicit-constructor)
};

/// The end of the list of files; the worker confines itself to them.
struct BeginRequest {
  bool pictures = false;  // OpenImageIO is needed, and must be loaded before
};

struct Hello {
  uint32_t version = kProtocolVersion;
  uint32_t landlock_abi = 0;  // 0: the kernel has none
  bool system_calls_filtered = false;
  std::string openvdb = {};      // its version
  std::string openimageio = {};  // its version; empty: not loaded
};

/// What the user says of the files beyond what they say themselves.
struct ReaderHints {
  std::optional<RawFormat> raw;  // headerless voxels of this format
  std::string channel;           // of several values a voxel: a number, a name, luminance; or empty
  std::string axes;              // NumPy: what the axes of the array are
  int64_t slices_per_step = 0;   // pictures; 0: as the files are
  friend bool operator==(const ReaderHints&, const ReaderHints&) = default;
};

/// A file set is what one step, or one file of several steps, is read from: the file that names it
/// in errors, then the others that it needs (a sidecar, detached data, further slices). The worker
/// opens nothing else.
struct ScanRequest {
  std::vector<std::string> paths;  // the file set: at least one
  ReaderHints hints;
  bool from_voxels = false;  // do not believe the boxes in the metadata
};

struct ReadRequest {
  std::vector<std::string> paths;  // the file set, with what its scan asked for
  ReaderHints hints;
  int64_t step_in_file = 0;
  Box3 extent;                     // index space of the file: what to send
  std::vector<std::string> grids;  // unique names, as GridInfo gives them; dense: one, empty
  /// VDB: the index-to-world matrix of the extent; grids that lie otherwise are resampled to it.
  std::optional<Matrix4> lattice = {};
};

struct PictureRequest {
  std::string format;  // "exr", "tif"
  int64_t width = 0, height = 0;
};

struct FileInfo {
  int64_t file_bytes = 0;  // of the whole set
  std::string world_unit;  // from the metadata; may be empty
  bool is_dense = false;   // one grid without a name, of voxels that are all there
  int64_t steps = 1;
  std::vector<double> times_s = {};  // one for each step; empty: the file does not say
  /// Files that the header names and the set lacks, as the header names them: with any of these
  /// there is no grid, and the set is to be scanned again with them.
  std::vector<std::string> needs = {};
  std::vector<std::string> warnings = {};
};

/// A grid of a file. `name` is unique in the file: "density", or "density[1]" of several.
struct GridInfo {
  std::string name;
  std::string type;     // float, double, int32, ..., vec3s; dense: as SampleType's names
  std::string problem;  // why it cannot be read as a scalar field; empty: it can
  Box3 box;             // of the active voxels; empty if there are none
  Matrix4 index_to_world;
  int64_t declared_bytes = 0;   // in the worker's memory, while it is read
  std::string value_unit = {};  // may be empty: unknown
  bool on_request = false;      // only taken if asked for: a scalar of a grid of vectors
};

struct FieldStart {
  uint32_t index = 0;    // in ReadRequest::grids
  float background = 0;  // stands in for NaN and infinity
  float fill = 0;        // what every voxel is that no block or tile covers
};

/// The types in which dense voxels travel; any other becomes float32 in the worker.
enum class DenseType : uint8_t { kUint8, kInt8, kUint16, kInt16, kFloat32 };
[[nodiscard]] int64_t BytesOf(DenseType type);

struct DenseStart {
  uint32_t index = 0;  // in ReadRequest::grids
  DenseType type = DenseType::kUint8;
  Box3 box;  // what comes, x fastest, then y, then z; all the rest of the extent is 0
};

/// The next rows (along x) of the box.
struct SlabRows {
  uint32_t slab = 0;
  int64_t rows = 0;
};

struct FieldEnd {
  Box3 active;           // the box of the active voxels, as found
  uint64_t rounded = 0;  // values that float32 does not hold exactly
};

/// Lies in the frame that it was decoded from.
struct Block {
  Box3 box;
  std::string_view values;  // the bytes of as many floats, x fastest; not aligned
};

struct Tile {
  Box3 box;
  float value = 0;
};

[[nodiscard]] Frame Encode(const ScanRequest& message);
[[nodiscard]] Frame Encode(const ReadRequest& message);
[[nodiscard]] Frame Encode(const PictureRequest& message);
[[nodiscard]] Frame Encode(const FileInfo& message);
[[nodiscard]] Frame Encode(const GridInfo& message);
[[nodiscard]] Frame Encode(const FieldStart& message);
[[nodiscard]] Frame Encode(const FieldEnd& message);
[[nodiscard]] Frame Encode(const DenseStart& message);
[[nodiscard]] Frame Encode(const SlabRows& message);
[[nodiscard]] Frame EncodeSlabFree(uint32_t slab);
[[nodiscard]] Frame EncodeBlock(const Box3& box, std::span<const float> values);
[[nodiscard]] Frame Encode(const Tile& message);
/// As many frames as it takes.
[[nodiscard]] std::vector<Frame> EncodeFiles(std::span<const std::string> paths);
[[nodiscard]] Frame Encode(const BeginRequest& message);
[[nodiscard]] Frame Encode(const Hello& message);
[[nodiscard]] Frame EncodeError(const Status& status);

[[nodiscard]] StatusOr<ScanRequest> DecodeScanRequest(const FrameView& frame);
[[nodiscard]] StatusOr<ReadRequest> DecodeReadRequest(const FrameView& frame);
[[nodiscard]] StatusOr<PictureRequest> DecodePictureRequest(const FrameView& frame);
[[nodiscard]] StatusOr<FileInfo> DecodeFileInfo(const FrameView& frame);
[[nodiscard]] StatusOr<GridInfo> DecodeGridInfo(const FrameView& frame);
[[nodiscard]] StatusOr<FieldStart> DecodeFieldStart(const FrameView& frame);
[[nodiscard]] StatusOr<FieldEnd> DecodeFieldEnd(const FrameView& frame);
[[nodiscard]] StatusOr<DenseStart> DecodeDenseStart(const FrameView& frame);
/// The slab is one of the ring; of the rows, only that they are more than none.
[[nodiscard]] StatusOr<SlabRows> DecodeSlabRows(const FrameView& frame);
[[nodiscard]] StatusOr<uint32_t> DecodeSlabFree(const FrameView& frame);
/// The values may be NaN or infinite.
[[nodiscard]] StatusOr<Block> DecodeBlock(const FrameView& frame);
[[nodiscard]] StatusOr<Tile> DecodeTile(const FrameView& frame);
[[nodiscard]] StatusOr<std::vector<std::string>> DecodeFiles(const FrameView& frame);
[[nodiscard]] StatusOr<BeginRequest> DecodeBeginRequest(const FrameView& frame);
/// FAILED_PRECONDITION if the worker is of another version.
[[nodiscard]] StatusOr<Hello> DecodeHello(const FrameView& frame);
/// The error that an error frame carries; INTERNAL if it carries none.
[[nodiscard]] Status DecodeError(const FrameView& frame);

/// Safe to print: control characters and what is not UTF-8 become '?', at most 1000 bytes are kept.
[[nodiscard]] std::string Printable(const std::string& text);

}  // namespace fovea::ingest

#endif  // INGEST_PROTOCOL_H_
