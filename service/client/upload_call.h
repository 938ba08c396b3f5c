#ifndef SERVICE_CLIENT_UPLOAD_CALL_H_
#define SERVICE_CLIENT_UPLOAD_CALL_H_

#include <functional>

#include <grpcpp/client_context.h>

#include "fovea/v1/ingest.grpc.pb.h"
#include "service/client/upload.h"

namespace fovea::client {

/// One UploadStep, from the first message to the answer. `prepare` adds metadata. Errors are the
/// server's, or those of `give`.
[[nodiscard]] StatusOr<UploadAnswer> CallUploadStep(
    v1::Ingest::Stub& stub, const std::function<void(grpc::ClientContext*)>& prepare,
    const UploadSpec& spec, const GiveVoxels& give);

}  // namespace fovea::client

#endif  // SERVICE_CLIENT_UPLOAD_CALL_H_
