#ifndef SERVICE_SERVER_VIEW_REACTORS_H_
#define SERVICE_SERVER_VIEW_REACTORS_H_

#include <grpcpp/support/server_callback.h>

#include "fovea/v1/render.pb.h"
#include "service/server/services.h"

/// ViewStreams on gRPC. Reactors delete themselves when gRPC is done with them.
namespace fovea::server {

[[nodiscard]] grpc::ServerWriteReactor<v1::Frame>* StartRefineFrame(
    Services& services, const grpc::CallbackServerContext& context,
    const v1::RefineFrameRequest& request);
[[nodiscard]] grpc::ServerBidiReactor<v1::ExploreRequest, v1::Frame>* StartExplore(
    Services& services, const grpc::CallbackServerContext& context);

}  // namespace fovea::server

#endif  // SERVICE_SERVER_VIEW_REACTORS_H_
