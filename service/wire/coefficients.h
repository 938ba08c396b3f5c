#ifndef SERVICE_WIRE_COEFFICIENTS_H_
#define SERVICE_WIRE_COEFFICIENTS_H_

#include "engine/base/status.h"
#include "fovea/v1/coefficients.pb.h"
#include "service/wire/coefficient_messages.h"

/// The messages of fovea.v1.Coefficients to plain structs and back. Thread-safe.
namespace fovea::wire {

[[nodiscard]] v1::StreamCoefficientsRequest ToProto(const CoefficientsRequest& request);
/// INVALID_ARGUMENT pointing at the field for what can be told without the dataset.
[[nodiscard]] StatusOr<CoefficientsRequest> FromProto(const v1::StreamCoefficientsRequest& proto);

[[nodiscard]] v1::CoefficientBlock ToProto(CoefficientsMessage message);
/// For clients. INTERNAL if a value is outside what the proto promises; the block itself is not
/// looked at.
[[nodiscard]] StatusOr<CoefficientsMessage> FromProto(v1::CoefficientBlock proto);

}  // namespace fovea::wire

#endif  // SERVICE_WIRE_COEFFICIENTS_H_
