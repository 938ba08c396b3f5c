#include "service/server/admission.h"

#include <string_view>
#include <vector>

namespace fovea::server {
namespace {

constexpr char kAuthorizationKey[] = "authorization";

std::vector<std::string_view> AuthorizationOf(const grpc::CallbackServerContext& context) {
  std::vector<std::string_view> values;
  const auto [first, last] = context.client_metadata().equal_range(kAuthorizationKey);
  for (auto it = first; it != last; ++it) {
    values.emplace_back(it->second.data(), it->second.size());
  }
  return values;
}

}  // namespace

StatusOr<Admission> Admit(Services& services, const grpc::CallbackServerContext& context,
                          const Ask& ask) {
  Admission admission;
  FOVEA_ASSIGN_OR_RETURN(admission.caller, services.gate->Identify(AuthorizationOf(context)));
  access::Caller& caller = *admission.caller;
  if (auto slot = services.calls.Enter()) {
    admission.slot = *std::move(slot);
  } else if (!ask.while_draining) {
    return DrainingError();
  }
  if (!ask.dataset.empty() && !caller.Sees(ask.dataset)) {
    return NoDataset(ask.dataset);
  }
  FOVEA_RETURN_IF_ERROR(caller.Check(ask.right));
  if (ask.right == access::Right::kWrite && !services.writable) {
    return MakeStatus(
        absl::StatusCode::kPermissionDenied,
        "this server changes no datasets; it must be started with --allow-ingest (then everyone "
        "may write), or with --tokens");
  }
  FOVEA_RETURN_IF_ERROR(caller.TakeBytesIn(ask.bytes_in));
  if (ask.stream) {
    FOVEA_ASSIGN_OR_RETURN(admission.stream, access::Caller::OpenStream(admission.caller));
  }
  return admission;
}

}  // namespace fovea::server
