#include "service/server/acceptor.h"

#include <fcntl.h>
#include <sys/eventfd.h>
#include <sys/resource.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <limits>
#include <memory>
#include <utility>

#include <poll.h>
#include <spdlog/spdlog.h>

namespace fovea::server {
namespace {

constexpr int kRetryMs = 50;  // until the spare descriptor is asked for again
constexpr int kMaxPerRound = 64;
constexpr auto kLogInterval = std::chrono::seconds(10);

Descriptor OpenSpare() {
  return Descriptor(open("/dev/null", O_RDONLY | O_CLOEXEC));
}

}  // namespace

StatusOr<std::unique_ptr<Acceptor>> Acceptor::Start(std::vector<Descriptor> listeners,
                                                    ConnectionTable::Limits limits,
                                                    OnConnection on_connection) {
  std::unique_ptr<Acceptor> acceptor(
      new Acceptor(std::move(listeners), limits, std::move(on_connection)));
  if (!acceptor->wake_.valid() || !acceptor->spare_.valid()) {
    return ResourceExhausted(
        "no file descriptors are left to accept connections with; raise the limit (ulimit -n)");
  }
  acceptor->thread_ = std::thread([acceptor = acceptor.get()] { acceptor->Run(); });
  return acceptor;
}

Acceptor::Acceptor(std::vector<Descriptor> listeners, ConnectionTable::Limits limits,
                   OnConnection on_connection)
    : listeners_(std::move(listeners)),
      on_connection_(std::move(on_connection)),
      wake_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)),
      table_(limits),
      spare_(OpenSpare()),
      logged_at_(std::chrono::steady_clock::now() - kLogInterval) {}

Acceptor::~Acceptor() {
  if (thread_.joinable()) {
    eventfd_write(wake_.get(), 1);
    thread_.join();
  }
}

Acceptor::Counts Acceptor::counts() const {
  return {accepted_.load(), over_total_.load(), over_address_.load(), out_of_descriptors_.load()};
}

void Acceptor::Run() {
  std::vector<pollfd> polled = {{wake_.get(), POLLIN, 0}};
  for (const Descriptor& listener : listeners_) {
    polled.push_back({listener.get(), POLLIN, 0});
  }
  while (true) {
    // Without a spare nothing may be accepted: there would be no way to say no.
    const bool ready = spare_.valid();
    poll(polled.data(), ready ? polled.size() : 1, ready ? -1 : kRetryMs);
    if (polled[0].revents != 0) {
      return;
    }
    if (!ready) {
      spare_ = OpenSpare();
      continue;
    }
    for (size_t i = 1; i < polled.size(); ++i) {
      if (polled[i].revents != 0) {
        AcceptAll(polled[i].fd);
      }
    }
    LogTurnedAway();
  }
}

void Acceptor::AcceptAll(int listener) {
  for (int i = 0; i < kMaxPerRound; ++i) {
    sockaddr_storage peer{};
    socklen_t size = sizeof(peer);
    // Non-blocking, for gRPC takes a socket as it comes: its TLS handshakes hung on blocking ones.
    const int fd =
        accept4(listener, reinterpret_cast<sockaddr*>(&peer), &size, SOCK_NONBLOCK | SOCK_CLOEXEC);
    if (fd >= 0) {
      Take(listener, fd, peer);
    } else if (errno == EMFILE || errno == ENFILE) {
      if (!Shed(listener)) {
        return;
      }
    } else if (errno == EAGAIN || errno == EWOULDBLOCK) {
      return;
    } else if (errno == ENOBUFS || errno == ENOMEM) {
      spdlog::warn("connections cannot be accepted for want of memory");
      spare_.Close();  // waits a moment
      return;
    }
    // Else the client of this one is gone already.
  }
}

int Acceptor::CountOpen() {
  const std::lock_guard lock(table_mutex_);
  return table_.CountOpen();
}

void Acceptor::Take(int listener, int fd, const sockaddr_storage& peer) {
  const auto verdict = [&] {
    const std::lock_guard lock(table_mutex_);
    return table_.Add(fd, peer);
  }();
  switch (verdict) {
    case ConnectionTable::Verdict::kAdmitted:
      ++accepted_;
      on_connection_(listener, fd);
      return;
    case ConnectionTable::Verdict::kOverTotal:
      ++over_total_;
      break;
    case ConnectionTable::Verdict::kOverAddress:
      ++over_address_;
      break;
  }
  close(fd);
}

bool Acceptor::Shed(int listener) {
  spare_.Close();
  const int fd = accept4(listener, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
  if (fd >= 0) {
    ++out_of_descriptors_;
    close(fd);
  }
  spare_ = OpenSpare();
  return fd >= 0 && spare_.valid();
}

void Acceptor::LogTurnedAway() {
  const Counts now = counts();
  const uint64_t limited =
      now.over_total - logged_.over_total + now.over_address - logged_.over_address;
  const uint64_t starved = now.out_of_descriptors - logged_.out_of_descriptors;
  const auto time = std::chrono::steady_clock::now();
  if (limited + starved == 0 || time - logged_at_ < kLogInterval) {
    return;
  }
  if (limited > 0) {
    spdlog::warn(
        "{} connections closed at once: {} over --max-connections, {} over "
        "--max-connections-per-address",
        limited, now.over_total - logged_.over_total, now.over_address - logged_.over_address);
  }
  if (starved > 0) {
    spdlog::warn(
        "{} connections closed at once: no file descriptor is free; raise the limit (ulimit -n) "
        "or lower --max-connections",
        starved);
  }
  logged_ = now;
  logged_at_ = time;
}

int64_t RaiseDescriptorLimit() {
  rlimit limit{};
  if (getrlimit(RLIMIT_NOFILE, &limit) != 0) {
    return 0;
  }
  const rlimit raised{limit.rlim_max, limit.rlim_max};
  if (setrlimit(RLIMIT_NOFILE, &raised) == 0) {
    limit = raised;
  }
  return static_cast<int64_t>(
      std::min<rlim_t>(limit.rlim_cur, static_cast<rlim_t>(std::numeric_limits<int64_t>::max())));
}

}  // namespace fovea::server
