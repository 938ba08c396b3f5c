#include "service/client/channel.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdlib>
#include <fstream>
#include <random>
#include <string_view>
#include <system_error>
#include <utility>

#include <grpc/support/log.h>
#include <grpcpp/create_channel.h>
#include <grpcpp/security/credentials.h>

#include "service/wire/convert.h"
#include "service/wire/host_port.h"
#include "service/wire/status.h"

namespace fovea::client {
namespace {

constexpr std::string_view kTlsHint =
    "if the server has TLS (--tls-cert), --tls-ca is needed here; if it asks for certificates "
    "(--tls-client-ca), --tls-cert and --tls-key, too, of an authority that it knows";
constexpr size_t kMaxFileBytes = size_t{4} << 20;  // an authority file can hold all of the web's

StatusOr<std::string> ReadFile(const char* flag, const std::string& path) {
  if (path.empty()) {
    return std::string();
  }
  std::ifstream file(path, std::ios::binary);
  if (!file) {
    return NotFound("{}: cannot read '{}': {}", flag, path, std::generic_category().message(errno));
  }
  std::string text(kMaxFileBytes, '\0');
  file.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<size_t>(file.gcount()));
  return text;
}

Status CheckTogether(const wire::HostPort& address, const Credentials& given) {
  if (given.cert_file.empty() != given.key_file.empty()) {
    return InvalidArgument("--tls-cert and --tls-key: a client's certificate needs both");
  }
  if (given.ca_file.empty() && !given.cert_file.empty()) {
    return InvalidArgument("--tls-cert: needs --tls-ca, by which the server is known");
  }
  if (given.ca_file.empty() && !given.token_file.empty() && !address.loopback) {
    return InvalidArgument(
        "--token-file: the token would cross the network to {} in plaintext; add --tls-ca "
        "(/etc/ssl/certs/ca-certificates.crt holds the public authorities)",
        address.ToString());
  }
  return absl::OkStatus();
}

/// gRPC's own lines on stderr say what the error says as well; they stay for those who ask for
/// them.
void KeepGrpcQuiet() {
  static const bool done = [] {
    if (std::getenv("GRPC_VERBOSITY") == nullptr && std::getenv("GRPC_TRACE") == nullptr) {
      gpr_set_log_function([](gpr_log_func_args*) {});
    }
    return true;
  }();
  static_cast<void>(done);
}

StatusOr<std::shared_ptr<grpc::ChannelCredentials>> MakeCredentials(const Credentials& given) {
  if (given.ca_file.empty()) {
    return grpc::InsecureChannelCredentials();
  }
  grpc::SslCredentialsOptions options;
  FOVEA_ASSIGN_OR_RETURN(options.pem_root_certs, ReadFile("--tls-ca", given.ca_file));
  FOVEA_ASSIGN_OR_RETURN(options.pem_cert_chain, ReadFile("--tls-cert", given.cert_file));
  FOVEA_ASSIGN_OR_RETURN(options.pem_private_key, ReadFile("--tls-key", given.key_file));
  if (options.pem_root_certs.find("-----BEGIN CERTIFICATE-----") == std::string::npos) {
    return InvalidArgument("--tls-ca: '{}' holds no certificate in PEM", given.ca_file);
  }
  return grpc::SslCredentials(options);
}

/// A channel, with TLS if `credentials` names an authority.
StatusOr<std::shared_ptr<grpc::Channel>> MakeChannel(const wire::HostPort& address,
                                                     const Credentials& credentials) {
  FOVEA_RETURN_IF_ERROR(CheckTogether(address, credentials));
  KeepGrpcQuiet();
  FOVEA_ASSIGN_OR_RETURN(const auto made, MakeCredentials(credentials));
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(wire::kMaxReplyMessageBytes);
  // Probing lets a slow reader's buffers grow, and frames age in them.
  arguments.SetInt(GRPC_ARG_HTTP2_BDP_PROBE, 0);
  // One connection a client; a proxy from the environment is for web pages.
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);
  return grpc::CreateCustomChannel(address.ToString(), made, arguments);
}

/// The value of `authorization`: "Bearer TOKEN"; empty without a token file.
StatusOr<std::string> ReadAuthorization(const Credentials& credentials) {
  if (credentials.token_file.empty()) {
    return std::string();
  }
  FOVEA_ASSIGN_OR_RETURN(std::string token, ReadFile("--token-file", credentials.token_file));
  token.erase(token.find_last_not_of(" \t\r\n") + 1);
  token.erase(0, token.find_first_not_of(" \t\r\n"));
  const bool printable =
      std::all_of(token.begin(), token.end(), [](char c) { return c > ' ' && c < 0x7F; });
  if (token.empty() || !printable || token.size() > 4096) {
    return InvalidArgument("--token-file: '{}' does not hold a token, alone on one line",
                           credentials.token_file);
  }
  return "Bearer " + token;
}

/// What to look at, by what gRPC says of a connection that did not come about; empty if nothing is
/// known.
std::string_view HintFor(std::string_view message) {
  constexpr std::array<std::array<std::string_view, 2>, 7> kHints = {{
      {"Connection refused", "`fovea serve ROOT` starts a server"},
      {"not in peer certificate",
       "--server: give a name that the server's certificate is for (--tls-cert of the server)"},
      {"certificate verify failed",
       "--tls-ca: it does not hold the authority of this server's certificate"},
      {"wrong version number", "--tls-ca: this server has no TLS; leave it out"},
      {"empty address list", "--tls-cert and --tls-key: are they PEM, and of each other?"},
      {"Socket closed", kTlsHint},
      {"SETTINGS", kTlsHint},
  }};
  for (const auto& [said, hint] : kHints) {
    if (message.find(said) != std::string_view::npos) {
      return hint;
    }
  }
  return {};
}

}  // namespace

std::string RandomId() {
  std::random_device random;
  return fmt::format("{:08x}{:08x}{:08x}{:08x}", random(), random(), random(), random());
}

StatusOr<Connection> OpenConnection(const std::string& address, const Credentials& credentials) {
  FOVEA_ASSIGN_OR_RETURN(const wire::HostPort parsed, wire::ParseHostPort(address));
  if (parsed.port == 0) {
    return InvalidArgument("server '{}': the port must be 1 to 65535", address);
  }
  FOVEA_ASSIGN_OR_RETURN(auto channel, MakeChannel(parsed, credentials));
  FOVEA_ASSIGN_OR_RETURN(std::string authorization, ReadAuthorization(credentials));
  return Connection{parsed.ToString(), std::move(channel), {RandomId(), std::move(authorization)}};
}

Status Explain(const std::string& address, const Status& status) {
  if (status.ok()) {
    return status;
  }
  std::string message =
      fmt::format("server {}: {}{}", address, MessageOf(status), wire::DescribeDetails(status));
  if (absl::IsUnavailable(status)) {
    const std::string_view hint = HintFor(MessageOf(status));
    message += hint.empty() ? "" : fmt::format("; {}", hint);
  }
  return wire::WithMessage(status, message);
}

}  // namespace fovea::client
