#include <bit>
#include <cstring>
#include <utility>

#include "ingest/sensors/reading_text.h"

namespace fovea::ingest::internal {
namespace {

static_assert(std::endian::native == std::endian::little);

constexpr size_t kFloats = 5;
constexpr size_t kRecordBytes = kFloats * sizeof(float);

class RecordParser final : public ReadingParser {
 public:
  explicit RecordParser(std::string name) : name_(std::move(name)) {}

  StatusOr<size_t> Parse(std::string_view bytes, bool last, ReadingBlock* out) override {
    const size_t count = bytes.size() / kRecordBytes;
    if (last && bytes.size() % kRecordBytes != 0) {
      return InvalidArgument(
          "{} ends with {} bytes that are no whole record of {}: five float32, x, y, z, t, value",
          name_, bytes.size() % kRecordBytes, kRecordBytes);
    }
    out->readings.reserve(out->readings.size() + count);
    out->values.reserve(out->values.size() + count);
    for (size_t i = 0; i < count; ++i) {
      float record[kFloats];
      std::memcpy(record, bytes.data() + i * kRecordBytes, kRecordBytes);
      out->readings.push_back({record[0], record[1], record[2], record[3], 0});
      out->values.push_back(record[4]);
    }
    return count * kRecordBytes;
  }
  const std::vector<std::string>& value_names() const override { return names_; }

 private:
  std::string name_;
  std::vector<std::string> names_{"value"};
};

}  // namespace

std::unique_ptr<ReadingParser> MakeRecordParser(std::string name) {
  return std::make_unique<RecordParser>(std::move(name));
}

}  // namespace fovea::ingest::internal
