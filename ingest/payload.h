#ifndef INGEST_PAYLOAD_H_
#define INGEST_PAYLOAD_H_

#include <bit>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>

#include "engine/volume/geometry.h"

namespace fovea::ingest {

static_assert(std::endian::native == std::endian::little, "frames are little-endian in memory");

/// Appends numbers and texts to a payload.
class PayloadWriter {
 public:
  template <typename T>
  PayloadWriter& Number(T value) {
    static_assert(std::is_arithmetic_v<T>);
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof(value));
    return *this;
  }
  PayloadWriter& Text(const std::string& text) {
    Number(static_cast<uint32_t>(text.size()));
    bytes_.append(text);
    return *this;
  }
  PayloadWriter& Box(const Box3& box) {
    for (const Int3& corner : {box.lo, box.hi}) {
      Number(corner.x).Number(corner.y).Number(corner.z);
    }
    return *this;
  }
  PayloadWriter& Floats(std::span<const float> values) {
    bytes_.append(reinterpret_cast<const char*>(values.data()), values.size_bytes());
    return *this;
  }
  [[nodiscard]] std::string Take() { return std::move(bytes_); }

 private:
  std::string bytes_;
};

/// Reads a payload that may be anything. What is not there reads as zero, and Complete() is false.
class PayloadReader {
 public:
  /// `payload` must outlive the reader.
  explicit PayloadReader(std::string_view payload) : rest_(payload) {}

  template <typename T>
  T Number() {
    static_assert(std::is_arithmetic_v<T>);
    T value{};
    if (Need(sizeof(T))) {
      std::memcpy(&value, rest_.data(), sizeof(T));
      rest_.remove_prefix(sizeof(T));
    }
    return value;
  }
  std::string Text() {
    const auto size = Number<uint32_t>();
    if (!Need(size)) {
      return {};
    }
    std::string text(rest_.substr(0, size));
    rest_.remove_prefix(size);
    return text;
  }
  Box3 Box() {
    Box3 box;
    for (Int3* corner : {&box.lo, &box.hi}) {
      corner->x = Number<int64_t>();
      corner->y = Number<int64_t>();
      corner->z = Number<int64_t>();
    }
    return box;
  }
  /// All that is left, as the bytes of floats; fails unless it is exactly `count` of them.
  std::string_view Floats(int64_t count) {
    if (failed_ || count < 0 || rest_.size() % sizeof(float) != 0 ||
        rest_.size() / sizeof(float) != static_cast<size_t>(count)) {
      failed_ = true;
      return {};
    }
    return std::exchange(rest_, {});
  }
  /// Whether all that was asked for was there, and nothing is left over.
  [[nodiscard]] bool Complete() const { return !failed_ && rest_.empty(); }
  /// Whether something that was asked for was not there.
  [[nodiscard]] bool failed() const { return failed_; }
  [[nodiscard]] size_t bytes_left() const { return rest_.size(); }

 private:
  bool Need(size_t bytes) {
    failed_ = failed_ || rest_.size() < bytes;
    return !failed_;
  }

  std::string_view rest_;
  bool failed_ = false;
};

}  // namespace fovea::ingest

#endif  // INGEST_PAYLOAD_H_
