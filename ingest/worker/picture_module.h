#ifndef INGEST_WORKER_PICTURE_MODULE_H_
#define INGEST_WORKER_PICTURE_MODULE_H_

#include <cstddef>

/// The door to OpenImageIO: a module of its own (fovea_oiio.so, beside the worker), because loading
/// OpenImageIO takes most of a second and only pictures need it.
extern "C" {

using FoveaPictureSink = void (*)(void* context, const char* bytes, size_t count);

/// Encodes width x height premultiplied linear RGBA as "exr" (half) or "tif" (float) and gives the
/// whole file to `sink`, once. False on failure, with the reason in `error` (zero-terminated).
using FoveaEncodePicture = bool (*)(const char* format, int width, int height, const float* rgba,
                                    FoveaPictureSink sink, void* context, char* error,
                                    size_t error_bytes);

/// The version of OpenImageIO, "2.4.7".
using FoveaPictureLibrary = const char* (*)();
}

inline constexpr char kFoveaPictureModule[] = "fovea_oiio.so";
inline constexpr char kFoveaEncodePicture[] = "fovea_encode_picture";
inline constexpr char kFoveaPictureLibrary[] = "fovea_picture_library";

#endif  // INGEST_WORKER_PICTURE_MODULE_H_
