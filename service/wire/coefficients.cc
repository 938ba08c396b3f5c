#include "service/wire/coefficients.h"

#include <cmath>
#include <limits>
#include <string_view>
#include <utility>

#include "engine/volume/hierarchy.h"
#include "service/coefficients/plan.h"
#include "service/frames/frames.h"
#include "service/wire/convert.h"
#include "service/wire/requests.h"
#include "service/wire/status.h"

namespace fovea::wire {
namespace {

constexpr size_t kMaxTokenBytes = 64;

v1::Vec3 Vec3ToProto(double x, double y, double z) {
  v1::Vec3 proto;
  proto.set_x(x);
  proto.set_y(y);
  proto.set_z(z);
  return proto;
}

bool IsRate(const v1::Vec3& proto) {
  const auto in_range = [](double rate) { return rate >= 1 && rate <= kMaxDimension; };
  return in_range(proto.x()) && in_range(proto.y()) && in_range(proto.z());
}

Rate RateOf(const v1::Vec3& proto) {
  return {proto.x(), proto.y(), proto.z()};
}

StatusOr<HeldCoefficients> HeldFromProto(const v1::HeldCoefficients& proto,
                                         const std::string& path) {
  HeldCoefficients held;
  const v1::Vec3& fovea = proto.fovea();
  if (!std::isfinite(fovea.x()) || !std::isfinite(fovea.y()) || !std::isfinite(fovea.z())) {
    return BadField(path + ".fovea", "must be three finite numbers");
  }
  if (!IsRate(proto.rate_xyz())) {
    return BadField(path + ".rate_xyz",
                    fmt::format("{},{},{} is outside its range: each 1 to {}", proto.rate_xyz().x(),
                                proto.rate_xyz().y(), proto.rate_xyz().z(), kMaxDimension));
  }
  if (proto.content().empty() ||
      proto.content_size() > static_cast<int>(coefficients::kMaxFields)) {
    return BadField(path + ".content", "must be one number for each field of the request");
  }
  held.step = proto.step();
  held.fovea = {{fovea.x(), fovea.y(), fovea.z()}, RateOf(proto.rate_xyz()), WindowShape::kCube};
  held.content.assign(proto.content().begin(), proto.content().end());
  return held;
}

v1::Warning WarningToProto(frames::Warning warning) {
  v1::Warning proto;
  proto.set_code(warning.code == frames::Warning::Code::kNotRetained ? v1::Warning::NOT_RETAINED
                                                                     : v1::Warning::DATA_LOSS);
  proto.set_message(std::move(warning.message));
  proto.set_count(warning.count);
  return proto;
}

v1::CoefficientSet SummaryToProto(const CoefficientsSummary& set) {
  v1::CoefficientSet proto;
  *proto.mutable_dataset() = ToProto(set.dataset);
  proto.set_step(static_cast<uint64_t>(set.step));
  proto.set_time_ns(set.time_ns);
  if (set.frame_number) {
    proto.set_frame_number(*set.frame_number);
  }
  *proto.mutable_used() = ToProto(set.used);
  for (const CoefficientsSummary::Field& field : set.fields) {
    v1::CoefficientSet::Field& out = *proto.add_fields();
    out.set_name(field.name);
    out.set_reversible(field.reversible);
    out.set_content(field.content);
  }
  proto.set_blocks(set.blocks);
  proto.set_coefficients(set.coefficients);
  return proto;
}

/// Whether a client can render with it: all that frames::ResolveSpec fills in is there.
Status CheckResolved(const CoefficientsSummary& set) {
  const frames::FrameSpec& used = set.used;
  const bool view = used.view.perspective
                        ? used.view.perspective->target.has_value() &&
                              used.view.perspective->fov_y_deg.has_value()
                        : used.view.azimuth_deg.has_value() &&
                              used.view.elevation_deg.has_value() && used.view.center.has_value();
  if (!used.field || !view || !used.fovea || !used.rate || !used.transfer || !used.weighting ||
      !used.smoothing || !used.width_px || !used.height_px || !used.jpeg_quality ||
      !used.background || used.color_transfer.has_value() != used.color_field.has_value()) {
    return Internal("a set of coefficients whose spec is not filled in");
  }
  const size_t fields = used.color_field && *used.color_field != *used.field ? 2 : 1;
  if (set.fields.size() != fields || set.fields.front().name != *used.field ||
      set.fields.back().name != used.color_field.value_or(*used.field)) {
    return Internal("a set of coefficients of {} fields, which are not those of its spec",
                    set.fields.size());
  }
  return absl::OkStatus();
}

StatusOr<CoefficientsSummary> SummaryFromProto(const v1::CoefficientSet& proto) {
  CoefficientsSummary set;
  FOVEA_ASSIGN_OR_RETURN(set.dataset, FromProto(proto.dataset()));
  auto used = FromProto(proto.used(), "used");
  if (!used.ok()) {
    return Internal("coefficients that this client does not understand: {}",
                    MessageOf(used.status()));
  }
  set.used = *std::move(used);
  if (proto.step() > static_cast<uint64_t>(std::numeric_limits<int64_t>::max())) {
    return Internal("coefficients of step {}", proto.step());
  }
  set.step = static_cast<int64_t>(proto.step());
  set.time_ns = proto.time_ns();
  if (proto.has_frame_number()) {
    set.frame_number = proto.frame_number();
  }
  for (const v1::CoefficientSet::Field& field : proto.fields()) {
    set.fields.push_back({field.name(), field.reversible(), field.content()});
  }
  set.blocks = proto.blocks();
  set.coefficients = proto.coefficients();
  FOVEA_RETURN_IF_ERROR(CheckResolved(set));
  return set;
}

}  // namespace

v1::StreamCoefficientsRequest ToProto(const CoefficientsRequest& request) {
  v1::StreamCoefficientsRequest proto;
  proto.set_dataset(request.dataset);
  if (request.time_ns) {
    proto.set_time_ns(*request.time_ns);
  } else {
    proto.set_step(request.step);
  }
  *proto.mutable_spec() = ToProto(request.spec);
  for (const HeldCoefficients& held : request.held) {
    v1::HeldCoefficients& out = *proto.add_held();
    out.set_step(held.step);
    *out.mutable_fovea() = Vec3ToProto(held.fovea.at.x, held.fovea.at.y, held.fovea.at.z);
    *out.mutable_rate_xyz() = Vec3ToProto(held.fovea.rate.x, held.fovea.rate.y, held.fovea.rate.z);
    out.mutable_content()->Add(held.content.begin(), held.content.end());
  }
  proto.set_resume_token(request.resume_token);
  return proto;
}

StatusOr<CoefficientsRequest> FromProto(const v1::StreamCoefficientsRequest& proto) {
  FOVEA_RETURN_IF_ERROR(CheckDatasetName(proto.dataset()));
  CoefficientsRequest request;
  request.dataset = proto.dataset();
  request.step = proto.step();
  if (proto.has_time_ns()) {
    request.time_ns = proto.time_ns();
  }
  FOVEA_ASSIGN_OR_RETURN(request.spec, FromProto(proto.spec(), "spec"));
  if (proto.held_size() > static_cast<int>(coefficients::kMaxHeld)) {
    return BadField("held", fmt::format("{} of them, at most {} may be told", proto.held_size(),
                                        coefficients::kMaxHeld));
  }
  for (int i = 0; i < proto.held_size(); ++i) {
    FOVEA_ASSIGN_OR_RETURN(request.held.emplace_back(),
                           HeldFromProto(proto.held(i), fmt::format("held[{}]", i)));
  }
  if (proto.resume_token().size() > kMaxTokenBytes) {
    return BadField("resume_token", "is longer than those of this server");
  }
  request.resume_token = proto.resume_token();
  return request;
}

v1::CoefficientBlock ToProto(CoefficientsMessage message) {
  v1::CoefficientBlock proto;
  if (message.set) {
    *proto.mutable_set() = SummaryToProto(*message.set);
  }
  proto.set_data(std::move(message.data));
  if (message.reached) {
    *proto.mutable_rate_xyz() =
        Vec3ToProto(message.reached->x, message.reached->y, message.reached->z);
  }
  proto.set_resume_token(std::move(message.resume_token));
  proto.set_index(message.index);
  for (frames::Warning& warning : message.warnings) {
    *proto.add_warnings() = WarningToProto(std::move(warning));
  }
  return proto;
}

StatusOr<CoefficientsMessage> FromProto(v1::CoefficientBlock proto) {
  CoefficientsMessage message;
  if (proto.has_set()) {
    FOVEA_ASSIGN_OR_RETURN(message.set, SummaryFromProto(proto.set()));
  }
  message.data = std::move(*proto.mutable_data());
  if (proto.has_rate_xyz()) {
    if (!IsRate(proto.rate_xyz())) {
      return Internal("coefficients of a rate of {},{},{}", proto.rate_xyz().x(),
                      proto.rate_xyz().y(), proto.rate_xyz().z());
    }
    message.reached = RateOf(proto.rate_xyz());
  }
  message.resume_token = proto.resume_token();
  message.index = proto.index();
  for (const v1::Warning& warning : proto.warnings()) {
    const bool not_retained = warning.code() == v1::Warning::NOT_RETAINED;
    message.warnings.push_back(
        {warning.message(), warning.count(),
         not_retained ? frames::Warning::Code::kNotRetained : frames::Warning::Code::kDataLoss});
  }
  return message;
}

}  // namespace fovea::wire
