#include "engine/store/validate_info.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <set>
#include <string>
#include <vector>

#include "engine/store/layout.h"
#include "engine/store/metadata.h"
#include "engine/store/retention.h"
#include "engine/store/stored_type.h"
#include "engine/volume/basis.h"

namespace fovea::store {
namespace {

constexpr size_t kMaxFields = 256;
constexpr size_t kMaxLostSteps = 50'000;  // a group must stay readable
constexpr size_t kMaxNameLength = 100;
constexpr size_t kMaxTextLength = 1000;

bool IsFieldName(const std::string& name) {
  const auto allowed = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' ||
           c == '-' || c == '.';
  };
  return !name.empty() && name.size() <= kMaxNameLength && name[0] != '.' &&
         !name.starts_with("__") && std::all_of(name.begin(), name.end(), allowed) &&
         name != kTimePath && name != kFrameNumberPath && name != kMetadataName;
}

Status CheckCoding(const FieldInfo& field, Wavelet wavelet, int64_t levels) {
  FOVEA_RETURN_IF_ERROR(CheckStoredType(field.type));
  if (IsIntegerType(field.type) && field.scales.empty() && wavelet == Wavelet::kCdf97) {
    return InvalidArgument("type {}: there is no reversible integer form of cdf97", field.type);
  }
  if (field.scales.empty()) {
    return absl::OkStatus();
  }
  const auto is_scale = [](float scale) { return std::isfinite(scale) && scale > 0; };
  if (std::ssize(field.scales) != levels || !IsIntegerType(field.type) ||
      !std::all_of(field.scales.begin(), field.scales.end(), is_scale) || !(field.tolerance > 0) ||
      !(field.max_error >= 0)) {
    return InvalidArgument(
        "quantised: it must have an integer type, {} scales, and a tolerance above 0", levels);
  }
  return absl::OkStatus();
}

Status ValidateSource(const DatasetInfo& info) {
  if (!info.source) {
    return absl::OkStatus();
  }
  const SourceInfo& source = *info.source;
  const auto is_hex = [](char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'); };
  if (source.series.size() != 16 ||
      !std::all_of(source.series.begin(), source.series.end(), is_hex)) {
    return InvalidArgument("the series of the source must be 16 hex digits");
  }
  if (source.steps < 0 || source.steps > kMaxSteps || source.parts < 1 ||
      source.parts > kMaxSteps || source.part < 0 || source.part >= source.parts) {
    return InvalidArgument("the source is part {} of {} of {} steps: that cannot be", source.part,
                           source.parts, source.steps);
  }
  return absl::OkStatus();
}

Status ValidateFields(const DatasetInfo& info, Wavelet wavelet) {
  if (info.fields.empty() || info.fields.size() > kMaxFields) {
    return InvalidArgument("{} fields: there must be 1 to {}", info.fields.size(), kMaxFields);
  }
  std::set<std::string> names;
  for (const FieldInfo& field : info.fields) {
    if (!IsFieldName(field.name)) {
      return InvalidArgument(
          "field name '{}': it must be 1 to {} of A-Z a-z 0-9 _ . - without '.' or '__' in front, "
          "and not '{}', '{}' or '{}'",
          field.name.substr(0, kMaxNameLength), kMaxNameLength, kTimePath, kFrameNumberPath,
          kMetadataName);
    }
    if (!names.insert(field.name).second) {
      return InvalidArgument("field '{}' is there twice", field.name);
    }
    FOVEA_RETURN_IF_ERROR(Annotate(CheckCoding(field, wavelet, info.hierarchy.finest()),
                                   fmt::format("field '{}'", field.name)));
    if (!std::isfinite(field.minimum) || !std::isfinite(field.maximum) ||
        field.minimum > field.maximum) {
      return InvalidArgument("field '{}' has the range {} to {}", field.name, field.minimum,
                             field.maximum);
    }
    const std::vector<int64_t>& lost = field.lost_steps;
    if (lost.size() > kMaxLostSteps ||
        std::adjacent_find(lost.begin(), lost.end(), std::greater_equal<>()) != lost.end() ||
        (!lost.empty() && (lost.front() < 0 || lost.back() >= info.committed_steps))) {
      return InvalidArgument("field '{}': lost_steps must be ascending steps, at most {}",
                             field.name, kMaxLostSteps);
    }
  }
  if (!names.contains(info.default_field)) {
    return InvalidArgument("the default field '{}' is none of the fields",
                           info.default_field.substr(0, kMaxNameLength));
  }
  return absl::OkStatus();
}

}  // namespace

Status ValidateInfo(const DatasetInfo& info) {
  FOVEA_ASSIGN_OR_RETURN(const Wavelet wavelet, ParseWavelet(info.wavelet));
  if (info.chunk_edge != 8 && info.chunk_edge != 16 && info.chunk_edge != 32) {
    return InvalidArgument("chunk edge {}: it must be 8, 16 or 32", info.chunk_edge);
  }
  if (info.committed_steps < 0 || info.committed_steps > kMaxSteps) {
    return InvalidArgument("{} committed steps: 0 to {} can be", info.committed_steps, kMaxSteps);
  }
  const auto& m = info.index_to_world.m;
  const double determinant = info.index_to_world.Determinant();
  if (!std::all_of(m.begin(), m.end(), [](double v) { return std::isfinite(v); }) ||
      !std::isfinite(determinant) || determinant == 0) {
    return InvalidArgument("the index-to-world matrix is singular or not finite");
  }
  for (const std::string* text : {&info.world_unit, &info.clock}) {
    if (text->size() > kMaxTextLength) {
      return InvalidArgument("world_unit and clock must not exceed {} bytes", kMaxTextLength);
    }
  }
  FOVEA_RETURN_IF_ERROR(RetainedChunks::Make(info).status());
  FOVEA_RETURN_IF_ERROR(ValidateSource(info));
  return ValidateFields(info, wavelet);
}

}  // namespace fovea::store
