#include "ingest/file_arrivals.h"

#include <sys/inotify.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <filesystem>
#include <system_error>
#include <utility>

#include <poll.h>

namespace fovea::ingest {

namespace fs = std::filesystem;

namespace {
constexpr int kQuietLooks = 10;
}  // namespace

FileArrivals::FileArrivals(std::string folder, NamePattern pattern)
    : folder_(std::move(folder)), pattern_(std::move(pattern)) {
  inotify_ = ::inotify_init1(IN_NONBLOCK | IN_CLOEXEC);
  if (inotify_ >= 0 &&
      ::inotify_add_watch(inotify_, folder_.c_str(), IN_CLOSE_WRITE | IN_MOVED_TO) < 0) {
    ::close(std::exchange(inotify_, -1));
  }
}

FileArrivals::~FileArrivals() {
  if (inotify_ >= 0) {
    ::close(inotify_);
  }
}

Status FileArrivals::Wait(double seconds, bool look) {
  pollfd events{inotify_, POLLIN, 0};  // with -1 only the time passes
  if (::poll(&events, 1, static_cast<int>(1000 * seconds)) > 0) {
    ReadEvents();
  }
  return look ? Look() : absl::OkStatus();
}

/// Lost events (a full queue) do no harm: looking finds what they told of.
void FileArrivals::ReadEvents() {
  alignas(inotify_event) std::array<char, 16384> bytes{};
  ssize_t size = 0;
  while ((size = ::read(inotify_, bytes.data(), bytes.size())) > 0) {
    for (ssize_t at = 0; at < size;) {
      inotify_event event{};
      std::memcpy(&event, bytes.data() + at, sizeof(event));
      if (event.len > 0) {
        Finish(bytes.data() + at + sizeof(event));  // ends with a zero
      }
      at += static_cast<ssize_t>(sizeof(event) + event.len);
    }
  }
}

void FileArrivals::Finish(const std::string& name) {
  struct stat info {};
  const std::optional<int64_t> number = pattern_.Match(name);
  if (number && ::stat((folder_ + "/" + name).c_str(), &info) == 0 && S_ISREG(info.st_mode) &&
      info.st_size > 0) {
    finished_.emplace(*number, name);
    seen_.erase(name);
  }
}

Status FileArrivals::Look() {
  std::error_code error;
  std::map<std::string, Seen> now;
  for (fs::directory_iterator entry(folder_, error), end; !error && entry != end;
       entry.increment(error)) {
    const std::string name = entry->path().filename().string();
    const std::optional<int64_t> number = pattern_.Match(name);
    struct stat info {};
    if (!number || finished_.contains(*number) || ::stat(entry->path().c_str(), &info) != 0 ||
        !S_ISREG(info.st_mode)) {
      continue;
    }
    Seen seen{info.st_size, info.st_mtim.tv_sec * 1'000'000'000 + info.st_mtim.tv_nsec,
              is_told() && has_looked_ ? kQuietLooks : 1};
    const auto before = seen_.find(name);
    if (before != seen_.end() && before->second.bytes == seen.bytes &&
        before->second.changed_ns == seen.changed_ns) {
      seen.quiet_looks_wanted = before->second.quiet_looks_wanted - 1;
    }
    if (seen.bytes > 0 && seen.quiet_looks_wanted == 0) {
      finished_.emplace(*number, name);
    } else {
      seen.quiet_looks_wanted = std::max(seen.quiet_looks_wanted, 1);
      now[name] = seen;
    }
  }
  if (error) {
    return NotFound("cannot list folder '{}': {}", folder_, error.message());
  }
  seen_ = std::move(now);
  has_looked_ = true;
  return absl::OkStatus();
}

}  // namespace fovea::ingest
