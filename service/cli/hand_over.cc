// HandOver of fovea, and what it has in place of a gRPC client.
#include "service/cli/become.h"
#include "service/client/views_client.h"
#include "service/export/frame_provider.h"

namespace fovea {
namespace cli {
namespace {

template <typename T>
bool AsksServer(const T& command) {
  if constexpr (requires { command.server; }) {
    return command.server.has_value();
  } else if constexpr (requires { command.input.server; }) {
    return command.input.server.has_value();
  } else {
    return false;
  }
}

}  // namespace

Status HandOver(const Command& command, const std::vector<std::string>& arguments) {
  const bool asks = std::visit([](const auto& it) { return AsksServer(it); }, command);
  return asks ? Become("fovea-remote", arguments) : absl::OkStatus();
}

}  // namespace cli

namespace {

Status HandedOver() {
  return Internal("fovea asks no server: fovea-remote does");
}

}  // namespace

StatusOr<std::unique_ptr<client::Client>> client::Client::Connect(
    const std::string& /*address*/, const Credentials& /*credentials*/,
    double /*deadline_seconds*/) {
  return HandedOver();
}

StatusOr<std::unique_ptr<client::JobsClient>> client::JobsClient::Connect(
    const std::string& /*address*/, const Credentials& /*credentials*/,
    double /*deadline_seconds*/) {
  return HandedOver();
}

StatusOr<std::unique_ptr<client::ViewsClient>> client::ViewsClient::Connect(
    const std::string& /*address*/, const Credentials& /*credentials*/,
    double /*deadline_seconds*/) {
  return HandedOver();
}

StatusOr<std::unique_ptr<exports::FrameProvider>> exports::OpenRemote(
    const std::string& /*address*/, const client::Credentials& /*credentials*/,
    const std::string& /*dataset*/, Transport /*transport*/, int /*threads*/) {
  return HandedOver();
}

}  // namespace fovea
