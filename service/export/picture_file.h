#ifndef SERVICE_EXPORT_PICTURE_FILE_H_
#define SERVICE_EXPORT_PICTURE_FILE_H_

#include <string>

#include "engine/base/status.h"
#include "service/frames/spec.h"

/// Frames as picture files; the file's name chooses the format.
namespace fovea::exports {

enum class PictureFormat { kPng, kJpeg, kExr, kTiff, kNpy, kFoveated };

/// By the ending: .png .jpg .jpeg .exr .tif .tiff .npy .fvf. INVALID_ARGUMENT for any other.
[[nodiscard]] StatusOr<PictureFormat> PictureFormatOf(const std::string& path);

/// What a frame must be rendered as to be written in this format: PNG, JPEG, FOVEATED or
/// RAW_RGBA_F32.
[[nodiscard]] frames::Encoding EncodingFor(PictureFormat format);

/// Writes the frame, which must have the encoding for this format. The file appears whole or not
/// at all. .exr is half floats, .tif and .npy float32; all three linear and premultiplied.
[[nodiscard]] Status WritePicture(const std::string& path, PictureFormat format,
                                  const frames::Frame& frame);

}  // namespace fovea::exports

#endif  // SERVICE_EXPORT_PICTURE_FILE_H_
