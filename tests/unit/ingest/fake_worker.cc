// Stands in for fovea-worker in tests: speaks the protocol, and does what the scanned path says.

#include <sys/resource.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <string>
#include <thread>

#include "ingest/channel.h"
#include "ingest/protocol.h"
#include "ingest/slab_ring.h"

namespace {

using fovea::ingest::Channel;
using fovea::ingest::Frame;
using fovea::ingest::FrameKind;

void Send(Channel* channel, const Frame& frame) {
  if (!channel->Send(frame, Channel::kNoDeadline).ok() ||
      !channel->Flush(Channel::kNoDeadline).ok()) {
    std::exit(1);
  }
}

void Behave(const std::string& path, Channel* channel) {
  if (path == "crash") {
    const rlimit none{0, 0};
    ::setrlimit(RLIMIT_CORE, &none);
    std::abort();
  }
  if (path == "killed") {
    ::raise(SIGKILL);
  }
  if (path == "works") {
    ::raise(SIGXCPU);
  }
  if (path == "exits") {
    std::exit(3);
  }
  if (path == "hangs") {
    ::pause();
  }
  if (path == "closes") {  // and lives on
    ::close(STDIN_FILENO);
    ::pause();
  }
  if (path == "chatters") {
    while (true) {
      Send(channel, Encode(fovea::ingest::FileInfo{1, "m"}));
    }
  }
  if (path.starts_with("slabs")) {
    Send(channel, Encode(fovea::ingest::DenseStart{0, {}, {{0, 0, 0}, {8, 8, 1000000}}}));
    if (path == "slabs beyond") {
      Send(channel, Encode(fovea::ingest::SlabRows{fovea::ingest::kSlabs, 1}));
    }
    for (uint32_t i = 0; i < 3 || path == "slabs forever"; ++i) {  // never reads what is free
      Send(channel, Encode(fovea::ingest::SlabRows{i % fovea::ingest::kSlabs, 1}));
    }
    ::raise(SIGKILL);  // which no sanitizer catches
  }
  if (path == "nonsense") {
    Send(channel, {static_cast<FrameKind>(99), "x"});
  }
  if (path == "error") {
    Send(channel, fovea::ingest::EncodeError(fovea::NotFound("what was \x1B[1m asked for")));
    return;
  }
  Send(channel, Encode(fovea::ingest::FileInfo{7, "m"}));
  Send(channel, {FrameKind::kEnd, ""});
}

}  // namespace

int main() {
  Channel channel(STDIN_FILENO);
  while (true) {  // the list of files
    const auto frame = channel.Receive(Channel::kNoDeadline);
    if (!frame.ok()) {
      return 0;
    }
    if (frame->kind == FrameKind::kBegin) {
      break;
    }
  }
  Send(&channel, Encode(fovea::ingest::Hello{}));
  while (true) {
    const auto request = channel.Receive(Channel::kNoDeadline);
    if (!request.ok()) {
      return 0;
    }
    const auto scan = DecodeScanRequest(*request);
    Behave(scan.ok() ? scan->paths.front() : "", &channel);
  }
}
