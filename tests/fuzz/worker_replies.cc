// What a worker may answer, down the road that ingest takes: bytes on the socket, the channel, the
// decoders, the assembler.

#include <sys/socket.h>
#include <unistd.h>

#include <memory>

#include "ingest/channel.h"
#include "ingest/dense_field.h"
#include "ingest/protocol.h"
#include "ingest/step_assembler.h"
#include "tests/fuzz/input.h"

namespace {

using namespace fovea;
using namespace fovea::ingest;

void DecodeAll(const FrameView& frame) {
  (void)DecodeFileInfo(frame).ok();
  (void)DecodeGridInfo(frame).ok();
  (void)DecodeFieldStart(frame).ok();
  (void)DecodeFieldEnd(frame).ok();
  (void)DecodeTile(frame).ok();
  (void)DecodeHello(frame).ok();
  fuzz::Require(!DecodeError(frame).ok());
}

/// The road of dense fields; the shared memory holds whatever it held before.
void TakeAsDense(const FrameView& frame, DenseField* dense) {
  static SlabRing* const slabs = SlabRing::Make()->release();
  (void)dense
      ->Consume(frame, slabs,
                [](const DenseSlices& slices) {
                  fuzz::Require(slices.count > 0 && slices.bytes > 0);
                  return absl::OkStatus();
                })
      .ok();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  constexpr size_t kMostBytes = 64 << 10;  // fits the buffer of the socket: nobody waits
  constexpr int64_t kMemoryBytes = 4 << 20;
  if (size > kMostBytes) {
    return 0;
  }
  int sockets[2];
  fuzz::Require(::socketpair(AF_UNIX, SOCK_STREAM, 0, sockets) == 0);
  fuzz::Require(::send(sockets[1], data, size, MSG_NOSIGNAL) == static_cast<ssize_t>(size));
  ::close(sockets[1]);
  Channel channel(sockets[0]);
  const Box3 extent{{-5, -3, 0}, {30, 40, 50}};
  StepAssembler assembler(extent, 16, 2, kMemoryBytes);
  DenseField dense(extent, 4, kMemoryBytes);
  Status status;
  bool is_dense = false;
  while (status.ok()) {
    const auto frame = channel.Receive(Channel::kNoDeadline);
    if (!frame.ok()) {
      break;
    }
    DecodeAll(*frame);
    is_dense = is_dense || frame->kind == FrameKind::kDense;
    if (is_dense) {
      TakeAsDense(*frame, &dense);
      continue;
    }
    status = assembler.Consume(*frame);
    fuzz::Require(assembler.bytes_left() >= 0);
  }
  (void)dense.Finish().ok();
  const auto fields = assembler.Finish();
  if (fields.ok()) {
    for (const FieldVoxels& field : *fields) {
      for (const auto& [at, brick] : field.voxels.bricks()) {
        for (const float value : brick) {
          fuzz::Require(value == value);
        }
      }
    }
  }
  return 0;
}
