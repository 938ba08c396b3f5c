#include "service/wire/upload.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <set>
#include <string_view>
#include <utility>

#include "service/wire/printable.h"
#include "service/wire/readings.h"
#include "service/wire/status.h"

namespace fovea::wire {
namespace {

constexpr int kMaxFields = 64;
constexpr size_t kMaxUnitBytes = 64, kMaxFieldNameBytes = 255, kSeriesDigits = 16;
constexpr uint64_t kMaxSteps = 1'000'000;
constexpr std::array<std::pair<std::string_view, UploadSpec::Type>, 5> kTypes{
    {{"uint8", UploadSpec::Type::kUint8},
     {"int8", UploadSpec::Type::kInt8},
     {"uint16", UploadSpec::Type::kUint16},
     {"int16", UploadSpec::Type::kInt16},
     {"float32", UploadSpec::Type::kFloat32}}};

Status CheckText(const std::string& path, const std::string& text) {
  return text.size() <= kMaxUnitBytes ? absl::OkStatus()
                                      : BadField(path, fmt::format("has {} bytes, more than {}",
                                                                   text.size(), kMaxUnitBytes));
}

StatusOr<int64_t> TakeSize(const char* path, uint32_t voxels) {
  if (voxels < 1 || voxels > kMaxDimension) {
    return BadField(path, fmt::format("{} is outside 1 to {} voxels", voxels, kMaxDimension));
  }
  return int64_t{voxels};
}

StatusOr<UploadSpec::Field> TakeField(const v1::UploadHeader::Field& proto,
                                      const std::string& path) {
  UploadSpec::Field field{proto.name(), UploadSpec::Type::kFloat32, proto.value_unit()};
  // The parts of a dataset's name have the same rules.
  if (!IsNewDatasetName(field.name) || field.name.size() > kMaxFieldNameBytes ||
      field.name.find('/') != std::string::npos) {
    return BadField(path + ".name", fmt::format("'{}' is not of [A-Za-z0-9_.-], or begins with '.'",
                                                Printable(field.name)));
  }
  const auto type = std::find_if(kTypes.begin(), kTypes.end(),
                                 [&](const auto& known) { return known.first == proto.type(); });
  if (type == kTypes.end()) {
    return BadField(path + ".type",
                    fmt::format("'{}' is none of uint8, int8, uint16, int16, float32: make float32 "
                                "of other voxels",
                                Printable(proto.type())));
  }
  field.type = type->second;
  FOVEA_RETURN_IF_ERROR(CheckText(path + ".value_unit", field.value_unit));
  return field;
}

/// All, and how large they are together; counted in 64 bits.
Status TakeFields(const v1::UploadHeader& proto, UploadSpec* spec) {
  if (proto.fields_size() < 1 || proto.fields_size() > kMaxFields) {
    return BadField("header.fields",
                    fmt::format("{} fields are not 1 to {}", proto.fields_size(), kMaxFields));
  }
  std::set<std::string> names;
  int64_t bytes = 0;
  for (int i = 0; i < proto.fields_size(); ++i) {
    const std::string path = fmt::format("header.fields[{}]", i);
    FOVEA_ASSIGN_OR_RETURN(UploadSpec::Field field, TakeField(proto.fields(i), path));
    if (!names.insert(field.name).second) {
      return BadField(path + ".name", fmt::format("'{}' is there twice", field.name));
    }
    bytes += spec->dims.Product() * BytesOf(field.type);  // at most 2^50 each
    spec->fields.push_back(std::move(field));
  }
  if (bytes > kMaxUploadBytes) {
    return BadField("header.nx",
                    fmt::format("{} x {} x {} voxels are {} bytes of all fields, more "
                                "than the {} of a step that is uploaded",
                                spec->dims.x, spec->dims.y, spec->dims.z, bytes, kMaxUploadBytes));
  }
  return absl::OkStatus();
}

Status TakeMatrix(const v1::UploadHeader& proto, UploadSpec* spec) {
  if (proto.index_to_world().empty()) {
    return absl::OkStatus();
  }
  Matrix4 matrix;
  const bool affine = proto.index_to_world_size() == 16 && proto.index_to_world(12) == 0 &&
                      proto.index_to_world(13) == 0 && proto.index_to_world(14) == 0 &&
                      proto.index_to_world(15) == 1;
  if (affine) {
    std::copy(proto.index_to_world().begin(), proto.index_to_world().end(), matrix.m.begin());
  }
  const bool finite = std::all_of(matrix.m.begin(), matrix.m.end(),
                                  [](double number) { return std::isfinite(number); });
  if (!affine || !finite || !std::isnormal(matrix.Determinant())) {
    return BadField("header.index_to_world",
                    "must be 16 finite numbers, the last four 0, 0, 0, 1, of a matrix that can be "
                    "inverted");
  }
  spec->index_to_world = matrix;
  return absl::OkStatus();
}

Status TakeMaking(const v1::UploadHeader& proto, UploadSpec* spec) {
  if (!proto.wavelet().empty()) {
    const auto wavelet = ParseWavelet(proto.wavelet());
    if (!wavelet.ok()) {
      return BadField("header.wavelet", fmt::format("'{}' is none of haar, cdf53, cdf97",
                                                    Printable(proto.wavelet())));
    }
    spec->wavelet = *wavelet;
  }
  spec->lossless = proto.lossless();
  if (proto.has_chunk_edge()) {
    const uint32_t edge = proto.chunk_edge();
    if (edge != 8 && edge != 16 && edge != 32) {
      return BadField("header.chunk_edge", fmt::format("{} is none of 8, 16, 32", edge));
    }
    spec->chunk_edge = edge;
  }
  spec->world_unit = proto.world_unit();
  FOVEA_RETURN_IF_ERROR(CheckText("header.world_unit", spec->world_unit));
  if (!proto.has_series()) {
    return absl::OkStatus();
  }
  const std::string& id = proto.series().id();
  if (id.size() != kSeriesDigits || id.find_first_not_of("0123456789abcdef") != std::string::npos) {
    return BadField(
        "header.series.id",
        fmt::format("'{}' is not 16 hexadecimal digits, 0 to 9 and a to f", Printable(id)));
  }
  if (proto.series().steps() < 1 || proto.series().steps() > kMaxSteps) {
    return BadField("header.series.steps",
                    fmt::format("{} is outside 1 to {}", proto.series().steps(), kMaxSteps));
  }
  spec->source = store::SourceInfo{id, static_cast<int64_t>(proto.series().steps()), 0, 1};
  return absl::OkStatus();
}

}  // namespace

int64_t BytesOf(UploadSpec::Type type) {
  switch (type) {
    case UploadSpec::Type::kUint8:
    case UploadSpec::Type::kInt8:
      return 1;
    case UploadSpec::Type::kUint16:
    case UploadSpec::Type::kInt16:
      return 2;
    case UploadSpec::Type::kFloat32:
      break;
  }
  return 4;
}

StatusOr<UploadSpec> FromProto(const v1::UploadHeader& proto) {
  UploadSpec spec;
  spec.dataset = proto.dataset();
  if (!IsNewDatasetName(spec.dataset)) {
    return BadField("header.dataset",
                    fmt::format("'{}' must be 1 to 16 parts of [A-Za-z0-9_.-], separated by '/', "
                                "none of them beginning with '.' or ending in '.zarr'",
                                Printable(spec.dataset)));
  }
  if (proto.step() >= kMaxSteps) {
    return BadField("header.step", fmt::format("{} is not below {}", proto.step(), kMaxSteps));
  }
  spec.step = static_cast<int64_t>(proto.step());
  spec.time_ns = proto.time_ns();
  if (proto.has_frame_number()) {
    if (proto.frame_number() == std::numeric_limits<int64_t>::min()) {
      return BadField("header.frame_number", "-2^63 stands for none");
    }
    spec.frame_number = proto.frame_number();
  }
  FOVEA_ASSIGN_OR_RETURN(spec.dims.x, TakeSize("header.nx", proto.nx()));
  FOVEA_ASSIGN_OR_RETURN(spec.dims.y, TakeSize("header.ny", proto.ny()));
  FOVEA_ASSIGN_OR_RETURN(spec.dims.z, TakeSize("header.nz", proto.nz()));
  FOVEA_RETURN_IF_ERROR(TakeFields(proto, &spec));
  FOVEA_RETURN_IF_ERROR(TakeMatrix(proto, &spec));
  FOVEA_RETURN_IF_ERROR(TakeMaking(proto, &spec));
  return spec;
}

v1::UploadHeader ToProto(const UploadSpec& spec) {
  v1::UploadHeader proto;
  proto.set_dataset(spec.dataset);
  proto.set_step(static_cast<uint64_t>(spec.step));
  proto.set_time_ns(spec.time_ns);
  if (spec.frame_number) {
    proto.set_frame_number(*spec.frame_number);
  }
  proto.set_nx(static_cast<uint32_t>(spec.dims.x));
  proto.set_ny(static_cast<uint32_t>(spec.dims.y));
  proto.set_nz(static_cast<uint32_t>(spec.dims.z));
  for (const UploadSpec::Field& field : spec.fields) {
    v1::UploadHeader::Field* to = proto.add_fields();
    to->set_name(field.name);
    const auto type = std::find_if(kTypes.begin(), kTypes.end(),
                                   [&](const auto& known) { return known.second == field.type; });
    to->set_type(std::string(type->first));
    to->set_value_unit(field.value_unit);
  }
  if (spec.index_to_world) {
    proto.mutable_index_to_world()->Add(spec.index_to_world->m.begin(),
                                        spec.index_to_world->m.end());
  }
  proto.set_world_unit(spec.world_unit);
  if (spec.wavelet) {
    proto.set_wavelet(std::string(WaveletName(*spec.wavelet)));
  }
  proto.set_lossless(spec.lossless);
  if (spec.chunk_edge) {
    proto.set_chunk_edge(static_cast<uint32_t>(*spec.chunk_edge));
  }
  if (spec.source) {
    proto.mutable_series()->set_id(spec.source->series);
    proto.mutable_series()->set_steps(static_cast<uint64_t>(spec.source->steps));
  }
  return proto;
}

v1::UploadStepResponse ToProto(const UploadSpec& spec, const UploadAnswer& answer) {
  v1::UploadStepResponse proto;
  proto.set_outcome(answer.already ? v1::UploadStepResponse::ALREADY
                                   : v1::UploadStepResponse::COMMITTED);
  proto.set_step(static_cast<uint64_t>(spec.step));
  proto.set_committed_steps(static_cast<uint64_t>(answer.committed_steps));
  proto.set_nonfinite_values(answer.nonfinite_values);
  return proto;
}

UploadAnswer FromProto(const v1::UploadStepResponse& proto) {
  return {proto.outcome() == v1::UploadStepResponse::ALREADY,
          static_cast<int64_t>(std::min(proto.committed_steps(), uint64_t{INT64_MAX})),
          proto.nonfinite_values()};
}

}  // namespace fovea::wire
