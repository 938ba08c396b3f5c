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

Status Channel::Gather(size_t size, Deadline deadline) {
  if (consumed_ + size > capacity_) {
    const size_t waiting = received_ - consumed_;
    const size_t needed = std::max(size, kBufferBytes);
    if (needed > capacity_) {
      std::unique_ptr<char[]> larger(new char[needed]);
      std::copy_n(incoming_.get() + consumed_, waiting, larger.get());
      incoming_ = std::move(larger);
      capacity_ = needed;
    } else {
      std::memmove(incoming_.get(), incoming_.get() + consumed_, waiting);
    }
    consumed_ = 0;
    received_ = waiting;
  }
  while (received_ - consumed_ < size) {
    const ssize_t count =
        ::recv(socket_, incoming_.get() + received_, capacity_ - received_, MSG_DONTWAIT);
    if (count > 0) {
      received_ += static_cast<size_t>(count);
    } else if (count < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) {
      FOVEA_RETURN_IF_ERROR(Wait(POLLIN, deadline));
    } else if (count == 0 || errno != EINTR) {
      return Gone();
    }
  }
  return absl::OkStatus();
}

StatusOr<FrameView> Channel::Receive(Deadline deadline) {
  uint32_t header[2] = {0, 0};
  FOVEA_RETURN_IF_ERROR(Gather(sizeof(header), deadline));
  std::memcpy(header, incoming_.get() + consumed_, sizeof(header));
  const size_t size = header[1];
  if (size > kMaxPayloadBytes) {
    return Internal("malformed message: {} bytes announced, {} allowed", size, kMaxPayloadBytes);
  }
  FOVEA_RETURN_IF_ERROR(Gather(sizeof(header) + size, deadline));
  const std::string_view payload(incoming_.get() + consumed_ + sizeof(header), size);
  consumed_ += sizeof(header) + size;
  if (consumed_ == received_) {
    consumed_ = received_ = 0;  // the next recv may fill the whole buffer; the bytes stay
  }
  return FrameView{static_cast<FrameKind>(header[0]), payload};
}

}  // namespace fovea::ingest
