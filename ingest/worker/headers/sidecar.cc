#include "ingest/worker/headers/sidecar.h"

#include <cmath>

#include <nlohmann/json.hpp>

#include "ingest/raw_format.h"
#include "ingest/worker/headers/text.h"

namespace fovea::ingest {
namespace {

using nlohmann::json;

constexpr int kMaxDepth = 8;

/// A value that is there and not null, or null.
const json* Find(const json& object, std::initializer_list<const char*> names) {
  for (const char* name : names) {
    if (const auto found = object.find(name); found != object.end() && !found->is_null()) {
      return &*found;
    }
  }
  return nullptr;
}

StatusOr<int64_t> Integer(const json& value, const char* name) {
  const bool fits = value.is_number_integer() &&
                    !(value.is_number_unsigned() && value.get<uint64_t>() > (uint64_t{1} << 62));
  if (!fits) {
    return InvalidArgument("its '{}' is not a whole number", name);
  }
  return value.get<int64_t>();
}

StatusOr<std::vector<double>> Numbers(const json& value, const char* name) {
  std::vector<double> numbers;
  for (const json& element : value.is_array() ? value : json::array({value})) {
    if (!element.is_number() || !std::isfinite(element.get<double>())) {
      return InvalidArgument("its '{}' holds something that is not a number", name);
    }
    numbers.push_back(element.get<double>());
  }
  return numbers;
}

Status ReadVector(const json& object, std::initializer_list<const char*> names,
                  std::optional<Vec3>* vector) {
  const json* value = Find(object, names);
  if (value == nullptr) {
    return absl::OkStatus();
  }
  FOVEA_ASSIGN_OR_RETURN(const auto numbers, Numbers(*value, *names.begin()));
  if (numbers.size() != 3) {
    return InvalidArgument("its '{}' has {} numbers, not 3", *names.begin(), numbers.size());
  }
  *vector = Vec3{numbers[0], numbers[1], numbers[2]};
  return absl::OkStatus();
}

Status ReadText(const json& object, const char* name, std::string* text) {
  if (const json* value = Find(object, {name})) {
    if (!value->is_string()) {
      return InvalidArgument("its '{}' is not a text", name);
    }
    *text = value->get<std::string>();
  }
  return absl::OkStatus();
}

Status ReadInteger(const json& object, std::initializer_list<const char*> names, int64_t* number) {
  if (const json* value = Find(object, names)) {
    FOVEA_ASSIGN_OR_RETURN(*number, Integer(*value, *names.begin()));
  }
  return absl::OkStatus();
}

Status ReadRaw(const json& object, RawFormat* raw) {
  const json* dims = Find(object, {"dims_xyz", "dims"});
  if (dims == nullptr || !dims->is_array() || dims->size() != 3) {
    return InvalidArgument("its 'dims_xyz' is not a list of 3 numbers");
  }
  for (int axis = 0; axis < 3; ++axis) {
    FOVEA_ASSIGN_OR_RETURN(raw->dims[axis],
                           Integer((*dims)[static_cast<size_t>(axis)], "dims_xyz"));
  }
  raw->type.clear();
  FOVEA_RETURN_IF_ERROR(ReadText(object, "type", &raw->type));
  std::string order;
  FOVEA_RETURN_IF_ERROR(ReadText(object, "byte_order", &order));
  order = Lowered(order);
  if (order == "big" || order == "be") {
    raw->big_endian = true;
  } else if (order != "little" && order != "le" && order != "-" && !order.empty()) {
    return InvalidArgument("its 'byte_order' is '{}', not little or big", Shown(order));
  }
  FOVEA_RETURN_IF_ERROR(ReadInteger(object, {"header_bytes"}, &raw->header_bytes));
  FOVEA_RETURN_IF_ERROR(ReadInteger(object, {"steps", "steps_per_file"}, &raw->steps_per_file));
  return CheckRawFormat(*raw);
}

Status ReadTimes(const json& object, Sidecar* sidecar) {
  const json* times = Find(object, {"times_s"});
  if (times == nullptr) {
    return absl::OkStatus();
  }
  FOVEA_ASSIGN_OR_RETURN(sidecar->times_s, Numbers(*times, "times_s"));
  if (sidecar->times_s.size() != static_cast<size_t>(sidecar->raw.steps_per_file)) {
    return InvalidArgument("its 'times_s' has {} numbers for {} steps", sidecar->times_s.size(),
                           sidecar->raw.steps_per_file);
  }
  return absl::OkStatus();
}

}  // namespace

StatusOr<Sidecar> ParseSidecar(std::string_view text) {
  bool too_deep = false;
  const auto check = [&](int depth, json::parse_event_t, const json&) {
    too_deep = too_deep || depth > kMaxDepth;
    return !too_deep;
  };
  const json object = json::parse(text, check, /*allow_exceptions=*/false);
  if (too_deep || object.is_discarded() || !object.is_object()) {
    return InvalidArgument("it is not a JSON object");
  }
  Sidecar sidecar;
  FOVEA_RETURN_IF_ERROR(ReadRaw(object, &sidecar.raw));
  FOVEA_RETURN_IF_ERROR(ReadVector(object, {"spacing_xyz", "spacing"}, &sidecar.spacing));
  FOVEA_RETURN_IF_ERROR(ReadVector(object, {"origin_xyz", "origin"}, &sidecar.origin));
  FOVEA_RETURN_IF_ERROR(ReadText(object, "world_unit", &sidecar.world_unit));
  FOVEA_RETURN_IF_ERROR(ReadText(object, "value_unit", &sidecar.value_unit));
  FOVEA_RETURN_IF_ERROR(ReadTimes(object, &sidecar));
  return sidecar;
}

}  // namespace fovea::ingest
