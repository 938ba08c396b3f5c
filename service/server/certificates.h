#ifndef SERVICE_SERVER_CERTIFICATES_H_
#define SERVICE_SERVER_CERTIFICATES_H_

#include <string>
#include <vector>

#include "engine/base/status.h"

namespace fovea::server {

/// Where the certificates of a server are, all PEM.
struct CertificateFiles {
  std::string certificate;  // the server's own, then those between it and its authority
  std::string key;          // of the server's own, without a passphrase
  std::string client_ca;    // authorities that clients must be of; empty: clients need none

  [[nodiscard]] bool given() const {
    return !certificate.empty() || !key.empty() || !client_ca.empty();
  }
  [[nodiscard]] std::vector<std::string> Paths() const;
};

/// What was read from them, and holds together.
struct Certificates {
  std::string certificate_pem;
  std::string key_pem;
  std::string client_ca_pem;
  std::string summary;  // for the log: whose the certificate is, and until when
};

/// Reads all and checks: everything parses, the key is the certificate's, the certificates are
/// valid now. INVALID_ARGUMENT naming the flag and the file, NOT_FOUND for one that cannot be read.
[[nodiscard]] StatusOr<Certificates> LoadCertificates(const CertificateFiles& files);

}  // namespace fovea::server

#endif  // SERVICE_SERVER_CERTIFICATES_H_
