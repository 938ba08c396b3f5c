#include "ingest/file_format.h"

#include <algorithm>
#include <utility>

namespace fovea::ingest {
namespace {

using namespace std::string_view_literals;

constexpr std::pair<std::string_view, FileFormat> kExtensions[] = {
    {".vdb", FileFormat::kVdb},       {".raw", FileFormat::kRaw},
    {".npy", FileFormat::kNpy},       {".nrrd", FileFormat::kNrrd},
    {".nhdr", FileFormat::kNrrd},     {".mha", FileFormat::kMetaImage},
    {".mhd", FileFormat::kMetaImage}, {".nii", FileFormat::kNifti},
    {".nii.gz", FileFormat::kNifti},  {".hdr", FileFormat::kNifti},
    {".hdr.gz", FileFormat::kNifti},  {".img", FileFormat::kNifti},
    {".img.gz", FileFormat::kNifti},  {".tif", FileFormat::kPicture},
    {".tiff", FileFormat::kPicture},  {".png", FileFormat::kPicture},
    {".jpg", FileFormat::kPicture},   {".jpeg", FileFormat::kPicture},
    {".exr", FileFormat::kPicture},   {".bmp", FileFormat::kPicture},
    {".tga", FileFormat::kPicture},   {".jp2", FileFormat::kPicture},
    {".webp", FileFormat::kPicture},  {".dpx", FileFormat::kPicture},
    {".pgm", FileFormat::kPicture},   {".ppm", FileFormat::kPicture},
    {".pnm", FileFormat::kPicture},   {".gif", FileFormat::kPicture},
};

constexpr std::pair<std::string_view, FileFormat> kMagics[] = {
    {" BDV\0\0\0\0"sv, FileFormat::kVdb},     {"NRRD000"sv, FileFormat::kNrrd},
    {"\x93NUMPY"sv, FileFormat::kNpy},        {"ObjectType"sv, FileFormat::kMetaImage},
    {"NDims"sv, FileFormat::kMetaImage},      {"II*\0"sv, FileFormat::kPicture},
    {"MM\0*"sv, FileFormat::kPicture},        {"II+\0"sv, FileFormat::kPicture},  // BigTIFF
    {"MM\0+"sv, FileFormat::kPicture},        {"\x89PNG\r\n\x1A\n"sv, FileFormat::kPicture},
    {"\xFF\xD8\xFF"sv, FileFormat::kPicture}, {"v/1\x01"sv, FileFormat::kPicture},  // OpenEXR
};

std::string_view At(std::string_view text, size_t position, size_t count) {
  return position + count <= text.size() ? text.substr(position, count) : ""sv;
}

}  // namespace

FileFormat FormatByName(const std::string& path) {
  std::string name = path.substr(path.rfind('/') == std::string::npos ? 0 : path.rfind('/') + 1);
  std::transform(name.begin(), name.end(), name.begin(),
                 [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c + 32) : c; });
  for (const auto& [extension, format] : kExtensions) {
    if (name.size() > extension.size() && name.ends_with(extension)) {
      return format;
    }
  }
  return FileFormat::kUnknown;
}

FileFormat FormatByMagic(std::string_view first_bytes) {
  for (const auto& [magic, format] : kMagics) {
    if (first_bytes.starts_with(magic)) {
      return format;
    }
  }
  // nifti1.h: magic at byte 344; nifti2.h: at byte 4.
  const std::string_view one = At(first_bytes, 344, 4);
  const std::string_view two = At(first_bytes, 4, 4);
  if (one == "n+1\0"sv || one == "ni1\0"sv || two == "n+2\0"sv || two == "ni2\0"sv) {
    return FileFormat::kNifti;
  }
  return FileFormat::kUnknown;
}

std::string ListFormats() {
  return "OpenVDB (.vdb), NRRD (.nrrd, .nhdr), MetaImage (.mha, .mhd), NIfTI (.nii, .nii.gz, "
         ".hdr with .img), NumPy (.npy), pictures as slices (.tif, .png, .jpg, .exr and others), "
         "and headerless voxels (with --raw, or a NAME.raw.json beside the file)";
}

std::string SidecarOf(const std::string& path) {
  return path + ".json";
}

}  // namespace fovea::ingest
