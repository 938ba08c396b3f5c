#ifndef SERVICE_SERVER_UNARY_CALL_H_
#define SERVICE_SERVER_UNARY_CALL_H_

#include <functional>
#include <memory>
#include <mutex>
#include <utility>

#include <grpcpp/support/server_callback.h>

#include "engine/base/status.h"
#include "service/server/admission.h"
#include "service/server/give_way.h"
#include "service/server/services.h"
#include "service/wire/requests.h"
#include "service/wire/status.h"

namespace fovea::server {

/// One unary call whose work is done in pools. It ends once, with whatever comes first: its work,
/// or its client's cancel (a passed deadline is one). Work that waits then is dropped; work that
/// runs is let run, and its result thrown away. Lives until gRPC and every job have let go of it.
/// Thread-safe.
template <typename Response>
class UnaryCall final : public grpc::ServerUnaryReactor,
                        public std::enable_shared_from_this<UnaryCall<Response>> {
 public:
  /// The call is over at once if it is not let in (Admit). Hand `get()` to gRPC.
  [[nodiscard]] static std::shared_ptr<UnaryCall> Start(Services& services,
                                                        const grpc::CallbackServerContext& context,
                                                        const Ask& ask, Response* response) {
    auto call = std::make_shared<UnaryCall>(Private(), services, response);
    call->self_ = call;
    auto admission = Admit(services, context, ask);
    if (admission.ok()) {
      call->admission_ = *std::move(admission);
      call->caller_ = call->admission_.caller;
    } else {
      call->Complete(admission.status());
    }
    return call;
  }

  /// Who calls. For the jobs of the call, which may outlast it: they do not run if it was not let
  /// in.
  [[nodiscard]] access::Caller& caller() const { return *caller_; }

  /// On gRPC's thread. Whether the call is over, now if `pool` has no room: before anything is
  /// worked out for it.
  [[nodiscard]] bool IsRefusedBy(WorkPool& pool) {
    if (!over()) {
      if (Status room = pool.CheckRoom(admission_.client); !room.ok()) {
        Complete(std::move(room));
      }
    }
    GiveWay(pool.IsCrowded());
    return over();
  }

  /// Runs `job` in `pool`, unless the call is over before its turn comes. A full pool ends the
  /// call.
  void Enqueue(WorkPool& pool, int64_t bytes, WorkPool::Job job) {
    Status refused;
    {
      const std::lock_guard lock(mutex_);
      if (over_) {
        return;
      }
      auto ticket = pool.Submit(
          bytes,
          [self = this->shared_from_this(), job = std::move(job)](int threads) {
            if (!self->over()) {
              job(threads);
            }
          },
          admission_.client);
      if (ticket.ok()) {
        pool_ = &pool;
        ticket_ = *ticket;
      }
      refused = ticket.status();
    }
    if (!refused.ok()) {
      Complete(refused);
    }
  }

  /// Ends the call; does nothing if it is over.
  void Complete(StatusOr<Response> result) {
    {
      const std::lock_guard lock(mutex_);
      if (over_) {
        return;
      }
      over_ = true;
      if (result.ok()) {
        *response_ = *std::move(result);
      }
    }
    this->Finish(wire::ToGrpc(services_.catalogue->WithoutRoot(result.status())));
  }

  /// Keeps memory set aside until the reply is sent.
  void Hold(MemoryBudget::Reservation reservation) {
    const std::lock_guard lock(mutex_);
    reservation_ = std::move(reservation);
  }

  [[nodiscard]] bool over() {
    const std::lock_guard lock(mutex_);
    return over_;
  }

  void OnCancel() override {
    WorkPool* pool = nullptr;
    WorkPool::Ticket ticket = 0;
    {
      const std::lock_guard lock(mutex_);
      pool = pool_;
      ticket = ticket_;
    }
    if (pool != nullptr) {
      pool->Remove(ticket);
    }
    Complete(Cancelled("the client cancelled, went away, or its deadline passed"));
  }

  void OnDone() override {
    admission_ = Admission();
    self_.reset();  // may be the end of this
  }

 private:
  struct Private {};

 public:
  UnaryCall(Private, Services& services, Response* response)
      : services_(services), response_(response) {}

 private:
  Services& services_;
  std::shared_ptr<UnaryCall> self_;         // set before gRPC knows of it, reset when gRPC is done
  Admission admission_;                     // likewise
  std::shared_ptr<access::Caller> caller_;  // not changed after Start

  std::mutex mutex_;
  // All below: guarded by mutex_.
  bool over_ = false;
  Response* response_;  // gRPC's; not touched once over_
  WorkPool* pool_ = nullptr;
  WorkPool::Ticket ticket_ = 0;
  MemoryBudget::Reservation reservation_;
};

/// A call about one dataset that only looks something up: checks the request (wire::FromProto), and
/// completes with what `look(parsed)` says, in the lookup pool.
template <typename Request, typename Response, typename Look>
grpc::ServerUnaryReactor* LookUp(Services& services, const grpc::CallbackServerContext& context,
                                 const Request& request, Response* response, Look look) {
  const auto call = UnaryCall<Response>::Start(
      services, context, {.dataset = request.dataset(), .request = &request}, response);
  auto parsed = wire::FromProto(request);
  if (!parsed.ok()) {
    call->Complete(parsed.status());
    return call.get();
  }
  call->Enqueue(services.lookups, 0,
                [call, look, parsed = *std::move(parsed)](int) { call->Complete(look(parsed)); });
  return call.get();
}

}  // namespace fovea::server

#endif  // SERVICE_SERVER_UNARY_CALL_H_
