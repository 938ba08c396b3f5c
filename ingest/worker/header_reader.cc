#include "ingest/worker/header_reader.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "ingest/raw_format.h"
#include "ingest/worker/headers/metaimage.h"
#include "ingest/worker/headers/npy.h"
#include "ingest/worker/headers/nrrd.h"
#include "ingest/worker/headers/sidecar.h"
#include "ingest/worker/input_file.h"
#include "ingest/worker/nifti_header.h"

namespace fovea::ingest {
namespace {

constexpr int64_t kMaxHeaderBytes = 8 << 20;  // a list of many data files is long
constexpr int64_t kMagicBytes = 352;

bool HasSidecar(const std::vector<std::string>& paths) {
  return std::find(paths.begin() + 1, paths.end(), SidecarOf(paths.front())) != paths.end();
}

StatusOr<std::string> ReadText(const std::string& path) {
  FOVEA_ASSIGN_OR_RETURN(const InputFile file, InputFile::Open(path));
  return file.ReadStart(kMaxHeaderBytes);
}

std::string Describe(const RawFormat& raw) {
  return fmt::format("{}x{}x{}x{}:{}:{} after {} header bytes", raw.dims.x, raw.dims.y, raw.dims.z,
                     raw.steps_per_file, raw.type, raw.big_endian ? "be" : "le", raw.header_bytes);
}

DenseHeader HeaderOf(const RawFormat& raw) {
  DenseHeader header;
  header.axes = {{AxisRole::kX, raw.dims.x},
                 {AxisRole::kY, raw.dims.y},
                 {AxisRole::kZ, raw.dims.z},
                 {AxisRole::kStep, raw.steps_per_file}};
  header.type = SampleTypeOf(raw.type).value_or(SampleType::kUint8);  // CheckRawFormat knows it
  header.big_endian = raw.big_endian;
  header.data_offset = raw.header_bytes;
  return header;
}

/// Byte order means nothing for single bytes.
bool Agree(RawFormat a, const RawFormat& b) {
  a.big_endian = BytesPerValue(a.type) == 1 ? b.big_endian : a.big_endian;
  return a == b;
}

/// A format that was given wins over the sidecar; the rest of the sidecar counts all the same.
StatusOr<DenseHeader> ReadRaw(const std::vector<std::string>& paths, const ReaderHints& hints) {
  std::optional<Sidecar> sidecar;
  std::vector<std::string> warnings;
  if (HasSidecar(paths)) {
    const std::string name = SidecarOf(paths.front());
    const auto text = ReadText(name);
    FOVEA_RETURN_IF_ERROR(Annotate(text.status(), name));
    const auto parsed = ParseSidecar(*text);
    if (parsed.ok()) {
      sidecar = *parsed;
    } else if (!hints.raw) {
      return Annotate(parsed.status(), name);
    } else {
      warnings.push_back(fmt::format("'{}' is not used: {}", name, MessageOf(parsed.status())));
    }
  }
  if (!hints.raw && !sidecar) {
    return InvalidArgument(
        "headerless voxels: say their size and type with --raw, e.g. --raw 256x256x225:uint8, or "
        "write them into '{}'",
        SidecarOf(paths.front()));
  }
  const RawFormat raw = hints.raw ? *hints.raw : sidecar->raw;
  FOVEA_RETURN_IF_ERROR(CheckRawFormat(raw));
  if (sidecar && !Agree(raw, sidecar->raw)) {
    warnings.push_back(fmt::format("'{}' says {}, but --raw {} was given and counts",
                                   SidecarOf(paths.front()), Describe(sidecar->raw),
                                   Describe(raw)));
  }
  FOVEA_ASSIGN_OR_RETURN(const InputFile file, InputFile::Open(paths.front()));
  if (file.size() != BytesPerFile(raw)) {
    return InvalidArgument("has {} bytes, but the raw format needs {} = {}", file.size(),
                           BytesPerFile(raw), DescribeFileSize(raw));
  }
  DenseHeader header = HeaderOf(raw);
  header.warnings = std::move(warnings);
  header.index_to_world = SpacingMatrix({1, 1, 1});
  if (sidecar) {
    header.index_to_world = SpacingMatrix(sidecar->spacing.value_or(Vec3{1, 1, 1}));
    const Vec3 origin = sidecar->origin.value_or(Vec3{});
    for (int axis = 0; axis < 3; ++axis) {
      header.index_to_world.m[static_cast<size_t>(4 * axis + 3)] += origin[axis];
    }
    header.world_unit = sidecar->world_unit;
    header.value_unit = sidecar->value_unit;
    if (raw.steps_per_file == sidecar->raw.steps_per_file) {
      header.times_s = sidecar->times_s;
    }
  }
  return header;
}

}  // namespace

StatusOr<FileFormat> ChooseFormat(const std::vector<std::string>& paths, const ReaderHints& hints) {
  if (hints.raw) {
    return FileFormat::kRaw;
  }
  if (FormatByName(paths.front()) == FileFormat::kPicture && paths.size() > 1) {
    return FileFormat::kPicture;  // a stack: whatever is not a picture in it is an error
  }
  FOVEA_ASSIGN_OR_RETURN(const InputFile file, InputFile::Open(paths.front()));
  FOVEA_ASSIGN_OR_RETURN(const std::string start, file.ReadStart(kMagicBytes));
  const FileFormat by_magic = FormatByMagic(start);
  if (by_magic != FileFormat::kUnknown) {
    return by_magic;
  }
  if (HasSidecar(paths)) {
    return FileFormat::kRaw;
  }
  const FileFormat by_name = FormatByName(paths.front());
  if (by_name == FileFormat::kUnknown) {
    return InvalidArgument("what kind of file it is is not known; can be read: {}", ListFormats());
  }
  return by_name;
}

StatusOr<DenseHeader> ReadHeader(const std::vector<std::string>& paths, const ReaderHints& hints,
                                 FileFormat format) {
  if (format == FileFormat::kRaw) {
    return ReadRaw(paths, hints);
  }
  std::string start;
  if (format != FileFormat::kNifti) {
    FOVEA_ASSIGN_OR_RETURN(start, ReadText(paths.front()));
  }
  switch (format) {
    case FileFormat::kNpy:
      return ParseNpy(start, hints.axes);
    case FileFormat::kNrrd:
      return ParseNrrd(start);
    case FileFormat::kMetaImage:
      return ParseMetaImage(start);
    case FileFormat::kNifti:
      return ReadNiftiHeader(paths.front());
    default:
      return Internal("no header of this format is known");
  }
}

}  // namespace fovea::ingest
