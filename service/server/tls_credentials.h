#ifndef SERVICE_SERVER_TLS_CREDENTIALS_H_
#define SERVICE_SERVER_TLS_CREDENTIALS_H_

#include <memory>
#include <mutex>
#include <string>

#include <grpc/grpc_security.h>
#include <grpcpp/security/server_credentials.h>

#include "service/server/certificates.h"

namespace fovea::server {

/// TLS with certificates that can be replaced while the server runs. gRPC asks for them at each
/// new connection, so a change counts from the next one on; connections there are stay. For one
/// port of one server, which it must outlive. Thread-safe.
class TlsCredentials final : public grpc::ServerCredentials {
 public:
  explicit TlsCredentials(Certificates certificates);

  void Replace(Certificates certificates);

 private:
  int AddPortToServer(const std::string& address, grpc_server* server) override;
  /// Tokens are checked by Admit, on plaintext as well.
  void SetAuthMetadataProcessor(
      const std::shared_ptr<grpc::AuthMetadataProcessor>& /*processor*/) override {}

  static grpc_ssl_certificate_config_reload_status Fetch(void* self,
                                                         grpc_ssl_server_certificate_config** to);

  const bool asks_clients_;
  std::mutex mutex_;
  Certificates certificates_;  // guarded by mutex_
  bool fetched_ = false;       // guarded by mutex_; whether gRPC has these
};

}  // namespace fovea::server

#endif  // SERVICE_SERVER_TLS_CREDENTIALS_H_
