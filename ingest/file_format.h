#ifndef INGEST_FILE_FORMAT_H_
#define INGEST_FILE_FORMAT_H_

#include <cstdint>
#include <string>
#include <string_view>

/// Which reader a foreign file is for. The first bytes decide where they can, else the name.
namespace fovea::ingest {

enum class FileFormat : uint8_t {
  kUnknown,
  kVdb,
  kRaw,  // headerless voxels
  kNpy,
  kNrrd,
  kMetaImage,
  kNifti,    // also Analyze's .hdr and .img
  kPicture,  // a slice, or several: TIFF, PNG, ...
};

/// By the extension, in any case of letters.
[[nodiscard]] FileFormat FormatByName(const std::string& path);
/// By what the file begins with; 352 bytes are enough. kUnknown: nothing that says what it is.
[[nodiscard]] FileFormat FormatByMagic(std::string_view first_bytes);
/// What can be read, for an error: names and extensions.
[[nodiscard]] std::string ListFormats();

/// The name of the JSON file that says how the headerless voxels of `path` lie: NAME.raw.json.
[[nodiscard]] std::string SidecarOf(const std::string& path);

}  // namespace fovea::ingest

#endif  // INGEST_FILE_FORMAT_H_
