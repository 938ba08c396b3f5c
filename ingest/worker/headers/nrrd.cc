#include "ingest/worker/headers/nrrd.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "ingest/worker/headers/text.h"

namespace fovea::ingest {
namespace {

constexpr size_t kMaxAxes = 16;  // of the format
constexpr size_t kMaxDataFiles = 65536;

constexpr std::pair<std::string_view, SampleType> kTypes[] = {
    {"signed char", SampleType::kInt8},
    {"int8", SampleType::kInt8},
    {"int8_t", SampleType::kInt8},
    {"uchar", SampleType::kUint8},
    {"unsigned char", SampleType::kUint8},
    {"uint8", SampleType::kUint8},
    {"uint8_t", SampleType::kUint8},
    {"short", SampleType::kInt16},
    {"short int", SampleType::kInt16},
    {"signed short", SampleType::kInt16},
    {"signed short int", SampleType::kInt16},
    {"int16", SampleType::kInt16},
    {"int16_t", SampleType::kInt16},
    {"ushort", SampleType::kUint16},
    {"unsigned short", SampleType::kUint16},
    {"unsigned short int", SampleType::kUint16},
    {"uint16", SampleType::kUint16},
    {"uint16_t", SampleType::kUint16},
    {"int", SampleType::kInt32},
    {"signed int", SampleType::kInt32},
    {"int32", SampleType::kInt32},
    {"int32_t", SampleType::kInt32},
    {"uint", SampleType::kUint32},
    {"unsigned int", SampleType::kUint32},
    {"uint32", SampleType::kUint32},
    {"uint32_t", SampleType::kUint32},
    {"longlong", SampleType::kInt64},
    {"long long", SampleType::kInt64},
    {"long long int", SampleType::kInt64},
    {"signed long long", SampleType::kInt64},
    {"signed long long int", SampleType::kInt64},
    {"int64", SampleType::kInt64},
    {"int64_t", SampleType::kInt64},
    {"ulonglong", SampleType::kUint64},
    {"unsigned long long", SampleType::kUint64},
    {"unsigned long long int", SampleType::kUint64},
    {"uint64", SampleType::kUint64},
    {"uint64_t", SampleType::kUint64},
    {"float", SampleType::kFloat32},
    {"double", SampleType::kFloat64},
};

/// "no" of `"mm" "mm" "no"`: texts between quotes, or words.
std::vector<std::string> Quoted(std::string_view text) {
  std::vector<std::string> texts;
  if (text.find('"') == std::string_view::npos) {
    for (const std::string_view word : Words(text)) {
      texts.emplace_back(word);
    }
    return texts;
  }
  for (size_t open = text.find('"'); open != std::string_view::npos; open = text.find('"', open)) {
    const size_t close = text.find('"', open + 1);
    if (close == std::string_view::npos) {
      break;
    }
    texts.emplace_back(text.substr(open + 1, close - open - 1));
    open = close + 1;
  }
  return texts;
}

/// "(1,0,0)" or "none".
StatusOr<std::vector<std::optional<Vec3>>> Vectors(std::string_view text, int space) {
  std::vector<std::optional<Vec3>> vectors;
  for (text = Trimmed(text); !text.empty(); text = Trimmed(text)) {
    if (text.starts_with("none")) {
      vectors.emplace_back();
      text.remove_prefix(4);
      continue;
    }
    const size_t close = text.find(')');
    if (text.front() != '(' || close == std::string_view::npos) {
      return InvalidArgument("space directions or origin: '{}' is not a vector", Shown(text));
    }
    std::string inside(text.substr(1, close - 1));
    std::replace(inside.begin(), inside.end(), ',', ' ');
    FOVEA_ASSIGN_OR_RETURN(const std::vector<double> numbers, RealsOf(inside, "space vector"));
    if (numbers.size() != static_cast<size_t>(space)) {
      return InvalidArgument("a vector of {} numbers in a space of {}", numbers.size(), space);
    }
    Vec3 vector;
    for (int axis = 0; axis < space; ++axis) {
      vector[axis] = numbers[static_cast<size_t>(axis)];
    }
    vectors.emplace_back(vector);
    text.remove_prefix(close + 1);
  }
  return vectors;
}

/// How many dimensions a named space has; 0: not known.
int DimensionOfSpace(const std::string& name) {
  const std::string lower = Lowered(name);
  for (const char* known :
       {"right-anterior-superior", "ras", "left-anterior-superior", "las",
        "left-posterior-superior", "lps", "scanner-xyz", "3d-right-handed", "3d-left-handed"}) {
    if (lower == known) {
      return 3;
    }
  }
  return 0;  // those with time at the end have 4, which no spatial vector of ours has
}

class Parser {
 public:
  explicit Parser(std::string_view bytes) : rest_(bytes), whole_(bytes.size()) {}

  StatusOr<DenseHeader> Run() {
    FOVEA_RETURN_IF_ERROR(ReadFields());
    FOVEA_RETURN_IF_ERROR(ReadShape());
    FOVEA_RETURN_IF_ERROR(ReadLayout());
    FOVEA_RETURN_IF_ERROR(Place());
    SetUnits();
    FOVEA_RETURN_IF_ERROR(ReadDataFiles());
    FOVEA_RETURN_IF_ERROR(CheckDenseHeader(header_));
    return std::move(header_);
  }

 private:
  Status ReadFields();
  Status ReadShape();
  Status SetRoles();
  Status ReadLayout();
  Status Place();
  Status PlaceByDirections(const std::string& directions);
  Status PlaceBySpacings();
  Status SetTimes(size_t axis);
  void SetUnits();
  Status ReadDataFiles();

  [[nodiscard]] std::string Field(const char* name, const char* other = "") const {
    const auto found = fields_.contains(name) ? fields_.find(name) : fields_.find(other);
    return found == fields_.end() ? std::string() : found->second;
  }
  /// One number for each axis, NaN where none is said.
  [[nodiscard]] StatusOr<std::vector<double>> PerAxis(const char* name,
                                                      const char* other = "") const;

  std::string_view rest_;
  size_t whole_;
  std::map<std::string, std::string> fields_;
  std::vector<std::string> listed_;  // of "data file: LIST"
  std::vector<std::optional<Vec3>> directions_;
  DenseHeader header_;
};

Status Parser::ReadFields() {
  bool ended = false;
  const std::string_view magic = TakeLine(&rest_, &ended);
  if (!magic.starts_with("NRRD000") || magic.size() != 8 || magic[7] < '1' || magic[7] > '5') {
    return InvalidArgument("is not an NRRD file of version 1 to 5");
  }
  while (!rest_.empty()) {
    const std::string_view line = TakeLine(&rest_, &ended);
    if (line.empty()) {
      header_.data_offset = static_cast<int64_t>(whole_ - rest_.size());
      return absl::OkStatus();
    }
    if (line.front() == '#') {
      continue;
    }
    const size_t colon = line.find(':');
    if (colon == std::string_view::npos) {
      return InvalidArgument("header line '{}' has no colon", Shown(line));
    }
    if (line.substr(colon, 2) == ":=") {
      continue;  // a key of somebody's own
    }
    const std::string name = Lowered(Trimmed(line.substr(0, colon)));
    fields_[name] = std::string(Trimmed(line.substr(colon + 1)));
    if ((name == "data file" || name == "datafile") && fields_[name].starts_with("LIST")) {
      for (; !rest_.empty() && listed_.size() <= kMaxDataFiles;) {
        const std::string_view file = Trimmed(TakeLine(&rest_, &ended));
        if (!file.empty()) {
          listed_.emplace_back(file);
        }
      }
      return absl::OkStatus();
    }
  }
  if (Field("data file", "datafile").empty()) {
    return DataLoss("its header does not end (an empty line) within {} bytes: it is cut short",
                    whole_);
  }
  return absl::OkStatus();
}

Status Parser::ReadShape() {
  FOVEA_ASSIGN_OR_RETURN(const int64_t dimension, IntegerOf(Field("dimension"), "dimension"));
  FOVEA_ASSIGN_OR_RETURN(const std::vector<int64_t> sizes, IntegersOf(Field("sizes"), "sizes"));
  if (dimension < 1 || dimension > static_cast<int64_t>(kMaxAxes) ||
      sizes.size() != static_cast<size_t>(dimension)) {
    return InvalidArgument("dimension {} with {} sizes", dimension, sizes.size());
  }
  for (const int64_t size : sizes) {
    header_.axes.push_back({AxisRole::kX, size});
  }
  const std::string type = Lowered(Field("type"));
  for (const auto& [name, known] : kTypes) {
    if (name == type) {
      header_.type = known;
      return SetRoles();
    }
  }
  return InvalidArgument("values of type '{}': only integers and floats can be read", Shown(type));
}

/// Which axis is what: by its kind, then by whether it has a direction, then by its place.
Status Parser::SetRoles() {
  const std::string space_text = Field("space dimension");
  int space = DimensionOfSpace(Field("space"));
  if (!space_text.empty()) {
    FOVEA_ASSIGN_OR_RETURN(const int64_t said, IntegerOf(space_text, "space dimension"));
    space = said >= 1 && said <= 3 ? static_cast<int>(said) : 0;
  }
  if (const std::string text = Field("space directions"); !text.empty()) {
    if (space == 0) {
      return InvalidArgument("space directions in space '{}', which has no 1 to 3 dimensions",
                             Shown(Field("space")));
    }
    FOVEA_ASSIGN_OR_RETURN(directions_, Vectors(text, space));
    if (directions_.size() != header_.axes.size()) {
      return InvalidArgument("{} space directions for {} axes", directions_.size(),
                             header_.axes.size());
    }
  }
  const std::vector<std::string> kinds = Quoted(Lowered(Field("kinds")));
  std::vector<size_t> open;  // axes that may be spatial
  for (size_t i = 0; i < header_.axes.size(); ++i) {
    const std::string kind = i < kinds.size() ? kinds[i] : "";
    const bool has_direction = i < directions_.size() && directions_[i].has_value();
    const bool is_channel = kind.find("vector") != std::string::npos ||
                            kind.find("color") != std::string::npos ||
                            kind.find("matrix") != std::string::npos || kind == "complex" ||
                            kind == "quaternion" || kind == "point" || kind == "normal";
    if (has_direction || kind == "domain" || kind == "space") {
      open.push_back(i);
    } else if (is_channel) {
      header_.axes[i].role = AxisRole::kChannel;
    } else if (kind == "time" || kind == "list" || !directions_.empty()) {
      header_.axes[i].role = AxisRole::kStep;
    } else {
      open.push_back(i);
    }
  }
  for (size_t i = 0; i < open.size(); ++i) {
    if (i > 3) {
      return InvalidArgument("{} axes: three of space, one of time and one of channels can be",
                             header_.axes.size());
    }
    header_.axes[open[i]].role = static_cast<AxisRole>(i);  // x, y, z, then steps
  }
  return absl::OkStatus();
}

Status Parser::ReadLayout() {
  const std::string endian = Lowered(Field("endian"));
  if (BytesOf(header_.type) > 1 && endian != "little" && endian != "big") {
    return InvalidArgument("endian '{}': little or big is needed", Shown(endian));
  }
  header_.big_endian = endian == "big";
  const std::string encoding = Lowered(Field("encoding"));
  if (encoding == "gzip" || encoding == "gz") {
    header_.encoding = DataEncoding::kDeflate;
  } else if (encoding != "raw") {
    return InvalidArgument(
        "encoding '{}': only raw and gzip are read; save it again so (unu save "
        "-f nrrd -e gzip)",
        Shown(encoding));
  }
  for (const auto& [name, other, value] :
       {std::tuple{"line skip", "lineskip", &header_.skip_lines},
        std::tuple{"byte skip", "byteskip", &header_.skip_bytes}}) {
    if (const std::string text = Field(name, other); !text.empty()) {
      FOVEA_ASSIGN_OR_RETURN(*value, IntegerOf(text, name));
    }
  }
  if (header_.skip_bytes == -1) {
    if (header_.encoding != DataEncoding::kPlain) {
      return InvalidArgument("byte skip -1 is for the encoding raw only");
    }
    header_.skip_bytes = 0;
    header_.at_end = true;
  }
  return absl::OkStatus();
}

StatusOr<std::vector<double>> Parser::PerAxis(const char* name, const char* other) const {
  const std::string text = Field(name, other);
  std::vector<double> numbers(header_.axes.size(), std::nan(""));
  if (text.empty()) {
    return numbers;
  }
  FOVEA_ASSIGN_OR_RETURN(const std::vector<double> said, RealsOf(text, name));
  if (said.size() != numbers.size()) {
    return InvalidArgument("{}: {} numbers for {} axes", name, said.size(), numbers.size());
  }
  return said;
}

Status Parser::Place() {
  for (size_t i = 0; i < header_.axes.size(); ++i) {
    if (header_.axes[i].role == AxisRole::kStep) {
      FOVEA_RETURN_IF_ERROR(SetTimes(i));
    }
  }
  return directions_.empty() ? PlaceBySpacings() : PlaceByDirections(Field("space origin"));
}

Status Parser::PlaceByDirections(const std::string& origin) {
  auto& m = header_.index_to_world.m;
  int space = 0;
  for (size_t i = 0; i < directions_.size(); ++i) {
    const auto column = static_cast<size_t>(header_.axes[i].role);
    if (directions_[i] && column < 3) {
      for (size_t row = 0; row < 3; ++row) {
        m[4 * row + column] = (*directions_[i])[static_cast<int>(row)];
      }
    }
  }
  // A plane in space: the axis that it lacks stands upright on it.
  if (header_.StrideOf(AxisRole::kZ) == 0 && header_.StrideOf(AxisRole::kY) != 0) {
    const Vec3 up = Cross({m[0], m[4], m[8]}, {m[1], m[5], m[9]});
    const double length = Length(up);
    for (int row = 0; length > 0 && row < 3; ++row) {
      m[static_cast<size_t>(4 * row + 2)] = up[row] / length;
    }
  }
  if (!origin.empty()) {
    space = static_cast<int>(std::count(origin.begin(), origin.end(), ',')) + 1;
    if (space > 3) {
      return InvalidArgument("space origin '{}' has more than 3 numbers", Shown(origin));
    }
    FOVEA_ASSIGN_OR_RETURN(const auto vectors, Vectors(origin, space));
    if (vectors.size() != 1 || !vectors[0]) {
      return InvalidArgument("space origin '{}' is not a vector", Shown(origin));
    }
    for (int row = 0; row < 3; ++row) {
      m[static_cast<size_t>(4 * row + 3)] = (*vectors[0])[row];
    }
  }
  return absl::OkStatus();
}

/// Without directions: the axes are those of the world. Axis mins are of centres of voxels that
/// are nodes, and of the faces of cells, which voxels are unless it is said (as teem does).
Status Parser::PlaceBySpacings() {
  FOVEA_ASSIGN_OR_RETURN(const auto spacings, PerAxis("spacings"));
  FOVEA_ASSIGN_OR_RETURN(const auto mins, PerAxis("axis mins", "axismins"));
  std::vector<std::string> centers = Quoted(Lowered(Field("centers", "centerings")));
  centers.resize(header_.axes.size());
  for (size_t i = 0; i < header_.axes.size(); ++i) {
    const auto column = static_cast<size_t>(header_.axes[i].role);
    if (column > 2) {
      continue;
    }
    const double spacing = std::isnan(spacings[i]) ? 1 : spacings[i];
    const double face = std::isnan(mins[i])    ? 0
                        : centers[i] == "node" ? mins[i] - spacing / 2
                                               : mins[i];
    header_.index_to_world.m[5 * column] = spacing;
    header_.index_to_world.m[4 * column + 3] = face + spacing / 2;
  }
  for (const AxisRole role : {AxisRole::kX, AxisRole::kY, AxisRole::kZ}) {
    if (header_.StrideOf(role) == 0) {
      header_.index_to_world.m[4 * static_cast<size_t>(role) + 3] = 0.5;
    }
  }
  return absl::OkStatus();
}

Status Parser::SetTimes(size_t axis) {
  FOVEA_ASSIGN_OR_RETURN(const auto spacings, PerAxis("spacings"));
  FOVEA_ASSIGN_OR_RETURN(const auto mins, PerAxis("axis mins", "axismins"));
  const std::vector<std::string> units = Quoted(Field("units"));
  const double scale = SecondsOf(axis < units.size() ? units[axis] : "").value_or(1);
  const double first = std::isnan(mins[axis]) ? 0 : mins[axis];
  header_.times_s = RegularTimes(first * scale, spacings[axis] * scale, header_.axes[axis].size);
  return absl::OkStatus();
}

void Parser::SetUnits() {
  header_.value_unit = Quoted(Field("sample units", "sampleunits")).empty()
                           ? ""
                           : Quoted(Field("sample units", "sampleunits")).front();
  std::vector<std::string> of_space = Quoted(Field("space units"));
  if (of_space.empty()) {
    const std::vector<std::string> units = Quoted(Field("units"));
    for (size_t i = 0; i < units.size() && i < header_.axes.size(); ++i) {
      if (header_.axes[i].role <= AxisRole::kZ) {
        of_space.push_back(units[i]);
      }
    }
  }
  const auto differs = [&](const std::string& unit) { return unit != of_space.front(); };
  if (!of_space.empty() && std::none_of(of_space.begin(), of_space.end(), differs) &&
      of_space.front() != "none" && of_space.front() != "???") {
    header_.world_unit = of_space.front();
  }
}

Status Parser::ReadDataFiles() {
  const std::string text = Field("data file", "datafile");
  if (text.empty()) {
    return absl::OkStatus();  // data follow the header
  }
  header_.data_offset = 0;
  if (text.starts_with("LIST")) {
    header_.data_files = listed_;
  } else if (text.find('%') != std::string::npos) {
    std::vector<std::string_view> words = Words(text);
    if (words.size() < 4 || words.size() > 5) {
      return InvalidArgument("data file '{}': a pattern needs its first, last and step",
                             Shown(text));
    }
    FOVEA_ASSIGN_OR_RETURN(const int64_t first, IntegerOf(words[1], "first data file"));
    FOVEA_ASSIGN_OR_RETURN(const int64_t last, IntegerOf(words[2], "last data file"));
    FOVEA_ASSIGN_OR_RETURN(const int64_t step, IntegerOf(words[3], "step of data files"));
    FOVEA_ASSIGN_OR_RETURN(header_.data_files, NumberedNames(words[0], first, last, step));
  } else {
    header_.data_files = {text};
  }
  if (header_.data_files.empty() || header_.data_files.size() > kMaxDataFiles) {
    return InvalidArgument("{} data files: 1 to {} can be", header_.data_files.size(),
                           kMaxDataFiles);
  }
  return absl::OkStatus();
}

}  // namespace

StatusOr<DenseHeader> ParseNrrd(std::string_view bytes) {
  return Parser(bytes).Run();
}

}  // namespace fovea::ingest
