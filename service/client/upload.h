#ifndef SERVICE_CLIENT_UPLOAD_H_
#define SERVICE_CLIENT_UPLOAD_H_

#include <cstddef>
#include <functional>
#include <span>

#include "engine/base/status.h"
#include "service/wire/upload_spec.h"

namespace fovea::client {

using UploadSpec = wire::UploadSpec;
using UploadAnswer = wire::UploadAnswer;

/// Sends the next bytes of a step, as many as one likes at a time. CANCELLED once the server wants
/// no more of them: then return that, the upload knows why.
using SendVoxels = std::function<Status(std::span<const std::byte>)>;
/// Gives all voxels of a step to `send`: of each field in turn, x fastest, then y, then z.
using GiveVoxels = std::function<Status(const SendVoxels& send)>;

}  // namespace fovea::client

#endif  // SERVICE_CLIENT_UPLOAD_H_
