#ifndef INGEST_WORKER_PICTURE_ENCODER_H_
#define INGEST_WORKER_PICTURE_ENCODER_H_

#include <string>

#include "engine/base/status.h"
#include "ingest/channel.h"
#include "ingest/protocol.h"

namespace fovea::ingest {

/// Loads the picture module, which a confined process cannot do any more; OpenImageIO's version.
[[nodiscard]] StatusOr<std::string> LoadPictureModule();

/// The module itself, for dlsym; an error if it was not loaded.
[[nodiscard]] StatusOr<void*> PictureModuleHandle();

/// Receives the pixels that follow `request`, encodes them through the picture module and sends the
/// bytes of the file.
[[nodiscard]] Status EncodePicture(const PictureRequest& request, Channel* channel);

}  // namespace fovea::ingest

#endif  // INGEST_WORKER_PICTURE_ENCODER_H_
