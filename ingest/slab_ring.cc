#include "ingest/slab_ring.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

namespace fovea::ingest {
namespace {

constexpr size_t kBytes = kSlabs * kSlabBytes;
constexpr int kLeastDescriptor = 10;

StatusOr<std::byte*> Map(int descriptor, int protection) {
  void* memory = ::mmap(nullptr, kBytes, protection, MAP_SHARED, descriptor, 0);
  if (memory == MAP_FAILED) {
    return ResourceExhausted("cannot map {} bytes of shared memory: {}", kBytes,
                             std::strerror(errno));
  }
  return static_cast<std::byte*>(memory);
}

}  // namespace

StatusOr<std::unique_ptr<SlabRing>> SlabRing::Make() {
  const int made = ::memfd_create("fovea-slabs", MFD_CLOEXEC | MFD_ALLOW_SEALING);
  // Away from the numbers that a worker's own descriptors get.
  const int descriptor = made < 0 ? made : ::fcntl(made, F_DUPFD_CLOEXEC, kLeastDescriptor);
  if (made >= 0) {
    ::close(made);
  }
  // Sealed before anybody else has it: a file that shrinks kills whoever reads its mapping.
  if (descriptor < 0 || ::ftruncate(descriptor, kBytes) != 0 ||
      ::fcntl(descriptor, F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_SEAL) != 0) {
    const Status failed = ResourceExhausted("cannot make shared memory: {}", std::strerror(errno));
    if (descriptor >= 0) {
      ::close(descriptor);
    }
    return failed;
  }
  const StatusOr<std::byte*> memory = Map(descriptor, PROT_READ);
  if (!memory.ok()) {
    ::close(descriptor);
    return memory.status();
  }
  return std::unique_ptr<SlabRing>(new SlabRing(descriptor, *memory));
}

StatusOr<std::unique_ptr<SlabRing>> SlabRing::Adopt() {
  const StatusOr<std::byte*> memory = Map(kSlabDescriptor, PROT_READ | PROT_WRITE);
  ::close(kSlabDescriptor);
  FOVEA_RETURN_IF_ERROR(memory.status());
  return std::unique_ptr<SlabRing>(new SlabRing(-1, *memory));
}

SlabRing::~SlabRing() {
  CloseDescriptor();
  ::munmap(memory_, kBytes);
}

void SlabRing::CloseDescriptor() {
  if (descriptor_ >= 0) {
    ::close(descriptor_);
    descriptor_ = -1;
  }
}

}  // namespace fovea::ingest
