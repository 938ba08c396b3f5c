#include "service/server/call_observer.h"

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <random>
#include <string_view>
#include <utility>

#include <fmt/format.h>
#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>

#include "engine/base/stopwatch.h"
#include "fovea/v1/render.pb.h"
#include "service/server/log.h"
#include "service/server/services.h"
#include "service/wire/status.h"

namespace fovea::server {
namespace {

using grpc::experimental::InterceptionHookPoints;

constexpr char kRequestIdKey[] = "fovea-request-id";

std::string RandomId() {
  thread_local std::mt19937_64 random(std::random_device{}());
  return fmt::format("{:016x}", random());
}

/// Why a call was refused with RESOURCE_EXHAUSTED; its details tell.
const char* ShedReason(const Status& status) {
  if (wire::HasQuota(status)) {
    return "quota";
  }
  return wire::RetryDelayOf(status) ? "overload" : "too_large";
}

/// What the message, or its header, says in a field of that name; else nothing.
std::string DatasetOf(const google::protobuf::Message& message) {
  const auto* type = message.GetDescriptor();
  const auto* reflection = message.GetReflection();
  if (const auto* field = type->FindFieldByName("dataset");
      field != nullptr && !field->is_repeated() &&
      field->cpp_type() == google::protobuf::FieldDescriptor::CPPTYPE_STRING) {
    return reflection->GetString(message, field);
  }
  const auto* header = type->FindFieldByName("header");
  return header != nullptr && header->message_type() != nullptr && !header->is_repeated() &&
                 reflection->HasField(message, header)
             ? DatasetOf(reflection->GetMessage(message, header))
             : "";
}

/// Of "/fovea.v1.Render/RenderFrame".
bool IsMethodOfOurs(std::string path) {
  std::replace(path.begin(), path.end(), '/', '.');
  return path.starts_with(".fovea.v1.") &&
         google::protobuf::DescriptorPool::generated_pool()->FindMethodByName(path.substr(1)) !=
             nullptr;
}

/// gRPC's "ipv6:%5B::1%5D:50123" as people write it: "[::1]:50123".
std::string ReadablePeer(std::string peer) {
  for (const auto& [coded, plain] : {std::pair{"%5B", "["}, {"%5D", "]"}}) {
    if (const size_t at = peer.find(coded); at != std::string::npos) {
      peer.replace(at, 3, plain);
    }
  }
  return peer.substr(peer.starts_with("ipv") ? peer.find(':') + 1 : 0);
}

}  // namespace

/// One call; gRPC owns it.
class ObservedCall final : public grpc::experimental::Interceptor {
 public:
  ObservedCall(CallObserver& observer, grpc::experimental::ServerRpcInfo& info)
      : observer_(observer),
        context_(*info.server_context()),
        path_(info.method()),
        is_ours_(path_.starts_with("/fovea.v1.")),
        is_unary_(info.type() == grpc::experimental::ServerRpcInfo::Type::UNARY),
        method_(observer.metrics_.OfMethod(path_)),
        id_(RandomId()) {
    context_.AddTrailingMetadata(kRequestIdKey, id_);
    method_.Started();
    const std::lock_guard lock(observer_.mutex_);
    observer_.running_[&context_] = this;
  }

  ~ObservedCall() override {
    if (!ended_) {
      End(Cancelled("the call was given up before it was answered"));
    }
  }

  void Intercept(grpc::experimental::InterceptorBatchMethods* methods) override {
    if (peer_.empty()) {  // not known yet when this is made, and not any more when it goes
      peer_ = ReadablePeer(context_.peer());
    }
    if (is_ours_ &&
        methods->QueryInterceptionHookPoint(InterceptionHookPoints::POST_RECV_MESSAGE)) {
      OnReceived(static_cast<const google::protobuf::Message*>(methods->GetRecvMessage()));
    }
    if (is_ours_ && methods->QueryInterceptionHookPoint(InterceptionHookPoints::PRE_SEND_MESSAGE)) {
      OnSend(static_cast<const google::protobuf::Message*>(methods->GetSendMessage()));
    }
    if (methods->QueryInterceptionHookPoint(InterceptionHookPoints::PRE_SEND_STATUS)) {
      Status status = wire::FromGrpc(methods->GetSendStatus());
      if (absl::IsUnimplemented(status) && status.message().empty() && IsMethodOfOurs(path_)) {
        // gRPC says this of bytes that are no message of a method that we have; our own have words.
        status = context_.IsCancelled()
                     ? Cancelled("the client was gone before its request came")
                     : InvalidArgument("the request is no message of this method");
        methods->ModifySendStatus(wire::ToGrpc(status));
      } else if (absl::IsCancelled(status) && observer_.cutting_short_) {
        status = DrainingError();  // it was not the client who ended it
      }
      End(status);
    }
    methods->Proceed();
  }

  /// With the observer's mutex held.
  void Describe(const std::string& client, const std::string& dataset) {
    client_ = client;
    dataset_ = dataset.empty() ? dataset_ : dataset;
  }

 private:
  void OnReceived(const google::protobuf::Message* message) {
    if (message == nullptr) {  // at the end of a client's stream
      return;
    }
    method_.Received(static_cast<int64_t>(message->ByteSizeLong()));
    const std::lock_guard lock(observer_.mutex_);
    if (!ended_ && dataset_.empty()) {  // streams learn it from their first message
      dataset_ = DatasetOf(*message);
    }
  }

  void OnSend(const google::protobuf::Message* message) {
    if (message == nullptr) {
      return;
    }
    const auto bytes = static_cast<int64_t>(message->ByteSizeLong());
    method_.Sent(bytes);
    bytes_sent_.fetch_add(bytes, std::memory_order_relaxed);
    if (message->GetDescriptor() == v1::Frame::descriptor()) {
      const auto& frame = static_cast<const v1::Frame&>(*message);
      observer_.metrics_.FrameSent(v1::Encoding_Name(frame.encoding()),
                                   static_cast<int64_t>(frame.pixels().size()),
                                   static_cast<int64_t>(frame.stats().coefficients()));
      if (is_unary_) {
        method_.FrameAged(watch_.ElapsedMs() / 1e3);
      }
    }
  }

  /// Once. Nothing describes the call any more when it returns.
  void End(const Status& status) {
    {
      const std::lock_guard lock(observer_.mutex_);
      ended_ = true;
      const auto found = observer_.running_.find(&context_);
      if (found != observer_.running_.end() && found->second == this) {  // else: the next call's
        observer_.running_.erase(found);
      }
    }
    const double ms = watch_.ElapsedMs();
    method_.Ended(status.code(), ms / 1e3);
    if (absl::IsResourceExhausted(status)) {
      observer_.metrics_.Shed(ShedReason(status));
    }
    LogCall({.method = std::string_view(path_).substr(1),
             .request_id = id_,
             .client = client_,
             .peer = peer_,
             .dataset = dataset_,
             .ms = ms,
             .bytes_sent = bytes_sent_.load(std::memory_order_relaxed),
             .status = status});
  }

  CallObserver& observer_;
  grpc::ServerContextBase& context_;
  const std::string path_;
  const bool is_ours_;  // else its messages may be bytes
  const bool is_unary_;
  Metrics::Method& method_;
  const std::string id_;
  const Stopwatch watch_;
  std::atomic<int64_t> bytes_sent_ = 0;
  std::string peer_;
  bool ended_ = false;            // guarded by the observer's mutex
  std::string client_, dataset_;  // guarded by the observer's mutex until the end
};

std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface> CallObserver::Factory() {
  class Interceptors final : public grpc::experimental::ServerInterceptorFactoryInterface {
   public:
    explicit Interceptors(CallObserver& observer) : observer_(observer) {}
    grpc::experimental::Interceptor* CreateServerInterceptor(
        grpc::experimental::ServerRpcInfo* info) override {
      return new ObservedCall(observer_, *info);  // gRPC deletes it
    }

   private:
    CallObserver& observer_;
  };
  return std::make_unique<Interceptors>(*this);
}

void CallObserver::Describe(const grpc::ServerContextBase& context, const std::string& client,
                            const std::string& dataset) {
  const std::lock_guard lock(mutex_);
  if (const auto found = running_.find(&context); found != running_.end()) {
    found->second->Describe(client, dataset);
  }
}

}  // namespace fovea::server
