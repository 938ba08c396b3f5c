// Headers of dense voxels: NRRD, MetaImage, NumPy, sidecars. What a header says must be usable
// without a further look: sizes are positive and their product fits.

#include "ingest/worker/headers/dense_header.h"
#include "ingest/worker/headers/metaimage.h"
#include "ingest/worker/headers/npy.h"
#include "ingest/worker/headers/nrrd.h"
#include "ingest/worker/headers/sidecar.h"
#include "tests/fuzz/input.h"

namespace {

using namespace fovea;
using namespace fovea::ingest;

void Use(const StatusOr<DenseHeader>& header) {
  if (!header.ok() || !CheckDenseHeader(*header).ok()) {
    return;
  }
  fuzz::Require(header->Samples() > 0);
  const Int3 dims = header->Dims();
  fuzz::Require(dims.x > 0 && dims.y > 0 && dims.z > 0);
  fuzz::Require(header->Samples() % dims.Product() == 0);
  fuzz::Require(header->data_offset >= 0 && header->skip_lines >= 0);
  for (const AxisRole role : {AxisRole::kX, AxisRole::kStep, AxisRole::kChannel}) {
    fuzz::Require(header->SizeOf(role) > 0 && header->StrideOf(role) >= 0);
  }
  (void)header->IsInOrder();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  fuzz::Input input(data, size);
  const auto which = input.Number<uint8_t>();
  const std::string axes = which % 8 >= 4 ? "tzyx" : "";
  const std::string bytes = input.Rest();
  switch (which % 4) {
    case 0:
      Use(ParseNrrd(bytes));
      break;
    case 1:
      Use(ParseMetaImage(bytes));
      break;
    case 2:
      Use(ParseNpy(bytes, axes));
      break;
    default:
      (void)ParseSidecar(bytes).ok();
  }
  return 0;
}
