#include "service/frames/encode.h"

#include <bit>
#include <csetjmp>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <vector>

#include <jpeglib.h>
#include <png.h>

namespace fovea::frames {
namespace {

std::vector<uint8_t> DropAlpha(const std::vector<uint8_t>& rgba) {
  const size_t pixels = rgba.size() / 4;
  std::vector<uint8_t> rgb(3 * pixels);
  for (size_t i = 0; i < pixels; ++i) {
    std::memcpy(&rgb[3 * i], &rgba[4 * i], 3);
  }
  return rgb;
}

StatusOr<std::string> EncodePng(const std::vector<uint8_t>& rgb, int width, int height) {
  png_image picture{};
  picture.version = PNG_IMAGE_VERSION;
  picture.width = static_cast<png_uint_32>(width);
  picture.height = static_cast<png_uint_32>(height);
  picture.format =
      PNG_FORMAT_RGB;  // 8-bit formats of this interface are written with an sRGB chunk
  picture.flags = PNG_IMAGE_FLAG_FAST;
  png_alloc_size_t size = PNG_IMAGE_PNG_SIZE_MAX(picture);
  std::string bytes(size, '\0');
  if (png_image_write_to_memory(&picture, bytes.data(), &size, 0, rgb.data(), 0, nullptr) == 0) {
    return Internal("cannot encode a {}x{} PNG: {}", width, height, picture.message);
  }
  bytes.resize(size);
  return bytes;
}

/// libjpeg's own error handler ends the process.
struct JpegErrors {
  jpeg_error_mgr base;
  std::jmp_buf escape;
  char message[JMSG_LENGTH_MAX];
};

void OnJpegError(j_common_ptr info) {
  auto* errors = reinterpret_cast<JpegErrors*>(info->err);
  (*info->err->format_message)(info, errors->message);
  std::longjmp(errors->escape, 1);
}

/// Plain C below, so that longjmp passes over no destructor. Returns false with `errors->message`.
bool WriteJpeg(const uint8_t* rgb, int width, int height, int quality, JpegErrors* errors,
               unsigned char** bytes, unsigned long* size) {
  jpeg_compress_struct info{};
  info.err = jpeg_std_error(&errors->base);
  errors->base.error_exit = OnJpegError;
  if (setjmp(errors->escape) != 0) {
    jpeg_destroy_compress(&info);
    return false;
  }
  jpeg_create_compress(&info);
  jpeg_mem_dest(&info, bytes, size);
  info.image_width = static_cast<JDIMENSION>(width);
  info.image_height = static_cast<JDIMENSION>(height);
  info.input_components = 3;
  info.in_color_space = JCS_RGB;
  jpeg_set_defaults(&info);
  jpeg_set_quality(&info, quality, TRUE);
  // Full-resolution chroma: transfer functions paint saturated edges.
  info.comp_info[0].h_samp_factor = 1;
  info.comp_info[0].v_samp_factor = 1;
  jpeg_start_compress(&info, TRUE);
  while (info.next_scanline < info.image_height) {
    auto* row = const_cast<JSAMPROW>(rgb + size_t{3} * info.image_width * info.next_scanline);
    jpeg_write_scanlines(&info, &row, 1);
  }
  jpeg_finish_compress(&info);
  jpeg_destroy_compress(&info);
  return true;
}

StatusOr<std::string> EncodeJpeg(const std::vector<uint8_t>& rgb, int width, int height,
                                 int quality) {
  JpegErrors errors{};
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  const bool ok = WriteJpeg(rgb.data(), width, height, quality, &errors, &bytes, &size);
  std::string result;
  if (ok) {
    result.assign(reinterpret_cast<const char*>(bytes), size);
  }
  std::free(bytes);
  if (!ok) {
    return Internal("cannot encode a {}x{} JPEG: {}", width, height, errors.message);
  }
  return result;
}

}  // namespace

StatusOr<std::string> Encode(const render::Image& image, Encoding encoding,
                             const render::Color& background, int jpeg_quality) {
  if (encoding == Encoding::kRawRgbaF32) {
    static_assert(std::endian::native == std::endian::little);
    return std::string(reinterpret_cast<const char*>(image.rgba.data()),
                       image.rgba.size() * sizeof(float));
  }
  const std::vector<uint8_t> rgba = render::ToSrgb8(image, background);
  switch (encoding) {
    case Encoding::kPng:
      return EncodePng(DropAlpha(rgba), image.width, image.height);
    case Encoding::kJpeg:
      return EncodeJpeg(DropAlpha(rgba), image.width, image.height, jpeg_quality);
    case Encoding::kFoveated:
      return InvalidArgument("a picture that is expanded cannot become a FOVEATED frame");
    case Encoding::kRawRgba8:
    case Encoding::kRawRgbaF32:
      break;
  }
  return std::string(rgba.begin(), rgba.end());
}

const char* EncodingName(Encoding encoding) {
  switch (encoding) {
    case Encoding::kPng:
      return "PNG";
    case Encoding::kJpeg:
      return "JPEG";
    case Encoding::kRawRgba8:
      return "RAW_RGBA8";
    case Encoding::kRawRgbaF32:
      return "RAW_RGBA_F32";
    case Encoding::kFoveated:
      return "FOVEATED";
  }
  return "PNG";
}

}  // namespace fovea::frames
