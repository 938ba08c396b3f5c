#include "engine/store/stored_type.h"

#include <cmath>
#include <cstring>
#include <limits>

namespace fovea::store {
namespace {

constexpr const char* kFloat = "float32";
constexpr const char* kShort = "int16";
constexpr const char* kLong = "int32";

template <typename T>
Status Pack(std::span<const float> values, std::vector<std::byte>* bytes) {
  constexpr float kMost = sizeof(T) == 2 ? std::numeric_limits<int16_t>::max() : kMostInteger;
  bytes->resize(values.size() * sizeof(T));
  auto* to = bytes->data();
  for (const float value : values) {
    if (!(std::fabs(value) <= kMost) || value != std::trunc(value)) {
      return InvalidArgument("the coefficient {} is not a whole number that int{} can hold", value,
                             8 * sizeof(T));
    }
    const T whole = static_cast<T>(value);
    std::memcpy(to, &whole, sizeof(T));
    to += sizeof(T);
  }
  return absl::OkStatus();
}

template <typename T>
void Unpack(std::span<const std::byte> stored, std::span<float> values) {
  const std::byte* from = stored.data();
  for (float& value : values) {
    T whole;
    std::memcpy(&whole, from, sizeof(T));
    value = static_cast<float>(whole);
    from += sizeof(T);
  }
}

}  // namespace

Status CheckStoredType(const std::string& type, Wavelet wavelet) {
  if (type != kFloat && type != kShort && type != kLong) {
    return InvalidArgument("type '{}': it must be float32, int16 or int32", type.substr(0, 100));
  }
  if (IsIntegerType(type) && wavelet == Wavelet::kCdf97) {
    return InvalidArgument("type {}: there is no reversible integer form of cdf97", type);
  }
  return absl::OkStatus();
}

bool IsIntegerType(const std::string& type) {
  return type != kFloat;
}

int64_t BytesOfType(const std::string& type) {
  return type == kShort ? 2 : 4;
}

StatusOr<std::vector<std::byte>> ToStored(std::span<const float> values, const std::string& type) {
  std::vector<std::byte> bytes;
  if (type == kShort) {
    FOVEA_RETURN_IF_ERROR(Pack<int16_t>(values, &bytes));
    return bytes;
  }
  if (type == kLong) {
    FOVEA_RETURN_IF_ERROR(Pack<int32_t>(values, &bytes));
    return bytes;
  }
  for (const float value : values) {
    if (!std::isfinite(value)) {
      return InvalidArgument("a coefficient is not finite");
    }
  }
  const std::span<const std::byte> raw = std::as_bytes(values);
  bytes.assign(raw.begin(), raw.end());
  return bytes;
}

void FromStored(std::span<const std::byte> stored, const std::string& type,
                std::span<float> values) {
  if (type == kShort) {
    Unpack<int16_t>(stored, values);
  } else if (type == kLong) {
    Unpack<int32_t>(stored, values);
  } else {
    std::memcpy(values.data(), stored.data(), stored.size());
  }
}

}  // namespace fovea::store
