#ifndef SERVICE_WIRE_SPEC_PARTS_H_
#define SERVICE_WIRE_SPEC_PARTS_H_

#include <initializer_list>
#include <optional>
#include <string>
#include <string_view>

#include "engine/base/status.h"
#include "fovea/v1/types.pb.h"
#include "service/frames/spec.h"

/// Parts of a FrameSpec, for convert.h's conversions. Errors are INVALID_ARGUMENT and point at the
/// field below `path`.
namespace fovea::wire {

[[nodiscard]] Status CheckFinite(const std::string& path, std::initializer_list<double> values);
/// `known`: the values there are.
[[nodiscard]] Status UnknownEnum(const std::string& path, int value, std::string_view known);

[[nodiscard]] v1::TransferFunction ToProto(const render::TransferFunction& transfer);
[[nodiscard]] StatusOr<render::TransferFunction> FromProto(const v1::TransferFunction& proto,
                                                           const std::string& path);

/// What shades, cuts and colours: compositing, lighting, clip, color_field and its transfer
/// function, mode.
void OptionsToProto(const frames::FrameSpec& spec, v1::FrameSpec* proto);
[[nodiscard]] Status OptionsFromProto(const v1::FrameSpec& proto, const std::string& path,
                                      frames::FrameSpec* spec);

}  // namespace fovea::wire

#endif  // SERVICE_WIRE_SPEC_PARTS_H_
