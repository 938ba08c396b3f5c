// Headers of NIfTI and Analyze files, plain or packed. libnifti understands them; what we make of
// that must be usable without a further look.

#include <sys/mman.h>
#include <unistd.h>

#include "ingest/worker/nifti_header.h"
#include "tests/fuzz/input.h"

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace fovea;
  const int file = ::memfd_create("nifti", MFD_CLOEXEC);
  fuzz::Require(file >= 0 && ::write(file, data, size) == static_cast<ssize_t>(size));
  const auto header = ingest::ReadNiftiHeader("/proc/self/fd/" + std::to_string(file));
  ::close(file);
  if (!header.ok()) {
    return 0;
  }
  const Int3 dims = header->Dims();
  fuzz::Require(dims.x > 0 && dims.y > 0 && dims.z > 0 && header->Samples() > 0);
  fuzz::Require(header->Samples() % dims.Product() == 0);
  fuzz::Require(header->data_offset >= 0 && header->skip_bytes >= 0);
  return 0;
}
