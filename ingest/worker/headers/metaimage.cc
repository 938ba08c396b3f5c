#include "ingest/worker/headers/metaimage.h"

#include <map>
#include <string>
#include <utility>
#include <vector>

#include "ingest/worker/headers/text.h"

namespace fovea::ingest {
namespace {

constexpr size_t kMaxDataFiles = 65536;

constexpr std::pair<std::string_view, SampleType> kTypes[] = {
    {"MET_CHAR", SampleType::kInt8},       {"MET_UCHAR", SampleType::kUint8},
    {"MET_SHORT", SampleType::kInt16},     {"MET_USHORT", SampleType::kUint16},
    {"MET_INT", SampleType::kInt32},       {"MET_UINT", SampleType::kUint32},
    {"MET_LONG", SampleType::kInt32},      {"MET_ULONG", SampleType::kUint32},
    {"MET_LONG_LONG", SampleType::kInt64}, {"MET_ULONG_LONG", SampleType::kUint64},
    {"MET_FLOAT", SampleType::kFloat32},   {"MET_DOUBLE", SampleType::kFloat64},
};

bool IsTrue(const std::string& text) {
  return !text.empty() && (text.front() == 'T' || text.front() == 't' || text.front() == '1');
}

class Parser {
 public:
  explicit Parser(std::string_view bytes) : rest_(bytes), whole_(bytes.size()) {}

  StatusOr<DenseHeader> Run() {
    FOVEA_RETURN_IF_ERROR(ReadFields());
    FOVEA_RETURN_IF_ERROR(ReadShape());
    FOVEA_RETURN_IF_ERROR(Place());
    FOVEA_RETURN_IF_ERROR(ReadData());
    FOVEA_RETURN_IF_ERROR(CheckDenseHeader(header_));
    return std::move(header_);
  }

 private:
  Status ReadFields();
  Status ReadShape();
  Status Place();
  Status ReadData();
  Status ReadDataFiles();

  /// The first of these keys that is there.
  [[nodiscard]] std::string Field(std::initializer_list<const char*> names) const {
    for (const char* name : names) {
      if (const auto found = fields_.find(name); found != fields_.end()) {
        return found->second;
      }
    }
    return {};
  }
  /// `count` numbers of the first of these keys that is there, or `otherwise`.
  [[nodiscard]] StatusOr<std::vector<double>> Numbers(std::initializer_list<const char*> names,
                                                      std::vector<double> otherwise) const;

  std::string_view rest_;
  size_t whole_;
  std::map<std::string, std::string> fields_;
  size_t dimensions_ = 0;
  std::vector<std::string> listed_;
  DenseHeader header_;
};

Status Parser::ReadFields() {
  bool ended = false;
  while (!rest_.empty()) {
    const std::string_view line = TakeLine(&rest_, &ended);
    if (Trimmed(line).empty()) {
      continue;
    }
    const size_t equals = line.find('=');
    if (equals == std::string_view::npos) {
      return InvalidArgument("header line '{}' has no '=': it is not a MetaImage", Shown(line));
    }
    const std::string name(Trimmed(line.substr(0, equals)));
    fields_[name] = std::string(Trimmed(line.substr(equals + 1)));
    if (name == "ElementDataFile") {
      header_.data_offset = static_cast<int64_t>(whole_ - rest_.size());
      while (fields_[name].starts_with("LIST") && !rest_.empty() &&
             listed_.size() <= kMaxDataFiles) {
        const std::string_view file = Trimmed(TakeLine(&rest_, &ended));
        if (!file.empty()) {
          listed_.emplace_back(file);
        }
      }
      return absl::OkStatus();
    }
  }
  return DataLoss(
      "its header has no ElementDataFile within {} bytes: it is cut short, or is not a "
      "MetaImage",
      whole_);
}

Status Parser::ReadShape() {
  if (const std::string kind = Field({"ObjectType"}); !kind.empty() && kind != "Image") {
    return InvalidArgument("ObjectType '{}': only Image can be read", Shown(kind));
  }
  FOVEA_ASSIGN_OR_RETURN(const int64_t dimensions, IntegerOf(Field({"NDims"}), "NDims"));
  FOVEA_ASSIGN_OR_RETURN(const std::vector<int64_t> sizes,
                         IntegersOf(Field({"DimSize"}), "DimSize"));
  if (dimensions < 1 || dimensions > 4 || sizes.size() != static_cast<size_t>(dimensions)) {
    return InvalidArgument("NDims {} with {} numbers in DimSize: 1 to 4 can be", dimensions,
                           sizes.size());
  }
  dimensions_ = sizes.size();
  if (const std::string text = Field({"ElementNumberOfChannels"}); !text.empty()) {
    FOVEA_ASSIGN_OR_RETURN(const int64_t channels, IntegerOf(text, "ElementNumberOfChannels"));
    if (channels != 1) {
      header_.axes.push_back({AxisRole::kChannel, channels});
    }
  }
  for (size_t i = 0; i < sizes.size(); ++i) {
    header_.axes.push_back({static_cast<AxisRole>(i), sizes[i]});
  }
  const std::string type = Field({"ElementType"});
  for (const auto& [name, known] : kTypes) {
    if (name == type) {
      header_.type = known;
      return absl::OkStatus();
    }
  }
  return InvalidArgument("ElementType '{}' is not known", Shown(type));
}

StatusOr<std::vector<double>> Parser::Numbers(std::initializer_list<const char*> names,
                                              std::vector<double> otherwise) const {
  const std::string text = Field(names);
  if (text.empty()) {
    return otherwise;
  }
  FOVEA_ASSIGN_OR_RETURN(std::vector<double> numbers, RealsOf(text, *names.begin()));
  if (numbers.size() != otherwise.size()) {
    return InvalidArgument("{}: {} numbers, not {}", *names.begin(), numbers.size(),
                           otherwise.size());
  }
  return numbers;
}

/// The centre of voxel i is at Offset + the sum of i_k x spacing_k x direction_k, and direction_k
/// is the k-th group of numbers in TransformMatrix.
Status Parser::Place() {
  const size_t n = dimensions_;
  std::vector<double> identity(n * n, 0);
  for (size_t i = 0; i < n; ++i) {
    identity[i * (n + 1)] = 1;
  }
  FOVEA_ASSIGN_OR_RETURN(const auto spacing,
                         Numbers({"ElementSpacing", "ElementSize"}, std::vector<double>(n, 1)));
  FOVEA_ASSIGN_OR_RETURN(const auto origin,
                         Numbers({"Offset", "Position", "Origin"}, std::vector<double>(n, 0)));
  FOVEA_ASSIGN_OR_RETURN(const auto directions,
                         Numbers({"TransformMatrix", "Rotation", "Orientation"}, identity));
  auto& m = header_.index_to_world.m;
  for (size_t row = 0; row < 3 && row < n; ++row) {
    for (size_t column = 0; column < 3 && column < n; ++column) {
      m[4 * row + column] = directions[column * n + row] * spacing[column];
    }
    m[4 * row + 3] = origin[row];
  }
  if (n == 4) {
    header_.times_s = RegularTimes(origin[3], spacing[3], header_.SizeOf(AxisRole::kStep));
  }
  header_.world_unit = Field({"DistanceUnits"});
  if (const std::string text = Field({"ElementToIntensityFunctionSlope"}); !text.empty()) {
    FOVEA_ASSIGN_OR_RETURN(header_.slope, RealOf(text, "ElementToIntensityFunctionSlope"));
  }
  if (const std::string text = Field({"ElementToIntensityFunctionOffset"}); !text.empty()) {
    FOVEA_ASSIGN_OR_RETURN(header_.intercept, RealOf(text, "ElementToIntensityFunctionOffset"));
  }
  return absl::OkStatus();
}

Status Parser::ReadData() {
  const std::string binary = Field({"BinaryData"});
  if (!binary.empty() && !IsTrue(binary)) {
    return InvalidArgument("BinaryData = False: values as text are not read; save it as binary");
  }
  header_.big_endian = IsTrue(Field({"BinaryDataByteOrderMSB", "ElementByteOrderMSB"}));
  if (IsTrue(Field({"CompressedData"}))) {
    header_.encoding = DataEncoding::kDeflate;
  }
  if (const std::string text = Field({"HeaderSize"}); !text.empty()) {
    FOVEA_ASSIGN_OR_RETURN(header_.skip_bytes, IntegerOf(text, "HeaderSize"));
    if (header_.skip_bytes == -1) {
      header_.skip_bytes = 0;
      header_.at_end = true;
    }
  }
  return ReadDataFiles();
}

Status Parser::ReadDataFiles() {
  const std::string text = Field({"ElementDataFile"});
  if (text == "LOCAL" || text == "Local" || text == "local") {
    header_.skip_bytes = 0;
    return absl::OkStatus();
  }
  header_.data_offset = 0;
  if (text.starts_with("LIST")) {
    header_.data_files = listed_;
  } else if (text.find('%') != std::string::npos) {
    const std::vector<std::string_view> words = Words(text);
    if (words.size() < 3 || words.size() > 4) {
      return InvalidArgument("ElementDataFile '{}': a pattern needs its first and last number",
                             Shown(text));
    }
    FOVEA_ASSIGN_OR_RETURN(const int64_t first, IntegerOf(words[1], "first data file"));
    FOVEA_ASSIGN_OR_RETURN(const int64_t last, IntegerOf(words[2], "last data file"));
    int64_t step = 1;
    if (words.size() == 4) {
      FOVEA_ASSIGN_OR_RETURN(step, IntegerOf(words[3], "step of data files"));
    }
    FOVEA_ASSIGN_OR_RETURN(header_.data_files, NumberedNames(words[0], first, last, step));
  } else if (!text.empty()) {
    header_.data_files = {text};
  }
  if (header_.data_files.empty() || header_.data_files.size() > kMaxDataFiles) {
    return InvalidArgument("{} data files: 1 to {} can be", header_.data_files.size(),
                           kMaxDataFiles);
  }
  return absl::OkStatus();
}

}  // namespace

StatusOr<DenseHeader> ParseMetaImage(std::string_view bytes) {
  return Parser(bytes).Run();
}

}  // namespace fovea::ingest
