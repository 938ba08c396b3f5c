#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "service/wire/convert.h"

namespace fovea::wire {
namespace {

/// The matrix, or INTERNAL.
StatusOr<Matrix4> MatrixFromProto(const v1::Dataset& proto) {
  Matrix4 matrix;
  const auto& values = proto.index_to_world();
  if (values.size() != static_cast<int>(matrix.m.size()) ||
      !std::all_of(values.begin(), values.end(), [](double v) { return std::isfinite(v); })) {
    return Internal("dataset '{}' with an index_to_world that is not 16 finite numbers",
                    proto.name());
  }
  std::copy(values.begin(), values.end(), matrix.m.begin());
  return matrix;
}

/// Ascending, of committed steps; or INTERNAL.
StatusOr<std::vector<int64_t>> LostStepsFromProto(const v1::Dataset& proto,
                                                  const v1::Dataset::Field& field) {
  std::vector<int64_t> steps;
  uint64_t next = 0;
  for (const uint64_t step : field.lost_steps()) {
    if (step < next || step >= proto.committed_steps()) {
      return Internal("dataset '{}': lost step {} of '{}' is out of order, or not committed",
                      proto.name(), step, field.name());
    }
    next = step + 1;
    steps.push_back(static_cast<int64_t>(step));
  }
  return steps;
}

}  // namespace

v1::Dataset ToProto(const DatasetSummary& summary) {
  const store::DatasetInfo& info = summary.info;
  v1::Dataset proto;
  proto.set_name(summary.name);
  proto.set_nx(static_cast<uint32_t>(info.hierarchy.dims().x));
  proto.set_ny(static_cast<uint32_t>(info.hierarchy.dims().y));
  proto.set_nz(static_cast<uint32_t>(info.hierarchy.dims().z));
  proto.set_committed_steps(static_cast<uint64_t>(info.committed_steps));
  for (const store::FieldInfo& field : info.fields) {
    v1::Dataset::Field& out = *proto.add_fields();
    out.set_name(field.name);
    out.set_type(field.type);
    out.set_minimum(field.minimum);
    out.set_maximum(field.maximum);
    out.set_value_unit(field.value_unit);
    out.mutable_lost_steps()->Add(field.lost_steps.begin(), field.lost_steps.end());
  }
  proto.set_default_field(info.default_field);
  proto.set_wavelet(info.wavelet);
  proto.mutable_index_to_world()->Add(info.index_to_world.m.begin(), info.index_to_world.m.end());
  proto.set_world_unit(info.world_unit);
  proto.set_first_time_ns(summary.first_time_ns);
  proto.set_last_time_ns(summary.last_time_ns);
  proto.set_clock(info.clock);
  if (summary.default_spec != frames::FrameSpec{}) {
    *proto.mutable_default_spec() = ToProto(summary.default_spec);
  }
  return proto;
}

StatusOr<DatasetSummary> FromProto(const v1::Dataset& proto) {
  DatasetSummary summary;
  summary.name = proto.name();
  store::DatasetInfo& info = summary.info;
  auto hierarchy = Hierarchy::Make({proto.nx(), proto.ny(), proto.nz()});
  if (!hierarchy.ok()) {
    return Internal("dataset '{}': {}", proto.name(), MessageOf(hierarchy.status()));
  }
  if (proto.committed_steps() > static_cast<uint64_t>(std::numeric_limits<int64_t>::max())) {
    return Internal("dataset '{}' with {} steps", proto.name(), proto.committed_steps());
  }
  info.hierarchy = *hierarchy;
  info.committed_steps = static_cast<int64_t>(proto.committed_steps());
  for (const v1::Dataset::Field& field : proto.fields()) {
    store::FieldInfo& in = info.fields.emplace_back();
    in.name = field.name();
    in.type = field.type();
    in.minimum = field.minimum();
    in.maximum = field.maximum();
    in.value_unit = field.value_unit();
    FOVEA_ASSIGN_OR_RETURN(in.lost_steps, LostStepsFromProto(proto, field));
  }
  info.default_field = proto.default_field();
  info.wavelet = proto.wavelet();
  FOVEA_ASSIGN_OR_RETURN(info.index_to_world, MatrixFromProto(proto));
  info.world_unit = proto.world_unit();
  summary.first_time_ns = proto.first_time_ns();
  summary.last_time_ns = proto.last_time_ns();
  info.clock = proto.clock();
  if (proto.has_default_spec()) {
    auto spec = FromProto(proto.default_spec(), "default_spec");
    if (!spec.ok()) {
      return Internal("dataset '{}': {}", proto.name(), MessageOf(spec.status()));
    }
    summary.default_spec = *std::move(spec);
  }
  return summary;
}

}  // namespace fovea::wire
