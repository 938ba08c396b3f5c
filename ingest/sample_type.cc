#include "ingest/sample_type.h"

#include <array>

namespace fovea::ingest {
namespace {

struct Row {
  std::string_view name;
  int64_t bytes;
};

/// In the order of the enumeration.
constexpr std::array<Row, 11> kRows{{{"uint8", 1},
                                     {"int8", 1},
                                     {"uint16", 2},
                                     {"int16", 2},
                                     {"uint32", 4},
                                     {"int32", 4},
                                     {"uint64", 8},
                                     {"int64", 8},
                                     {"float16", 2},
                                     {"float32", 4},
                                     {"float64", 8}}};

const Row& RowOf(SampleType type) {
  return kRows[static_cast<size_t>(type)];
}

}  // namespace

int64_t BytesOf(SampleType type) {
  return RowOf(type).bytes;
}

std::string_view NameOf(SampleType type) {
  return RowOf(type).name;
}

std::optional<SampleType> SampleTypeOf(std::string_view name) {
  for (size_t i = 0; i < kRows.size(); ++i) {
    if (kRows[i].name == name) {
      return static_cast<SampleType>(i);
    }
  }
  return std::nullopt;
}

std::string ListSampleTypes() {
  std::string list;
  for (const Row& row : kRows) {
    list.append(list.empty() ? "" : " ").append(row.name);
  }
  return list;
}

}  // namespace fovea::ingest
