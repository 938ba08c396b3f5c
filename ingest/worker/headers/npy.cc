#include "ingest/worker/headers/npy.h"

#include <algorithm>
#include <map>
#include <utility>
#include <vector>

#include "ingest/worker/headers/text.h"

namespace fovea::ingest {
namespace {

using namespace std::string_view_literals;

constexpr std::pair<std::string_view, SampleType> kTypes[] = {
    {"b1", SampleType::kUint8},   {"u1", SampleType::kUint8},   {"i1", SampleType::kInt8},
    {"u2", SampleType::kUint16},  {"i2", SampleType::kInt16},   {"u4", SampleType::kUint32},
    {"i4", SampleType::kInt32},   {"u8", SampleType::kUint64},  {"i8", SampleType::kInt64},
    {"f2", SampleType::kFloat16}, {"f4", SampleType::kFloat32}, {"f8", SampleType::kFloat64},
};

uint32_t LittleEndian(std::string_view bytes) {
  uint32_t value = 0;
  for (size_t i = 0; i < bytes.size(); ++i) {
    value |= static_cast<uint32_t>(static_cast<unsigned char>(bytes[i])) << (8 * i);
  }
  return value;
}

/// The value of `key` in a Python dictionary of literals: a text without its quotes, the inside of
/// a tuple, or a word.
StatusOr<std::string> ValueOf(std::string_view dictionary, const std::string& key) {
  for (const char quote : {'\'', '"'}) {
    const size_t found = dictionary.find(quote + key + quote);
    if (found == std::string_view::npos) {
      continue;
    }
    std::string_view rest = Trimmed(dictionary.substr(found + key.size() + 2));
    if (!rest.starts_with(':')) {
      continue;
    }
    rest = Trimmed(rest.substr(1));
    const char open = rest.empty() ? '\0' : rest.front();
    const char close = open == '(' ? ')' : open == '\'' || open == '"' ? open : '\0';
    const size_t begin = close == '\0' ? 0 : 1;
    const size_t end = close == '\0' ? rest.find_first_of(",}") : rest.find(close, 1);
    if (end == std::string_view::npos) {
      break;
    }
    return std::string(Trimmed(rest.substr(begin, end - begin)));
  }
  return InvalidArgument("its header has no usable '{}'", key);
}

StatusOr<std::vector<int64_t>> ShapeOf(std::string text) {
  std::replace(text.begin(), text.end(), ',', ' ');
  return IntegersOf(text, "shape");
}

Status SetType(const std::string& descr, DenseHeader* header) {
  const char order = descr.empty() ? '\0' : descr.front();
  const std::string_view type = descr.empty() ? ""sv : std::string_view(descr).substr(1);
  for (const auto& [name, known] : kTypes) {
    if (name == type && (order == '<' || order == '>' || order == '|' || order == '=')) {
      header->type = known;
      header->big_endian = order == '>';
      return absl::OkStatus();
    }
  }
  return InvalidArgument(
      "values of dtype '{}': only bool, integers and float16, 32 and 64 can be "
      "read",
      Shown(descr));
}

StatusOr<std::vector<AxisRole>> RolesOf(std::string axes, size_t dimensions) {
  const std::map<char, AxisRole> letters{{'x', AxisRole::kX},
                                         {'y', AxisRole::kY},
                                         {'z', AxisRole::kZ},
                                         {'t', AxisRole::kStep},
                                         {'c', AxisRole::kChannel}};
  if (axes.empty()) {
    constexpr std::string_view kUsual[] = {"", "x", "yx", "zyx", "tzyx"};
    if (dimensions == 0 || dimensions >= std::size(kUsual)) {
      return InvalidArgument("an array of {} axes: say what they are, e.g. --axes tzyxc",
                             dimensions);
    }
    axes = kUsual[dimensions];
  }
  if (axes.size() != dimensions) {
    return InvalidArgument("--axes {} has {} letters, but the array has {} axes", Shown(axes),
                           axes.size(), dimensions);
  }
  std::vector<AxisRole> roles;
  for (const char letter : axes) {
    const auto found = letters.find(letter);
    if (found == letters.end()) {
      return InvalidArgument("--axes {}: each letter is one of x, y, z, t, c", Shown(axes));
    }
    roles.push_back(found->second);
  }
  return roles;
}

}  // namespace

StatusOr<DenseHeader> ParseNpy(std::string_view bytes, const std::string& axes) {
  constexpr size_t kFixed = 8;
  if (bytes.size() < kFixed + 2 || !bytes.starts_with("\x93NUMPY"sv)) {
    return InvalidArgument("is not a NumPy array file");
  }
  const int version = bytes[6];
  const size_t length_bytes = version == 1 ? 2 : 4;
  if (version < 1 || version > 3) {
    return InvalidArgument("is of version {} of the npy format; 1 to 3 are read", version);
  }
  if (bytes.size() < kFixed + length_bytes) {
    return DataLoss("is cut short within its header");
  }
  const size_t length = LittleEndian(bytes.substr(kFixed, length_bytes));
  const size_t begin = kFixed + length_bytes;
  if (length > bytes.size() - begin) {
    return DataLoss("its header of {} bytes is longer than what is there", length);
  }
  const std::string_view dictionary = bytes.substr(begin, length);
  DenseHeader header;
  header.data_offset = static_cast<int64_t>(begin + length);
  FOVEA_ASSIGN_OR_RETURN(const std::string descr, ValueOf(dictionary, "descr"));
  FOVEA_RETURN_IF_ERROR(SetType(descr, &header));
  FOVEA_ASSIGN_OR_RETURN(const std::string order, ValueOf(dictionary, "fortran_order"));
  FOVEA_ASSIGN_OR_RETURN(const std::string shape_text, ValueOf(dictionary, "shape"));
  FOVEA_ASSIGN_OR_RETURN(const std::vector<int64_t> shape, ShapeOf(shape_text));
  FOVEA_ASSIGN_OR_RETURN(const std::vector<AxisRole> roles, RolesOf(axes, shape.size()));
  for (size_t i = 0; i < shape.size(); ++i) {
    header.axes.push_back({roles[i], shape[i]});
  }
  if (order != "True") {  // in C order the last axis is the fastest
    std::reverse(header.axes.begin(), header.axes.end());
  }
  header.index_to_world = SpacingMatrix({1, 1, 1});
  FOVEA_RETURN_IF_ERROR(CheckDenseHeader(header));
  return header;
}

}  // namespace fovea::ingest
