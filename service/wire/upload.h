#ifndef SERVICE_WIRE_UPLOAD_H_
#define SERVICE_WIRE_UPLOAD_H_

#include <cstdint>

#include "engine/base/status.h"
#include "fovea/v1/ingest.pb.h"
#include "service/wire/upload_spec.h"

/// Messages of uploaded steps to plain structs and back, checked: errors are INVALID_ARGUMENT and
/// point at the field. Thread-safe.
namespace fovea::wire {

/// Of one message of UploadStep, encoded; and the bytes of voxels that surely fit into one.
inline constexpr int64_t kMaxUploadMessageBytes = int64_t{512} << 10;
inline constexpr int64_t kUploadPieceBytes = kMaxUploadMessageBytes - 64;
/// Of the voxels of a step, all fields together.
inline constexpr int64_t kMaxUploadBytes = int64_t{1} << 40;

[[nodiscard]] int64_t BytesOf(UploadSpec::Type type);

[[nodiscard]] StatusOr<UploadSpec> FromProto(const v1::UploadHeader& proto);
[[nodiscard]] v1::UploadStepResponse ToProto(const UploadSpec& spec, const UploadAnswer& answer);

/// For clients.
[[nodiscard]] v1::UploadHeader ToProto(const UploadSpec& spec);
[[nodiscard]] UploadAnswer FromProto(const v1::UploadStepResponse& proto);

}  // namespace fovea::wire

#endif  // SERVICE_WIRE_UPLOAD_H_
