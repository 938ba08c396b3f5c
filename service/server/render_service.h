#ifndef SERVICE_SERVER_RENDER_SERVICE_H_
#define SERVICE_SERVER_RENDER_SERVICE_H_

#include "fovea/v1/render.grpc.pb.h"
#include "service/server/services.h"

namespace fovea::server {

/// fovea.v1.Render. Thread-safe.
class RenderService final : public v1::Render::CallbackService {
 public:
  explicit RenderService(Services& services) : services_(services) {}

  grpc::ServerUnaryReactor* RenderFrame(grpc::CallbackServerContext* context,
                                        const v1::RenderFrameRequest* request,
                                        v1::Frame* response) override;
  grpc::ServerWriteReactor<v1::Frame>* RenderSequence(
      grpc::CallbackServerContext* context, const v1::RenderSequenceRequest* request) override;
  grpc::ServerWriteReactor<v1::Frame>* RefineFrame(grpc::CallbackServerContext* context,
                                                   const v1::RefineFrameRequest* request) override;
  grpc::ServerBidiReactor<v1::ExploreRequest, v1::Frame>* Explore(
      grpc::CallbackServerContext* context) override;
  grpc::ServerUnaryReactor* PlanFrame(grpc::CallbackServerContext* context,
                                      const v1::PlanFrameRequest* request,
                                      v1::FramePlan* response) override;
  grpc::ServerUnaryReactor* Acknowledge(grpc::CallbackServerContext* context,
                                        const v1::AcknowledgeRequest* request,
                                        v1::AcknowledgeResponse* response) override;

 private:
  Services& services_;
};

}  // namespace fovea::server

#endif  // SERVICE_SERVER_RENDER_SERVICE_H_
