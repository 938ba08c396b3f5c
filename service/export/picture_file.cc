#include "service/export/picture_file.h"

#include <algorithm>
#include <cctype>
#include <cstring>
#include <filesystem>
#include <vector>

#include "ingest/ingest.h"
#include "service/export/npy.h"
#include "service/export/output_file.h"

namespace fovea::exports {

StatusOr<PictureFormat> PictureFormatOf(const std::string& path) {
  std::string ending = std::filesystem::path(path).extension().string();
  std::transform(ending.begin(), ending.end(), ending.begin(),
                 [](unsigned char letter) { return std::tolower(letter); });
  if (ending == ".png") {
    return PictureFormat::kPng;
  }
  if (ending == ".jpg" || ending == ".jpeg") {
    return PictureFormat::kJpeg;
  }
  if (ending == ".exr") {
    return PictureFormat::kExr;
  }
  if (ending == ".tif" || ending == ".tiff") {
    return PictureFormat::kTiff;
  }
  if (ending == ".npy") {
    return PictureFormat::kNpy;
  }
  if (ending == ".fvf") {
    return PictureFormat::kFoveated;
  }
  return InvalidArgument(
      "'{}' does not end in a picture format that can be written: .png .jpg "
      ".exr .tif .npy .fvf",
      path);
}

frames::Encoding EncodingFor(PictureFormat format) {
  switch (format) {
    case PictureFormat::kPng:
      return frames::Encoding::kPng;
    case PictureFormat::kJpeg:
      return frames::Encoding::kJpeg;
    case PictureFormat::kFoveated:
      return frames::Encoding::kFoveated;
    case PictureFormat::kExr:
    case PictureFormat::kTiff:
    case PictureFormat::kNpy:
      break;
  }
  return frames::Encoding::kRawRgbaF32;
}

Status WritePicture(const std::string& path, PictureFormat format, const frames::Frame& frame) {
  switch (format) {
    case PictureFormat::kPng:
    case PictureFormat::kJpeg:
    case PictureFormat::kFoveated:
      return WriteWholeFile(path, frame.pixels);
    case PictureFormat::kNpy:
      return WriteWholeFile(path, NpyHeader({frame.height_px, frame.width_px, 4}) + frame.pixels);
    case PictureFormat::kExr:
    case PictureFormat::kTiff:
      break;
  }
  FOVEA_RETURN_IF_ERROR(MakeParentFolder(path));
  std::vector<float> rgba(frame.pixels.size() / sizeof(float));
  std::memcpy(rgba.data(), frame.pixels.data(), rgba.size() * sizeof(float));
  return ingest::WritePictureFile(path, frame.width_px, frame.height_px, rgba);
}

}  // namespace fovea::exports
