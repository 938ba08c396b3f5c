#ifndef SERVICE_CLIENT_CHANNEL_H_
#define SERVICE_CLIENT_CHANNEL_H_

#include <memory>
#include <string>

#include <grpcpp/channel.h>

#include "engine/base/status.h"
#include "service/client/call_options.h"
#include "service/client/client.h"

namespace fovea::client {

/// A way to a server, and what every call there carries.
struct Connection {
  std::string address;  // HOST:PORT
  std::shared_ptr<grpc::Channel> channel;
  CallMetadata metadata;
};

/// To `address`, HOST:PORT, with TLS if `credentials` names an authority. INVALID_ARGUMENT for
/// anything else, for credentials that do not go together, and for a token that would cross a
/// network in plaintext; NOT_FOUND for a file that cannot be read. Connects with the first call.
[[nodiscard]] StatusOr<Connection> OpenConnection(const std::string& address,
                                                  const Credentials& credentials);

/// An error of the server at `address` ("HOST:PORT"): says which server, and keeps what the details
/// point at. OK stays OK.
[[nodiscard]] Status Explain(const std::string& address, const Status& status);

}  // namespace fovea::client

#endif  // SERVICE_CLIENT_CHANNEL_H_
