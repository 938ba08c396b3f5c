#include "service/server/admission.h"

#include <algorithm>
#include <string_view>
#include <vector>

#include <arpa/inet.h>
#include <netinet/in.h>

namespace fovea::server {
namespace {

constexpr char kAuthorizationKey[] = "authorization";
/// What gRPC and we keep of a call besides its request.
constexpr int64_t kCallBytes = int64_t{32} << 10;

std::vector<std::string_view> AuthorizationOf(const grpc::CallbackServerContext& context) {
  std::vector<std::string_view> values;
  const auto [first, last] = context.client_metadata().equal_range(kAuthorizationKey);
  for (auto it = first; it != last; ++it) {
    values.emplace_back(it->second.data(), it->second.size());
  }
  return values;
}

/// The first half of an IPv6 address in brackets, bare or percent-encoded ("%5B::1%5D").
std::string SiteOf(std::string_view address) {
  for (const char* bracket : {"[", "%5B", "%5b"}) {
    address.remove_prefix(address.starts_with(bracket) ? std::string_view(bracket).size() : 0);
  }
  const size_t end = std::min({address.find(']'), address.find('%'), address.size()});
  in6_addr site{};
  if (inet_pton(AF_INET6, std::string(address.substr(0, end)).c_str(), &site) != 1) {
    return std::string(address);
  }
  if (!IN6_IS_ADDR_V4MAPPED(&site)) {
    std::fill(std::begin(site.s6_addr) + 8, std::end(site.s6_addr), uint8_t{0});
  }
  char text[INET6_ADDRSTRLEN];
  return inet_ntop(AF_INET6, &site, text, sizeof(text));
}

}  // namespace

std::string ClientOf(const access::Caller& caller, const std::string& peer) {
  if (!caller.name().empty()) {
    return "token:" + caller.name();
  }
  const std::string_view address = std::string_view(peer).substr(0, peer.rfind(':'));
  constexpr std::string_view kV6 = "ipv6:";
  return address.starts_with(kV6) ? SiteOf(address.substr(kV6.size()))
                                  : std::string(address.substr(address.find(':') + 1));
}

StatusOr<Admission> Admit(Services& services, const grpc::CallbackServerContext& context,
                          const Ask& ask) {
  Admission admission;
  FOVEA_ASSIGN_OR_RETURN(admission.caller, services.gate->Identify(AuthorizationOf(context)));
  access::Caller& caller = *admission.caller;
  admission.client = ClientOf(caller, context.peer());
  services.observer.Describe(context, admission.client, ask.dataset);
  if (auto slot = services.calls.Enter()) {
    admission.slot = *std::move(slot);
  } else if (!ask.while_draining) {
    return DrainingError();
  }
  int64_t bytes_in = 0, parsed_bytes = 0;
  if (ask.request != nullptr) {
    bytes_in = static_cast<int64_t>(ask.request->ByteSizeLong());
    // Of many small messages many times as much.
    parsed_bytes = static_cast<int64_t>(ask.request->SpaceUsedLong());
  }
  FOVEA_ASSIGN_OR_RETURN(admission.memory,
                         services.requests.Reserve(bytes_in + parsed_bytes + kCallBytes));
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
  if (bytes_in > 0) {
    FOVEA_RETURN_IF_ERROR(caller.TakeBytesIn(bytes_in));
  }
  if (ask.stream) {
    FOVEA_ASSIGN_OR_RETURN(admission.stream, access::Caller::OpenStream(admission.caller));
  }
  return admission;
}

}  // namespace fovea::server
