#ifndef SERVICE_CLIENT_CHANNEL_H_
#define SERVICE_CLIENT_CHANNEL_H_

#include <memory>
#include <string>

#include <grpcpp/channel.h>

#include "engine/base/status.h"
#include "service/client/client.h"
#include "service/wire/host_port.h"

namespace fovea::client {

/// A channel to `address`, with TLS if `credentials` names an authority. INVALID_ARGUMENT for
/// credentials that do not go together, or a token that would cross a network in plaintext;
/// NOT_FOUND for a file that cannot be read.
[[nodiscard]] StatusOr<std::shared_ptr<grpc::Channel>> MakeChannel(const wire::HostPort& address,
                                                                   const Credentials& credentials);

/// The value of `authorization`: "Bearer TOKEN"; empty without a token file.
[[nodiscard]] StatusOr<std::string> ReadAuthorization(const Credentials& credentials);

}  // namespace fovea::client

#endif  // SERVICE_CLIENT_CHANNEL_H_
