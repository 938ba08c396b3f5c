#include "service/server/tls_credentials.h"

#include <utility>

#include <grpc/grpc.h>

namespace fovea::server {

TlsCredentials::TlsCredentials(Certificates certificates)
    : asks_clients_(!certificates.client_ca_pem.empty()), certificates_(std::move(certificates)) {}

void TlsCredentials::Replace(Certificates certificates) {
  const std::lock_guard lock(mutex_);
  certificates_ = std::move(certificates);
  fetched_ = false;
}

int TlsCredentials::AddPortToServer(const std::string& address, grpc_server* server) {
  grpc_server_credentials* credentials = grpc_ssl_server_credentials_create_with_options(
      grpc_ssl_server_credentials_create_options_using_config_fetcher(
          asks_clients_ ? GRPC_SSL_REQUEST_AND_REQUIRE_CLIENT_CERTIFICATE_AND_VERIFY
                        : GRPC_SSL_DONT_REQUEST_CLIENT_CERTIFICATE,
          Fetch, this));
  const int port = grpc_server_add_http2_port(server, address.c_str(), credentials);
  grpc_server_credentials_release(credentials);
  return port;
}

grpc_ssl_certificate_config_reload_status TlsCredentials::Fetch(
    void* self, grpc_ssl_server_certificate_config** to) {
  auto& credentials = *static_cast<TlsCredentials*>(self);
  const std::lock_guard lock(credentials.mutex_);
  if (credentials.fetched_) {
    return GRPC_SSL_CERTIFICATE_CONFIG_RELOAD_UNCHANGED;
  }
  const Certificates& now = credentials.certificates_;
  const grpc_ssl_pem_key_cert_pair pair = {now.key_pem.c_str(), now.certificate_pem.c_str()};
  // gRPC 1.51 aborts without authorities, though it asks clients for nothing then.
  const std::string& authorities =
      now.client_ca_pem.empty() ? now.certificate_pem : now.client_ca_pem;
  *to = grpc_ssl_server_certificate_config_create(authorities.c_str(), &pair, 1);
  credentials.fetched_ = true;
  return GRPC_SSL_CERTIFICATE_CONFIG_RELOAD_NEW;
}

}  // namespace fovea::server
