#ifndef INGEST_WORKER_NIFTI_HEADER_H_
#define INGEST_WORKER_NIFTI_HEADER_H_

#include <string>

#include "engine/base/status.h"
#include "ingest/worker/headers/dense_header.h"

namespace fovea::ingest {

/// The header of a NIfTI-1, NIfTI-2 or Analyze 7.5 file (.nii, .hdr, also .gz), understood by
/// libnifti: orientation by sform, else qform, else spacing alone. Of two files the voxels are in
/// NAME.img (of NAME.hdr.gz: NAME.img.gz).
[[nodiscard]] StatusOr<DenseHeader> ReadNiftiHeader(const std::string& path);

}  // namespace fovea::ingest

#endif  // INGEST_WORKER_NIFTI_HEADER_H_
