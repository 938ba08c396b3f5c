#include "service/server/admin_server.h"

#include <sys/socket.h>

#include <atomic>
#include <mutex>
#include <thread>
#include <utility>

#include <httplib.h>

#include "service/wire/host_port.h"

namespace fovea::server {
namespace {

constexpr size_t kThreads = 2;
constexpr int kTimeoutSeconds = 5;
constexpr size_t kMaxRequestBytes = 1024;
constexpr char kText[] = "text/plain; charset=utf-8";
constexpr char kMetricsText[] = "text/plain; version=0.0.4; charset=utf-8";

const char* NameOf(AdminServer::State state) {
  switch (state) {
    case AdminServer::State::kStarting:
      return "starting\n";
    case AdminServer::State::kReady:
      return "ready\n";
    case AdminServer::State::kDraining:
      return "draining\n";
  }
  return "";
}

class HttpAdminServer final : public AdminServer {
 public:
  HttpAdminServer() {
    // The library's default lets two programs share a port.
    http_.set_socket_options([](socket_t socket) {
      const int on = 1;
      setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &on, sizeof(on));
    });
    http_.new_task_queue = [] { return new httplib::ThreadPool(kThreads); };
    http_.set_keep_alive_max_count(1);  // a thread is not kept for who may come again
    http_.set_read_timeout(kTimeoutSeconds);
    http_.set_write_timeout(kTimeoutSeconds);
    http_.set_payload_max_length(kMaxRequestBytes);
    http_.Get("/livez", [](const httplib::Request&, httplib::Response& reply) {
      reply.set_content("alive\n", kText);
    });
    http_.Get("/readyz", [this](const httplib::Request&, httplib::Response& reply) {
      const State state = state_.load();
      reply.status = state == State::kReady ? 200 : 503;
      reply.set_content(NameOf(state), kText);
    });
    http_.Get("/metrics", [this](const httplib::Request&, httplib::Response& reply) {
      const std::lock_guard lock(mutex_);
      reply.status = metrics_ ? 200 : 503;
      reply.set_content(metrics_ ? metrics_() : std::string("starting\n"), kMetricsText);
    });
  }

  ~HttpAdminServer() override {
    if (thread_.joinable()) {
      http_.stop();
      thread_.join();
    }
  }

  [[nodiscard]] Status Listen(wire::HostPort address) {
    if (address.port == 0) {
      address.port = http_.bind_to_any_port(address.host);
    } else if (!http_.bind_to_port(address.host, address.port)) {
      address.port = -1;
    }
    if (address.port < 0) {
      return Unavailable(
          "--admin: cannot listen on {}: the port is taken, or the address is not "
          "this machine's; port 0 takes any free one",
          address.host);
    }
    address_ = address.ToString();
    thread_ = std::thread([this] { http_.listen_after_bind(); });
    while (!http_.is_running()) {  // stop() would do nothing before
      std::this_thread::yield();
    }
    return absl::OkStatus();
  }

  [[nodiscard]] const std::string& address() const override { return address_; }
  void SetState(State state) override { state_ = state; }
  void SetMetrics(std::function<std::string()> text) override {
    const std::lock_guard lock(mutex_);
    metrics_ = std::move(text);
  }

 private:
  httplib::Server http_;
  std::string address_;  // not changed after Listen
  std::atomic<State> state_ = State::kStarting;
  std::mutex mutex_;
  std::function<std::string()> metrics_;  // guarded by mutex_
  std::thread thread_;
};

}  // namespace

StatusOr<std::unique_ptr<AdminServer>> AdminServer::Start(const std::string& address,
                                                          bool any_address) {
  const auto parsed = wire::ParseHostPort(address);
  if (!parsed.ok()) {
    return InvalidArgument("--admin: {}", MessageOf(parsed.status()));
  }
  if (!parsed->loopback && !any_address) {
    return InvalidArgument(
        "--admin: {} can be reached from other machines, and the admin port asks nobody who they "
        "are: give a loopback address, or add --admin-any-address",
        address);
  }
  auto server = std::make_unique<HttpAdminServer>();
  FOVEA_RETURN_IF_ERROR(server->Listen(*parsed));
  return server;
}

}  // namespace fovea::server
