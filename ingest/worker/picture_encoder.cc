#include "ingest/worker/picture_encoder.h"

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <system_error>
#include <vector>

#include <dlfcn.h>

#include "ingest/worker/picture_module.h"

namespace fovea::ingest {
namespace {

constexpr int64_t kMaxSide = 65536;
constexpr int64_t kMaxPixels = int64_t{1} << 28;

struct PictureModule {
  void* handle = nullptr;
  FoveaEncodePicture encode = nullptr;
  FoveaPictureLibrary library = nullptr;
};

StatusOr<PictureModule> OpenModule() {
  std::error_code error;
  const std::filesystem::path path =
      std::filesystem::read_symlink("/proc/self/exe", error).parent_path() / kFoveaPictureModule;
  void* module = ::dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
  void* encode = module == nullptr ? nullptr : ::dlsym(module, kFoveaEncodePicture);
  void* library = encode == nullptr ? nullptr : ::dlsym(module, kFoveaPictureLibrary);
  if (library == nullptr) {
    const char* reason = ::dlerror();  // NOLINT(concurrency-mt-unsafe)
    return FailedPrecondition(
        "pictures (by their extension: .tif, .png, .exr ...) need the module '{}': {}",
        path.string(), reason == nullptr ? "it is not there" : reason);
  }
  return PictureModule{module, reinterpret_cast<FoveaEncodePicture>(encode),
                       reinterpret_cast<FoveaPictureLibrary>(library)};
}

/// Loaded once: a confined process cannot load it any more.
const StatusOr<PictureModule>& Module() {
  static const StatusOr<PictureModule> module = OpenModule();
  return module;
}

/// All the pixels are taken in before anything can fail, so that the program is never left talking.
StatusOr<std::vector<float>> ReceivePixels(int64_t values, Channel* channel) {
  std::vector<float> rgba(static_cast<size_t>(values));
  auto* bytes = reinterpret_cast<char*>(rgba.data());
  for (size_t left = rgba.size() * sizeof(float); left > 0;) {
    FOVEA_ASSIGN_OR_RETURN(const FrameView frame, channel->Receive(Channel::kNoDeadline));
    if (frame.kind != FrameKind::kBytes || frame.payload.empty() || frame.payload.size() > left) {
      return Internal("malformed message: pixels");
    }
    std::memcpy(bytes, frame.payload.data(), frame.payload.size());
    bytes += frame.payload.size();
    left -= frame.payload.size();
  }
  return rgba;
}

}  // namespace

StatusOr<std::string> LoadPictureModule() {
  FOVEA_ASSIGN_OR_RETURN(const PictureModule module, Module());
  return module.library();
}

StatusOr<void*> PictureModuleHandle() {
  FOVEA_ASSIGN_OR_RETURN(const PictureModule module, Module());
  return module.handle;
}

Status EncodePicture(const PictureRequest& request, Channel* channel) {
  if (request.width < 1 || request.width > kMaxSide || request.height < 1 ||
      request.height > kMaxSide || request.width * request.height > kMaxPixels) {
    return InvalidArgument("a picture of {} x {} pixels", request.width, request.height);
  }
  FOVEA_ASSIGN_OR_RETURN(const std::vector<float> rgba,
                         ReceivePixels(4 * request.width * request.height, channel));
  FOVEA_ASSIGN_OR_RETURN(const PictureModule module, Module());
  std::string encoded;
  char error[512] = "";
  const auto sink = [](void* context, const char* bytes, size_t count) {
    static_cast<std::string*>(context)->assign(bytes, count);
  };
  if (!module.encode(request.format.c_str(), static_cast<int>(request.width),
                     static_cast<int>(request.height), rgba.data(), sink, &encoded, error,
                     sizeof(error))) {
    return Internal("{}", error);
  }
  for (size_t begin = 0; begin < encoded.size(); begin += kMaxPayloadBytes) {
    const Frame piece{FrameKind::kBytes, encoded.substr(begin, kMaxPayloadBytes)};
    FOVEA_RETURN_IF_ERROR(channel->Send(piece, Channel::kNoDeadline));
  }
  return absl::OkStatus();
}

}  // namespace fovea::ingest
