#ifndef SERVICE_SERVER_DESCRIPTOR_H_
#define SERVICE_SERVER_DESCRIPTOR_H_

#include <unistd.h>

#include <utility>

namespace fovea::server {

/// A file descriptor, closed when this goes. Movable; -1 stands for none. Not thread-safe.
class Descriptor {
 public:
  Descriptor() = default;
  explicit Descriptor(int fd) : fd_(fd) {}
  Descriptor(Descriptor&& other) noexcept : fd_(other.Release()) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  ~Descriptor() { Close(); }

  [[nodiscard]] int get() const { return fd_; }
  [[nodiscard]] bool valid() const { return fd_ >= 0; }
  /// Gives it to the caller, who closes it.
  [[nodiscard]] int Release() { return std::exchange(fd_, -1); }
  void Close() {
    if (valid()) {
      ::close(Release());
    }
  }

 private:
  int fd_ = -1;
};

}  // namespace fovea::server

#endif  // SERVICE_SERVER_DESCRIPTOR_H_
