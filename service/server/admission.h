#ifndef SERVICE_SERVER_ADMISSION_H_
#define SERVICE_SERVER_ADMISSION_H_

#include <cstdint>
#include <memory>
#include <string>
#include <utility>

#include <google/protobuf/message.h>
#include <google/protobuf/message.h>
#include <grpcpp/server_context.h>

#include "engine/base/status.h"
#include "service/access/gate.h"
#include "service/server/call_tracker.h"
#include "service/server/services.h"

namespace fovea::server {

/// What a call wants.
struct Ask {
  access::Right right = access::Right::kRead;
  std::string dataset{};  // that it is about; empty: none, or a request that will be refused
  const google::protobuf::Message* request = nullptr;  // null: free, whatever the quota
  bool stream = false;          // whether it counts as one of the token's streams
  bool while_draining = false;  // whether running streams need it
};

/// A call that was let in, and its place among those that run; given back when it goes. Movable.
struct Admission {
  std::shared_ptr<access::Caller> caller;  // never null: what it may do, and its quotas
  std::string client;                      // ClientOf: who shares the server fairly with others
  CallTracker::Slot slot;
  MemoryBudget::Reservation memory;  // of the request and the call itself
  access::Caller::Stream stream;
};

/// Whose call it is, as far as sharing goes: "token:NAME", or without tokens the address, of IPv6
/// its first half (a site has all of the second). `peer` is as gRPC has it.
[[nodiscard]] std::string ClientOf(const access::Caller& caller, const std::string& peer);

/// The one way into every method of fovea.v1, before anything else is done. UNAVAILABLE while the
/// server drains; UNAUTHENTICATED without a token that it knows, if it asks for tokens;
/// PERMISSION_DENIED without the right, or where nobody may write; NOT_FOUND, as if it were not
/// there, for a dataset outside the token's prefix; RESOURCE_EXHAUSTED above a quota, or
/// when the calls that run take all the memory there is for them. Does not
/// wait. Pixels are taken later, when they are known: `caller->TakePixels`. Thread-safe.
[[nodiscard]] StatusOr<Admission> Admit(Services& services,
                                        const grpc::CallbackServerContext& context, const Ask& ask);

}  // namespace fovea::server

#endif  // SERVICE_SERVER_ADMISSION_H_
