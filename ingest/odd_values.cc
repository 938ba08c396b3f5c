#include "ingest/odd_values.h"

#include <fmt/format.h>

namespace fovea::ingest {

OddValues::OddValues(const std::vector<std::string>& fields) {
  for (const std::string& name : fields) {
    fields_.push_back({name, {}, {}});
  }
}

void OddValues::Tally::Add(uint64_t count, const std::string& path) {
  if (values == 0 && count > 0) {
    first_path = path;
  }
  values += count;
}

void OddValues::Count(size_t field, const std::string& path, uint64_t nonfinite, uint64_t rounded) {
  fields_[field].nonfinite.Add(nonfinite, path);
  fields_[field].rounded.Add(rounded, path);
}

uint64_t OddValues::NonfiniteValues() const {
  uint64_t values = 0;
  for (const OfField& field : fields_) {
    values += field.nonfinite.values;
  }
  return values;
}

std::vector<std::string> OddValues::Warnings() const {
  std::vector<std::string> warnings;
  for (const OfField& field : fields_) {
    if (field.nonfinite.values > 0) {
      warnings.push_back(
          fmt::format("field '{}': {} NaN or infinite values became the background, first in '{}'",
                      field.name, field.nonfinite.values, field.nonfinite.first_path));
    }
    if (field.rounded.values > 0) {
      warnings.push_back(fmt::format(
          "field '{}': {} values are not exact in float32 and were rounded, first in '{}'",
          field.name, field.rounded.values, field.rounded.first_path));
    }
  }
  return warnings;
}

}  // namespace fovea::ingest
