#include "ingest/channel.h"

#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <limits>

#include <poll.h>

namespace fovea::ingest {
namespace {

constexpr size_t kBufferBytes = 256U << 10;

int TimeoutMs(Channel::Deadline deadline) {
  if (deadline == Channel::kNoDeadline) {
    return -1;
  }
  const auto left =
      std::chrono::ceil<std::chrono::milliseconds>(deadline - std::chrono::steady_clock::now());
  return static_cast<int>(std::clamp<int64_t>(left.count(), 0, std::numeric_limits<int>::max()));
}

Status Gone() {
  return Unavailable("the other process is gone");
}

}  // namespace

Channel::~Channel() {
  ::close(socket_);
}

Status Channel::Wait(short events, Deadline deadline) const {
  while (true) {
    pollfd poll_entry{socket_, events, 0};
    const int ready = ::poll(&poll_entry, 1, TimeoutMs(deadline));
    if (ready > 0) {
      return absl::OkStatus();
    }
    if (ready == 0) {
      return DeadlineExceeded("no answer in time");
    }
    if (errno != EINTR) {
      return Internal("poll: {}", std::strerror(errno));
    }
  }
}

Status Channel::Send(const Frame& frame, Deadline deadline) {
  const auto kind = static_cast<uint32_t>(frame.kind);
  const auto size = static_cast<uint32_t>(frame.payload.size());
  if (frame.payload.size() > kMaxPayloadBytes) {
    return Internal("a message of {} bytes is too long", frame.payload.size());
  }
  outgoing_.append(reinterpret_cast<const char*>(&kind), sizeof(kind));
  outgoing_.append(reinterpret_cast<const char*>(&size), sizeof(size));
  outgoing_.append(frame.payload);
  return outgoing_.size() >= kBufferBytes ? Flush(deadline) : absl::OkStatus();
}

Status Channel::Flush(Deadline deadline) {
  size_t sent = 0;
  while (sent < outgoing_.size()) {
    const ssize_t count = ::send(socket_, outgoing_.data() + sent, outgoing_.size() - sent,
                                 MSG_NOSIGNAL | MSG_DONTWAIT);
    if (count >= 0) {
      sent += static_cast<size_t>(count);
    } else if (errno == EAGAIN || errno == EWOULDBLOCK) {
      FOVEA_RETURN_IF_ERROR(Wait(POLLOUT, deadline));
    } else if (errno != EINTR) {
      return Gone();
    }
  }
  outgoing_.clear();
  return absl::OkStatus();
}

Status Channel::ReadExactly(char* data, size_t size, Deadline deadline) {
  while (size > 0) {
    if (consumed_ < incoming_.size()) {
      const size_t count = std::min(size, incoming_.size() - consumed_);
      std::memcpy(data, incoming_.data() + consumed_, count);
      consumed_ += count;
      data += count;
      size -= count;
      continue;
    }
    FOVEA_RETURN_IF_ERROR(Wait(POLLIN, deadline));
    incoming_.resize(kBufferBytes);
    consumed_ = 0;
    const ssize_t count = ::recv(socket_, incoming_.data(), incoming_.size(), MSG_DONTWAIT);
    incoming_.resize(count > 0 ? static_cast<size_t>(count) : 0);
    if (count == 0 || (count < 0 && errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR)) {
      return Gone();
    }
  }
  return absl::OkStatus();
}

StatusOr<Frame> Channel::Receive(Deadline deadline) {
  uint32_t header[2] = {0, 0};
  FOVEA_RETURN_IF_ERROR(ReadExactly(reinterpret_cast<char*>(header), sizeof(header), deadline));
  if (header[1] > kMaxPayloadBytes) {
    return Internal("malformed message: {} bytes announced, {} allowed", header[1],
                    kMaxPayloadBytes);
  }
  Frame frame{static_cast<FrameKind>(header[0]), std::string(header[1], '\0')};
  FOVEA_RETURN_IF_ERROR(ReadExactly(frame.payload.data(), frame.payload.size(), deadline));
  return frame;
}

}  // namespace fovea::ingest
