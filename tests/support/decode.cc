#include "tests/support/decode.h"

#include <cstdio>

#include <jpeglib.h>
#include <png.h>

namespace fovea::testing {

Decoded DecodePng(const std::string& bytes) {
  png_image picture{};
  picture.version = PNG_IMAGE_VERSION;
  if (png_image_begin_read_from_memory(&picture, bytes.data(), bytes.size()) == 0) {
    return {};
  }
  picture.format = PNG_FORMAT_RGB;
  Decoded decoded{static_cast<int>(picture.width), static_cast<int>(picture.height), {}};
  decoded.rgb.resize(PNG_IMAGE_SIZE(picture));
  if (png_image_finish_read(&picture, nullptr, decoded.rgb.data(), 0, nullptr) == 0) {
    return {};
  }
  return decoded;
}

Decoded DecodeJpeg(const std::string& bytes) {
  jpeg_decompress_struct info{};
  jpeg_error_mgr errors{};
  info.err = jpeg_std_error(&errors);
  jpeg_create_decompress(&info);
  jpeg_mem_src(&info, reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size());
  jpeg_read_header(&info, TRUE);
  info.out_color_space = JCS_RGB;
  jpeg_start_decompress(&info);
  Decoded decoded{static_cast<int>(info.output_width), static_cast<int>(info.output_height), {}};
  decoded.rgb.resize(size_t{3} * info.output_width * info.output_height);
  while (info.output_scanline < info.output_height) {
    JSAMPROW row = decoded.rgb.data() + size_t{3} * info.output_width * info.output_scanline;
    jpeg_read_scanlines(&info, &row, 1);
  }
  jpeg_finish_decompress(&info);
  jpeg_destroy_decompress(&info);
  return decoded;
}

}  // namespace fovea::testing
