#include "service/server/certificates.h"

#include <array>
#include <cerrno>
#include <fstream>
#include <memory>
#include <system_error>
#include <utility>

#include <openssl/bio.h>
#include <openssl/err.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/x509.h>

#include "service/wire/printable.h"

namespace fovea::server {
namespace {

constexpr size_t kMaxFileBytes = size_t{1} << 20;

template <auto kFree>
struct Free {
  template <typename T>
  void operator()(T* object) const {
    kFree(object);
  }
};
using Bio = std::unique_ptr<BIO, Free<BIO_free_all>>;
using Certificate = std::unique_ptr<X509, Free<X509_free>>;
using Key = std::unique_ptr<EVP_PKEY, Free<EVP_PKEY_free>>;

/// A file that was named by a flag.
struct Source {
  const char* flag;
  const std::string& path;

  [[nodiscard]] Status Wrong(std::string_view what) const {
    return InvalidArgument("{}: '{}' {}", flag, path, what);
  }
};

StatusOr<std::string> ReadAll(const Source& source) {
  std::ifstream file(source.path, std::ios::binary);
  if (!file) {
    return NotFound("{}: cannot read '{}': {}", source.flag, source.path,
                    std::generic_category().message(errno));
  }
  std::string text(kMaxFileBytes + 1, '\0');
  file.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<size_t>(file.gcount()));
  if (text.size() > kMaxFileBytes) {
    return source.Wrong("is larger than 1 MiB");
  }
  return text;
}

Bio MemoryOf(const std::string& text) {
  return Bio(BIO_new_mem_buf(text.data(), static_cast<int>(text.size())));
}

Status CheckTime(const Source& source, const X509& certificate) {
  if (X509_cmp_current_time(X509_get0_notAfter(&certificate)) <= 0) {
    return source.Wrong("has expired");
  }
  if (X509_cmp_current_time(X509_get0_notBefore(&certificate)) >= 0) {
    return source.Wrong("is not valid yet");
  }
  return absl::OkStatus();
}

/// All certificates of a file; at least one.
StatusOr<std::vector<Certificate>> ParseCertificates(const Source& source, const std::string& pem) {
  const Bio bio = MemoryOf(pem);
  std::vector<Certificate> certificates;
  while (X509* one = PEM_read_bio_X509(bio.get(), nullptr, nullptr, nullptr)) {
    certificates.emplace_back(one);
    FOVEA_RETURN_IF_ERROR(CheckTime(source, *one));
  }
  // The end of the file is an error, too: that nothing more begins.
  const bool at_end = ERR_GET_REASON(ERR_peek_last_error()) == PEM_R_NO_START_LINE;
  ERR_clear_error();
  if (certificates.empty() || !at_end) {
    return source.Wrong(certificates.empty() ? "holds no certificate in PEM"
                                             : "holds a damaged certificate");
  }
  return certificates;
}

StatusOr<Key> ParseKey(const Source& source, const std::string& pem) {
  const auto no_passphrase = [](char*, int, int, void*) { return 0; };
  const Bio bio = MemoryOf(pem);
  Key key(PEM_read_bio_PrivateKey(bio.get(), nullptr, no_passphrase, nullptr));
  ERR_clear_error();
  if (key == nullptr) {
    return source.Wrong("holds no private key in PEM, or one with a passphrase");
  }
  return key;
}

std::string Summary(const X509& certificate) {
  const Bio bio(BIO_new(BIO_s_mem()));
  X509_NAME_print_ex(bio.get(), X509_get_subject_name(&certificate), 0, XN_FLAG_ONELINE);
  BIO_puts(bio.get(), ", valid until ");
  ASN1_TIME_print(bio.get(), X509_get0_notAfter(&certificate));
  std::array<char, 256> text{};
  const int size = BIO_read(bio.get(), text.data(), text.size());
  return wire::Printable({text.data(), static_cast<size_t>(std::max(size, 0))}, text.size());
}

}  // namespace

std::vector<std::string> CertificateFiles::Paths() const {
  std::vector<std::string> paths = {certificate, key};
  if (!client_ca.empty()) {
    paths.push_back(client_ca);
  }
  return paths;
}

StatusOr<Certificates> LoadCertificates(const CertificateFiles& files) {
  const Source certificate{"--tls-cert", files.certificate};
  const Source key{"--tls-key", files.key};
  const Source client_ca{"--tls-client-ca", files.client_ca};
  if (files.certificate.empty() || files.key.empty()) {
    return InvalidArgument("--tls-cert and --tls-key: TLS needs both");
  }
  Certificates loaded;
  FOVEA_ASSIGN_OR_RETURN(loaded.certificate_pem, ReadAll(certificate));
  FOVEA_ASSIGN_OR_RETURN(loaded.key_pem, ReadAll(key));
  FOVEA_ASSIGN_OR_RETURN(const auto chain, ParseCertificates(certificate, loaded.certificate_pem));
  FOVEA_ASSIGN_OR_RETURN(const Key private_key, ParseKey(key, loaded.key_pem));
  if (X509_check_private_key(chain.front().get(), private_key.get()) != 1) {
    ERR_clear_error();
    return key.Wrong(
        fmt::format("is not the key of the first certificate in '{}'", files.certificate));
  }
  if (!files.client_ca.empty()) {
    FOVEA_ASSIGN_OR_RETURN(loaded.client_ca_pem, ReadAll(client_ca));
    FOVEA_RETURN_IF_ERROR(ParseCertificates(client_ca, loaded.client_ca_pem).status());
  }
  loaded.summary = Summary(*chain.front());
  return loaded;
}

}  // namespace fovea::server
