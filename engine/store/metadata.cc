#include "engine/store/metadata.h"

#include <array>
#include <limits>
#include <optional>
#include <span>
#include <stdexcept>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "engine/store/codec.h"
#include "engine/store/file.h"
#include "engine/store/stored_type.h"
#include "engine/store/validate_info.h"

namespace fovea::store {
namespace {

using nlohmann::json;

constexpr int64_t kMaxMetadataBytes = 1 << 20;
constexpr int kMaxJsonDepth = 16;
constexpr const char* kChecksumKey = "crc32c";

uint32_t ChecksumOf(const json& attributes) {
  const std::string text = attributes.dump();
  return Crc32c(std::as_bytes(std::span(text)));
}

json RetentionJson(const std::vector<RetainedWindow>& windows) {
  if (windows.empty()) {
    return "all";
  }
  json list = json::array();
  for (const auto& [at, rate] : windows) {
    list.push_back({{"fovea_xyz", {at.x, at.y, at.z}}, {"rate_xyz", {rate.x, rate.y, rate.z}}});
  }
  return list;
}

json Attributes(const DatasetInfo& info) {
  const auto& dims = info.hierarchy.dims();
  json fields = json::object();
  for (const FieldInfo& field : info.fields) {
    json& attributes = fields[field.name];
    attributes = {{"type", field.type}, {"minimum", field.minimum}, {"maximum", field.maximum}};
    if (!field.scales.empty()) {
      attributes["scales"] = field.scales;
      attributes["tolerance"] = field.tolerance;
      attributes["max_error"] = field.max_error;
    }
    if (!field.lost_steps.empty()) {
      attributes["lost_steps"] = field.lost_steps;
    }
    if (!field.value_unit.empty()) {
      attributes["value_unit"] = field.value_unit;
    }
  }
  json attributes = {{"format_version", info.format_version},
                     {"wavelet", info.wavelet},
                     {"dims_xyz", {dims.x, dims.y, dims.z}},
                     {"origin_xyz", {info.origin.x, info.origin.y, info.origin.z}},
                     {"index_to_world", info.index_to_world.m},
                     {"world_unit", info.world_unit},
                     {"time_unit", "ns"},
                     {"clock", info.clock},
                     {"retention", RetentionJson(info.retention)},
                     {"committed_steps", info.committed_steps},
                     {"default_field", info.default_field},
                     {"chunk_edge", info.chunk_edge},
                     {"fields", std::move(fields)}};
  if (info.source) {
    attributes["source"] = {{"series", info.source->series},
                            {"steps", info.source->steps},
                            {"part", info.source->part},
                            {"parts", info.source->parts}};
  }
  attributes[kChecksumKey] = fmt::format("{:08x}", ChecksumOf(attributes));
  return attributes;
}

}  // namespace

StatusOr<std::string> GroupJson(const DatasetInfo& info) {
  FOVEA_RETURN_IF_ERROR(ValidateInfo(info));
  try {
    const json group = {
        {"zarr_format", 3}, {"node_type", "group"}, {"attributes", {{"fovea", Attributes(info)}}}};
    return group.dump(1) + "\n";
  } catch (const json::exception& error) {  // a text that is not UTF-8
    return InvalidArgument("world_unit or clock cannot be written: {}", error.what());
  }
}

StatusOr<std::string> GroupCopyJson(const DatasetInfo& info) {
  DatasetInfo empty = info;
  empty.committed_steps = 0;
  for (FieldInfo& field : empty.fields) {
    field.minimum = field.maximum = field.max_error = 0;
    field.lost_steps.clear();
  }
  return GroupJson(empty);
}

namespace {

json FieldGroupDocument() {
  return {{"zarr_format", 3}, {"node_type", "group"}, {"attributes", json::object()}};
}

}  // namespace

std::string FieldGroupJson() {
  return FieldGroupDocument().dump(1) + "\n";
}

namespace {

json Codec(const char* name, const json& configuration = nullptr) {
  json codec = {{"name", name}};
  if (!configuration.is_null()) {
    codec["configuration"] = configuration;
  }
  return codec;
}

json Zstd() {
  return Codec("zstd", {{"level", kDefaultZstdLevel}, {"checksum", true}});
}

/// What each chunk says itself in its header; here for other writers.
json Blosc(const Coding& coding) {
  const bool is_of_version_1 = IsIntegerType(coding.type) && !coding.is_folded;
  return Codec("blosc", {{"cname", "zstd"},
                         {"clevel", 1},
                         {"shuffle", is_of_version_1 ? "bitshuffle" : "shuffle"},
                         {"typesize", BytesOfType(coding.type)},
                         {"blocksize", 0}});
}

/// How to read the numbers of an array. `scale_factor` is the name under which others (CF
/// conventions) look for what values are to be multiplied by, which folded ones must not be.
json ArrayAttributes(const ArraySpec& spec) {
  json attributes = json::object();
  if (spec.coding && spec.coding->is_folded) {
    attributes["signs"] = "folded";
  }
  if (spec.coding && spec.coding->scale != 1) {
    attributes[spec.coding->is_folded ? "folded_scale" : "scale_factor"] = spec.coding->scale;
  }
  return attributes;
}

json ArrayDocument(const ArraySpec& spec, int64_t steps) {
  std::vector<int64_t> shape = {steps};
  shape.insert(shape.end(), spec.shape.begin(), spec.shape.end());
  const json bytes = Codec("bytes", {{"endian", "little"}});
  json codecs = {bytes, spec.coding ? Blosc(*spec.coding) : Zstd(), Codec("crc32c")};
  if (!spec.shard.empty()) {
    codecs = json::array({Codec("sharding_indexed", {{"chunk_shape", spec.chunk},
                                                     {"codecs", codecs},
                                                     {"index_codecs", {bytes, Codec("crc32c")}},
                                                     {"index_location", "end"}})});
  }
  const bool is_float = spec.data_type.starts_with("float");
  const json fill = is_float ? json(static_cast<double>(spec.fill_value)) : json(spec.fill_value);
  const json regular = {{"chunk_shape", spec.shard.empty() ? spec.chunk : spec.shard}};
  return {{"zarr_format", 3},
          {"node_type", "array"},
          {"shape", shape},
          {"data_type", spec.data_type},
          {"chunk_grid", {{"name", "regular"}, {"configuration", regular}}},
          {"chunk_key_encoding", {{"name", "default"}, {"configuration", {{"separator", "."}}}}},
          {"fill_value", fill},
          {"codecs", codecs},
          {"attributes", ArrayAttributes(spec)},
          {"dimension_names", spec.dimension_names}};
}

}  // namespace

std::string ArrayJson(const ArraySpec& spec, int64_t steps) {
  return ArrayDocument(spec, steps).dump(1) + "\n";
}

namespace {

/// Nothing if the text is not JSON or nested too deeply.
std::optional<json> Parse(const std::string& text) {
  bool too_deep = false;
  const auto check = [&](int depth, json::parse_event_t, const json&) {
    too_deep = too_deep || depth > kMaxJsonDepth;
    return !too_deep;
  };
  json document = json::parse(text, check, /*allow_exceptions=*/false);
  if (too_deep || document.is_discarded()) {
    return std::nullopt;
  }
  return document;
}

StatusOr<json> ReadJson(FileSystem& files, const std::string& path) {
  FOVEA_ASSIGN_OR_RETURN(const std::vector<std::byte> bytes,
                         ReadWholeFile(files, path, kMaxMetadataBytes));
  std::optional<json> document =
      Parse(std::string(reinterpret_cast<const char*>(bytes.data()), bytes.size()));
  if (!document) {
    return DataLoss("{} is damaged: it is not valid JSON", path);
  }
  return *std::move(document);
}

/// Thrown and caught in this file only, beside what the JSON library throws.
class BadValue : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// An integer in a range.
int64_t Integer(const json& parent, const char* key, int64_t least, int64_t most) {
  const json& value = parent.at(key);
  // Neither a float nor a number past int64 may be cast.
  const bool fits =
      value.is_number_integer() &&
      !(value.is_number_unsigned() && value.get<uint64_t>() > std::numeric_limits<int64_t>::max());
  if (!fits || value.get<int64_t>() < least || value.get<int64_t>() > most) {
    throw BadValue(fmt::format("{} must be an integer from {} to {}", key, least, most));
  }
  return value.get<int64_t>();
}

Int3 Triple(const json& parent, const char* key, int64_t least, int64_t most) {
  const json& values = parent.at(key);
  if (!values.is_array() || values.size() != 3) {
    throw BadValue(fmt::format("{} must have 3 numbers", key));
  }
  const json named = {{"x", values[0]}, {"y", values[1]}, {"z", values[2]}};
  return {Integer(named, "x", least, most), Integer(named, "y", least, most),
          Integer(named, "z", least, most)};
}

/// Throws where something is missing or of another type.
FieldInfo FieldFrom(const std::string& name, const json& field) {
  FieldInfo info;
  info.name = name;
  info.type = field.at("type").get<std::string>();
  info.minimum = field.at("minimum").get<double>();
  info.maximum = field.at("maximum").get<double>();
  if (field.contains("scales")) {
    info.scales = field.at("scales").get<std::vector<float>>();
    info.tolerance = field.at("tolerance").get<double>();
    info.max_error = field.at("max_error").get<double>();
  }
  if (field.contains("lost_steps")) {
    info.lost_steps = field.at("lost_steps").get<std::vector<int64_t>>();
  }
  info.value_unit = field.value("value_unit", std::string());
  return info;
}

/// Throws where something is missing or of another type.
std::vector<RetainedWindow> RetentionFrom(const json& retention) {
  if (retention == "all") {
    return {};
  }
  if (!retention.is_array() || retention.empty() || retention.size() > kMaxRetainedWindows) {
    throw BadValue(
        fmt::format("retention must be \"all\" or 1 to {} windows", kMaxRetainedWindows));
  }
  std::vector<RetainedWindow> windows;
  for (const json& window : retention) {
    const auto at = window.at("fovea_xyz").get<std::array<double, 3>>();
    const auto rate = window.at("rate_xyz").get<std::array<double, 3>>();
    windows.push_back({{at[0], at[1], at[2]}, {rate[0], rate[1], rate[2]}});
  }
  return windows;
}

/// Throws where something is missing or of another type.
std::optional<SourceInfo> SourceFrom(const json& attributes) {
  if (!attributes.contains("source")) {
    return std::nullopt;
  }
  const json& source = attributes.at("source");
  return SourceInfo{source.at("series").get<std::string>(), Integer(source, "steps", 0, kMaxSteps),
                    Integer(source, "part", 0, kMaxSteps), Integer(source, "parts", 1, kMaxSteps)};
}

/// Throws where something is missing or of another type.
StatusOr<DatasetInfo> InfoFrom(const json& attributes) {
  constexpr int64_t kFarthest = int64_t{1} << 40;
  DatasetInfo info;
  info.wavelet = attributes.at("wavelet").get<std::string>();
  FOVEA_ASSIGN_OR_RETURN(info.hierarchy,
                         Hierarchy::Make(Triple(attributes, "dims_xyz", 1, kMaxDimension)));
  info.origin = Triple(attributes, "origin_xyz", -kFarthest, kFarthest);
  info.format_version = static_cast<int>(Integer(attributes, "format_version", 1, kFormatVersion));
  const json& matrix = attributes.at("index_to_world");
  if (matrix.size() != info.index_to_world.m.size()) {
    return InvalidArgument("index_to_world must have 16 numbers");
  }
  matrix.get_to(info.index_to_world.m);
  info.world_unit = attributes.at("world_unit").get<std::string>();
  if (attributes.at("time_unit") != "ns") {
    return InvalidArgument("time_unit must be ns");
  }
  info.clock = attributes.at("clock").get<std::string>();
  info.retention = RetentionFrom(attributes.at("retention"));
  info.source = SourceFrom(attributes);
  info.committed_steps = Integer(attributes, "committed_steps", 0, kMaxSteps);
  info.default_field = attributes.at("default_field").get<std::string>();
  info.chunk_edge = Integer(attributes, "chunk_edge", 8, 32);
  for (const auto& [name, field] : attributes.at("fields").get_ref<const json::object_t&>()) {
    info.fields.push_back(FieldFrom(name, field));
  }
  FOVEA_RETURN_IF_ERROR(ValidateInfo(info));
  return info;
}

/// Throws where something is missing or of another type.
StatusOr<DatasetInfo> InfoFromGroup(const json& group, const std::string& path) {
  if (!group.is_object() || !group.contains("attributes") || !group.at("attributes").is_object() ||
      !group.at("attributes").contains("fovea")) {
    return FailedPrecondition("{} is not that of a Fovea store: it has no fovea attributes", path);
  }
  json attributes = group.at("attributes").at("fovea");
  if (const int64_t version = Integer(attributes, "format_version", 1, kMaxSteps);
      version > kFormatVersion) {
    return FailedPrecondition("{} has format version {}; this program reads {}: use a newer one",
                              path, version, kFormatVersion);
  }
  const std::string stored = attributes.at(kChecksumKey).get<std::string>();
  attributes.erase(kChecksumKey);
  if (stored != fmt::format("{:08x}", ChecksumOf(attributes))) {
    return DataLoss("{} is damaged or was edited: its attributes do not match their {}", path,
                    kChecksumKey);
  }
  if (group.at("zarr_format") != 3 || group.at("node_type") != "group") {
    return DataLoss("{} is damaged: not a Zarr v3 group", path);
  }
  StatusOr<DatasetInfo> info = InfoFrom(attributes);
  if (!info.ok()) {
    return FailedPrecondition("{} cannot be used: {}", path, MessageOf(info.status()));
  }
  return info;
}

}  // namespace

StatusOr<DatasetInfo> ReadGroup(FileSystem& files, const std::string& store_path,
                                std::string_view name) {
  const std::string path = fmt::format("{}/{}", store_path, name);
  StatusOr<json> group = ReadJson(files, path);
  if (absl::IsNotFound(group.status())) {
    if (ListDirectory(files, store_path).ok()) {
      return FailedPrecondition("{} is not a Fovea store: it has no {}", store_path, name);
    }
    return NotFound("there is no store at {}", store_path);
  }
  FOVEA_RETURN_IF_ERROR(group.status());
  try {
    return InfoFromGroup(*group, path);
  } catch (const std::exception& error) {
    return DataLoss("{} is damaged: {}", path, error.what());
  }
}

namespace {

/// What may differ between two writers of the same array: the steps and how hard they tried.
void EraseVariable(json& document) {
  document.at("shape").at(0) = 0;
  json* codecs = &document.at("codecs");
  if (codecs->at(0).at("name") == "sharding_indexed") {
    codecs = &codecs->at(0).at("configuration").at("codecs");
  }
  codecs->at(1).at("configuration").erase("level");
  codecs->at(1).at("configuration").erase("clevel");
}

}  // namespace

StatusOr<int64_t> ReadArraySteps(FileSystem& files, const std::string& store_path,
                                 const ArraySpec& spec) {
  const std::string path = fmt::format("{}/{}/{}", store_path, spec.path, kMetadataName);
  StatusOr<json> document = ReadJson(files, path);
  if (absl::IsNotFound(document.status())) {
    return DataLoss("{} is missing", path);
  }
  FOVEA_RETURN_IF_ERROR(document.status());
  try {
    const json& shape = document->at("shape");
    const int64_t steps = Integer({{"t", shape.at(0)}}, "t", 0, kMaxSteps + 1);
    json expected = ArrayDocument(spec, 0);
    EraseVariable(expected);
    EraseVariable(*document);
    if (*document != expected) {
      return DataLoss("{} is damaged: it does not describe the array that the store must have",
                      path);
    }
    return steps;
  } catch (const std::exception& error) {
    return DataLoss("{} is damaged: {}", path, error.what());
  }
}

Status CheckFieldGroup(FileSystem& files, const std::string& store_path, const std::string& field) {
  const std::string path = fmt::format("{}/{}/{}", store_path, field, kMetadataName);
  StatusOr<json> document = ReadJson(files, path);
  if (absl::IsNotFound(document.status())) {
    return DataLoss("{} is missing", path);
  }
  FOVEA_RETURN_IF_ERROR(document.status());
  // Attributes are free for others to use.
  if (document->is_object() && document->contains("attributes") &&
      document->at("attributes").is_object()) {
    document->at("attributes") = json::object();
  }
  if (*document != FieldGroupDocument()) {
    return DataLoss("{} is damaged: not a Zarr v3 group", path);
  }
  return absl::OkStatus();
}

}  // namespace fovea::store
