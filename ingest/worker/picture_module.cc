#include "ingest/worker/picture_module.h"

#include <algorithm>
#include <cstdint>
#include <exception>
#include <memory>
#include <string>
#include <vector>

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

namespace {

/// Returns what went wrong, or nothing.
std::string Encode(const std::string& format, int width, int height, const float* rgba,
                   std::vector<unsigned char>* bytes) {
  const std::string name = "picture." + format;
  const std::unique_ptr<OIIO::ImageOutput> output = OIIO::ImageOutput::create(name);
  if (output == nullptr) {
    return "OpenImageIO cannot write this format: " + OIIO::geterror();
  }
  OIIO::Filesystem::IOVecOutput memory(*bytes);
  OIIO::ImageSpec spec(width, height, 4,
                       format == "exr" ? OIIO::TypeDesc::HALF : OIIO::TypeDesc::FLOAT);
  spec.attribute("compression", "zip");
  // Otherwise OpenImageIO writes the time, and the same picture is never the same file again.
  spec.attribute("DateTime", "1970:01:01 00:00:00");
  const bool done = output->set_ioproxy(&memory) && output->open(name, spec) &&
                    output->write_image(OIIO::TypeDesc::FLOAT, rgba) && output->close();
  const std::string reason = output->geterror();
  return done ? std::string() : "OpenImageIO: " + reason;
}

}  // namespace

extern "C" bool fovea_encode_picture(const char* format, int width, int height, const float* rgba,
                                     FoveaPictureSink sink, void* context, char* error,
                                     size_t error_bytes) {
  std::string reason;
  try {
    std::vector<unsigned char> bytes;
    reason = Encode(format, width, height, rgba, &bytes);
    if (reason.empty()) {
      sink(context, reinterpret_cast<const char*>(bytes.data()), bytes.size());
      return true;
    }
  } catch (const std::exception& exception) {
    reason = exception.what();
  }
  const size_t count = std::min(reason.size(), error_bytes - 1);
  std::copy_n(reason.begin(), count, error);
  error[count] = '\0';
  return false;
}

extern "C" const char* fovea_picture_library() {
  return OIIO_VERSION_STRING;
}
