#ifndef SERVICE_WIRE_CONVERT_H_
#define SERVICE_WIRE_CONVERT_H_

#include <cstdint>
#include <string>
#include <string_view>

#include "engine/base/status.h"
#include "fovea/v1/datasets.pb.h"
#include "fovea/v1/render.pb.h"
#include "fovea/v1/types.pb.h"
#include "service/frames/plan.h"
#include "service/frames/spec.h"
#include "service/wire/dataset_summary.h"

/// Messages to the plain structs of the project and back. What comes from outside is checked on
/// the way: nothing that FromProto returns can surprise the engine. Thread-safe.
namespace fovea::wire {

/// The largest encoded frame, in bytes.
inline constexpr int64_t kMaxFrameBytes = int64_t{64} << 20;
/// Message limits of server and clients: a frame and what surrounds it, and a request.
inline constexpr int kMaxReplyMessageBytes = 65 << 20;
inline constexpr int kMaxRequestMessageBytes = 1 << 20;

/// Bytes of one pixel of a raw encoding; 0 for a compressed one.
[[nodiscard]] int64_t RawPixelBytes(frames::Encoding encoding);

[[nodiscard]] v1::Encoding ToProto(frames::Encoding encoding);
/// INVALID_ARGUMENT pointing at `path` for a number that is no encoding.
[[nodiscard]] StatusOr<frames::Encoding> EncodingFromProto(v1::Encoding proto,
                                                           std::string_view path);

/// `spec` must have passed frames::ValidateSpec. An orthographic view is sent whole or not at all:
/// of a view that is given in part, angles left out are 0.
[[nodiscard]] v1::FrameSpec ToProto(const frames::FrameSpec& spec);
/// INVALID_ARGUMENT pointing at the field below `path` ("spec", say) that is unknown, not finite,
/// or outside its range; also for raw frames of more than kMaxFrameBytes.
[[nodiscard]] StatusOr<frames::FrameSpec> FromProto(const v1::FrameSpec& proto,
                                                    std::string_view path);

[[nodiscard]] v1::Frame ToProto(frames::Frame frame);
/// For clients. INTERNAL if the size of the pixels is not what size and encoding say, or a value
/// is outside what the proto promises.
[[nodiscard]] StatusOr<frames::Frame> FromProto(v1::Frame proto);

[[nodiscard]] v1::FramePlan ToProto(const std::string& dataset, int64_t step,
                                    const frames::FramePlan& plan);
/// For clients: what was counted for the intermediate images is not sent. INTERNAL as above.
[[nodiscard]] StatusOr<frames::FramePlan> FromProto(const v1::FramePlan& proto);

[[nodiscard]] v1::Dataset ToProto(const DatasetSummary& summary);
/// For clients. INTERNAL as above.
[[nodiscard]] StatusOr<DatasetSummary> FromProto(const v1::Dataset& proto);

}  // namespace fovea::wire

#endif  // SERVICE_WIRE_CONVERT_H_
