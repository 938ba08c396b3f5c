#include "ingest/worker/nifti_header.h"

#include <cmath>
#include <cstring>
#include <filesystem>
#include <iterator>
#include <memory>
#include <utility>
#include <vector>

#include <nifti2_io.h>
#include <zlib.h>

#include "ingest/file_format.h"
#include "ingest/worker/input_file.h"

namespace fovea::ingest {
namespace {

constexpr int64_t kPackedBytes = 64 << 10;  // of these the header comes
constexpr std::string_view kGzipMagic = "\x1F\x8B";

constexpr std::pair<int, SampleType> kTypes[] = {
    {DT_UINT8, SampleType::kUint8},     {DT_INT8, SampleType::kInt8},
    {DT_UINT16, SampleType::kUint16},   {DT_INT16, SampleType::kInt16},
    {DT_UINT32, SampleType::kUint32},   {DT_INT32, SampleType::kInt32},
    {DT_UINT64, SampleType::kUint64},   {DT_INT64, SampleType::kInt64},
    {DT_FLOAT32, SampleType::kFloat32}, {DT_FLOAT64, SampleType::kFloat64},
    {DT_RGB24, SampleType::kUint8},     {DT_RGBA32, SampleType::kUint8},
};

using Image = std::unique_ptr<nifti_image, void (*)(nifti_image*)>;

/// The first bytes that a gzip stream of which we have a part inflates to.
std::string Inflated(const std::string& packed, size_t most) {
  std::string bytes(most, '\0');
  z_stream stream{};
  constexpr int kGzip = 15 + 16;
  if (::inflateInit2(&stream, kGzip) != Z_OK) {
    return {};
  }
  std::string copy = packed;  // zlib's pointer is not const
  stream.next_in = reinterpret_cast<Bytef*>(copy.data());
  stream.avail_in = static_cast<uInt>(copy.size());
  stream.next_out = reinterpret_cast<Bytef*>(bytes.data());
  stream.avail_out = static_cast<uInt>(bytes.size());
  ::inflate(&stream, Z_SYNC_FLUSH);
  bytes.resize(bytes.size() - stream.avail_out);
  ::inflateEnd(&stream);
  return bytes;
}

/// The version that libnifti takes a header for by its magic; 0: Analyze.
char VersionOf(const char* magic) {
  const bool is_nifti = magic[0] == 'n' && (magic[1] == 'i' || magic[1] == '+') && magic[3] == '\0';
  return is_nifti ? magic[2] : '0';
}

/// libnifti believes what a header says of its dimensions and, in the other byte order, of its
/// version: it writes past the dimensions that there are, or leaves them in the wrong order. Only
/// what it is made for is handed to it.
bool IsSound(const nifti_1_header& header) {
  const char version = VersionOf(header.magic);
  const auto said = static_cast<uint16_t>(header.dim[0]);
  const auto fits = [](uint16_t used) { return used < std::size(nifti_1_header().dim); };
  return (version == '0' || version == '1') && (fits(said) || fits(__builtin_bswap16(said)));
}

bool IsSound(const nifti_2_header& header) {
  const bool swapped = header.sizeof_hdr != static_cast<int32_t>(sizeof(header));
  const auto said = static_cast<uint64_t>(header.dim[0]);
  const uint64_t used = swapped ? __builtin_bswap64(said) : said;
  return VersionOf(header.magic) == '2' && used >= 1 && used < std::size(header.dim);
}

/// What libnifti makes of the bytes of a header; it touches no file.
StatusOr<Image> Understood(const std::string& bytes) {
  ::nifti_set_debug_level(0);
  nifti_image* image = nullptr;
  int32_t size = 0;
  if (bytes.size() >= sizeof(size)) {
    std::memcpy(&size, bytes.data(), sizeof(size));
  }
  const bool second = size == static_cast<int32_t>(sizeof(nifti_2_header)) ||
                      __builtin_bswap32(static_cast<uint32_t>(size)) == sizeof(nifti_2_header);
  if (second && bytes.size() >= sizeof(nifti_2_header)) {
    nifti_2_header header;
    std::memcpy(&header, bytes.data(), sizeof(header));
    image = IsSound(header) ? ::nifti_convert_n2hdr2nim(header, nullptr) : nullptr;
  } else if (!second && bytes.size() >= sizeof(nifti_1_header)) {
    nifti_1_header header;
    std::memcpy(&header, bytes.data(), sizeof(header));
    image = IsSound(header) ? ::nifti_convert_n1hdr2nim(header, nullptr) : nullptr;
  } else {
    return DataLoss("is cut short within its header");
  }
  if (image == nullptr) {
    return InvalidArgument("is not a NIfTI or Analyze file, or its header is damaged");
  }
  return Image(image, ::nifti_image_free);
}

Status SetAxes(const nifti_image& image, DenseHeader* header) {
  bool known = false;
  for (const auto& [code, type] : kTypes) {
    if (code == image.datatype) {
      header->type = type;
      known = true;
    }
  }
  if (!known) {
    return InvalidArgument(
        "values of type {} (of NIfTI): only integers, floats and RGB can be "
        "read",
        image.datatype);
  }
  if (image.datatype == DT_RGB24 || image.datatype == DT_RGBA32) {
    header->axes.push_back({AxisRole::kChannel, image.datatype == DT_RGB24 ? 3 : 4});
  }
  header->axes.insert(header->axes.end(), {{AxisRole::kX, image.nx},
                                           {AxisRole::kY, image.ny},
                                           {AxisRole::kZ, image.nz},
                                           {AxisRole::kStep, image.nt}});
  if (image.nu > 1) {
    header->axes.push_back({AxisRole::kChannel, image.nu});
  }
  if (image.nv > 1 || image.nw > 1) {
    return InvalidArgument("has more than five dimensions");
  }
  return absl::OkStatus();
}

void Place(const nifti_image& image, DenseHeader* header) {
  const bool by_sform = image.sform_code > 0;
  if (by_sform || image.qform_code > 0) {
    const auto& matrix = by_sform ? image.sto_xyz : image.qto_xyz;
    for (size_t row = 0; row < 3; ++row) {
      for (size_t column = 0; column < 4; ++column) {
        header->index_to_world.m[4 * row + column] = matrix.m[row][column];
      }
    }
    return;
  }
  const auto size = [](double said) { return said > 0 && std::isfinite(said) ? said : 1.0; };
  header->index_to_world = SpacingMatrix({size(image.dx), size(image.dy), size(image.dz)});
}

void SetUnits(const nifti_image& image, DenseHeader* header) {
  header->world_unit = image.xyz_units == NIFTI_UNITS_METER    ? "m"
                       : image.xyz_units == NIFTI_UNITS_MM     ? "mm"
                       : image.xyz_units == NIFTI_UNITS_MICRON ? "um"
                                                               : "";
  const double seconds = image.time_units == NIFTI_UNITS_MSEC   ? 1e-3
                         : image.time_units == NIFTI_UNITS_USEC ? 1e-6
                                                                : 1.0;
  // Hertz, ppm and radians are no times.
  if (image.time_units <= NIFTI_UNITS_USEC) {
    const double first = std::isfinite(image.toffset) ? image.toffset : 0;
    if (image.nt > 1) {
      header->times_s = RegularTimes(first * seconds, image.dt * seconds, image.nt);
    } else if (first != 0) {
      header->times_s = {first * seconds};
    }
  }
  if (image.scl_slope != 0 && std::isfinite(image.scl_slope) && std::isfinite(image.scl_inter)) {
    header->slope = image.scl_slope;
    header->intercept = image.scl_inter;
  }
}

}  // namespace

StatusOr<DenseHeader> ReadNiftiHeader(const std::string& path) {
  FOVEA_ASSIGN_OR_RETURN(const InputFile file, InputFile::Open(path));
  FOVEA_ASSIGN_OR_RETURN(std::string start, file.ReadStart(kPackedBytes));
  const bool packed = start.starts_with(kGzipMagic);
  if (packed) {
    start = Inflated(start, sizeof(nifti_2_header));
  }
  const std::filesystem::path name(path);
  const std::string plain = packed ? name.stem().string() : name.filename().string();
  if (FormatByMagic(start) != FileFormat::kNifti && plain.ends_with(".img")) {
    return InvalidArgument("holds voxels without a header: name '{}.hdr'",
                           plain.substr(0, plain.size() - 4));
  }
  FOVEA_ASSIGN_OR_RETURN(const Image image, Understood(start));
  DenseHeader header;
  FOVEA_RETURN_IF_ERROR(SetAxes(*image, &header));
  Place(*image, &header);
  SetUnits(*image, &header);
  header.big_endian = image->byteorder == 2;  // MSB first
  header.encoding = packed ? DataEncoding::kDeflate : DataEncoding::kPlain;
  const bool in_one =
      image->nifti_type == NIFTI_FTYPE_NIFTI1_1 || image->nifti_type == NIFTI_FTYPE_NIFTI2_1;
  if (in_one && !packed) {
    header.data_offset = image->iname_offset;
  } else {
    header.skip_bytes = image->iname_offset;
  }
  if (!in_one) {
    const std::string stem = std::filesystem::path(plain).stem().string();
    header.data_files = {stem + (packed ? ".img.gz" : ".img")};
  }
  FOVEA_RETURN_IF_ERROR(CheckDenseHeader(header));
  return header;
}

}  // namespace fovea::ingest
