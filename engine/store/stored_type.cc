#include "engine/store/stored_type.h"

#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/store/stored_type.cc"
#include <hwy/foreach_target.h>  // IWYU pragma: keep
// foreach_target.h must come first
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace fovea::store::internal::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

/// Calls body(d, i) for i in [0, count), d a tag of lanes of type T: in vectors as long as there
/// are, then singly.
template <typename T, typename Body>
HWY_INLINE void ForVectors(size_t count, const Body& body) {
  const hn::ScalableTag<T> d;
  const hn::CappedTag<T, 1> d1;
  size_t i = 0;
  for (const size_t n = hn::Lanes(d); i + n <= count; i += n) {
    body(d, i);
  }
  for (; i < count; ++i) {
    body(d1, i);
  }
}

/// The bits of |value| order like the values, and NaN behind infinity.
uint32_t LargestBitsKernel(const float* values, size_t count) {
  const hn::ScalableTag<int32_t> d;
  const size_t n = hn::Lanes(d);
  const auto* bits = reinterpret_cast<const int32_t*>(values);
  auto most = hn::Zero(d);
  size_t i = 0;
  for (; i + n <= count; i += n) {
    most = hn::Max(most, hn::And(hn::LoadU(d, bits + i), hn::Set(d, 0x7fffffff)));
  }
  int32_t largest = hn::GetLane(hn::MaxOfLanes(d, most));
  for (; i < count; ++i) {
    int32_t one;
    std::memcpy(&one, values + i, sizeof(one));
    largest = largest < (one & 0x7fffffff) ? one & 0x7fffffff : largest;
  }
  return static_cast<uint32_t>(largest);
}

/// False if a value is not a whole number up to `most` times the scale.
template <typename T>
HWY_INLINE bool Pack(const float* values, size_t count, float scale, float most, T* out) {
  bool fits = true;
  ForVectors<float>(count, [&](auto d, size_t i) HWY_ATTR {
    const hn::Rebind<T, decltype(d)> to;
    const auto v = hn::LoadU(d, values + i);
    const auto ratio = hn::Div(v, hn::Set(d, scale));
    const auto whole = hn::NearestInt(ratio);
    const auto back = hn::Mul(hn::ConvertTo(d, whole), hn::Set(d, scale));
    const auto good = hn::And(hn::Eq(back, v), hn::Le(hn::Abs(ratio), hn::Set(d, most)));
    fits = fits && hn::AllTrue(d, good);
    if constexpr (sizeof(T) == 2) {
      hn::StoreU(hn::DemoteTo(to, whole), to, out + i);
    } else {
      hn::StoreU(whole, to, out + i);
    }
  });
  return fits;
}

bool Pack16Kernel(const float* values, size_t count, float scale, float most, int16_t* out) {
  return Pack(values, count, scale, most, out);
}

bool Pack32Kernel(const float* values, size_t count, float scale, float most, int32_t* out) {
  return Pack(values, count, scale, most, out);
}

void Unpack16Kernel(const int16_t* stored, size_t count, float scale, float* values) {
  ForVectors<float>(count, [=](auto d, size_t i) HWY_ATTR {
    const hn::Rebind<int16_t, decltype(d)> from;
    const hn::Rebind<int32_t, decltype(d)> wide;
    const auto whole = hn::PromoteTo(wide, hn::LoadU(from, stored + i));
    hn::StoreU(hn::Mul(hn::ConvertTo(d, whole), hn::Set(d, scale)), d, values + i);
  });
}

void Unpack32Kernel(const int32_t* stored, size_t count, float scale, float* values) {
  ForVectors<float>(count, [=](auto d, size_t i) HWY_ATTR {
    const hn::Rebind<int32_t, decltype(d)> from;
    const auto whole = hn::LoadU(from, stored + i);
    hn::StoreU(hn::Mul(hn::ConvertTo(d, whole), hn::Set(d, scale)), d, values + i);
  });
}

template <typename T>
HWY_INLINE void Fold(const T* in, size_t count, T* out) {
  ForVectors<T>(count, [=](auto d, size_t i) HWY_ATTR {
    const auto v = hn::LoadU(d, in + i);
    hn::StoreU(hn::Xor(hn::Add(v, v), hn::ShiftRight<8 * sizeof(T) - 1>(v)), d, out + i);
  });
}

template <typename T>
HWY_INLINE void Unfold(size_t count, T* numbers) {
  ForVectors<T>(count, [=](auto d, size_t i) HWY_ATTR {
    const hn::RebindToUnsigned<decltype(d)> bits;
    const auto v = hn::LoadU(d, numbers + i);
    const auto magnitude = hn::BitCast(d, hn::ShiftRight<1>(hn::BitCast(bits, v)));
    hn::StoreU(hn::Xor(magnitude, hn::Neg(hn::And(v, hn::Set(d, 1)))), d, numbers + i);
  });
}

void Fold16Kernel(const int16_t* in, size_t count, int16_t* out) {
  Fold(in, count, out);
}
void Fold32Kernel(const int32_t* in, size_t count, int32_t* out) {
  Fold(in, count, out);
}
void Unfold16Kernel(size_t count, int16_t* numbers) {
  Unfold(count, numbers);
}
void Unfold32Kernel(size_t count, int32_t* numbers) {
  Unfold(count, numbers);
}

bool RoundKernel(size_t count, float scale, float most, float* values) {
  bool fits = true;
  ForVectors<float>(count, [&](auto d, size_t i) HWY_ATTR {
    const auto ratio = hn::Div(hn::LoadU(d, values + i), hn::Set(d, scale));
    fits = fits && hn::AllTrue(d, hn::Le(hn::Abs(ratio), hn::Set(d, most)));
    hn::StoreU(hn::Mul(hn::Round(ratio), hn::Set(d, scale)), d, values + i);
  });
  return fits;
}

}  // namespace fovea::store::internal::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace fovea::store {
namespace internal {

HWY_EXPORT(LargestBitsKernel);
HWY_EXPORT(Pack16Kernel);
HWY_EXPORT(Pack32Kernel);
HWY_EXPORT(Unpack16Kernel);
HWY_EXPORT(Unpack32Kernel);
HWY_EXPORT(RoundKernel);
HWY_EXPORT(Fold16Kernel);
HWY_EXPORT(Fold32Kernel);
HWY_EXPORT(Unfold16Kernel);
HWY_EXPORT(Unfold32Kernel);

}  // namespace internal
namespace {

constexpr const char* kFloat = "float32";
constexpr const char* kShort = "int16";
constexpr const char* kLong = "int32";

}  // namespace

Status CheckStoredType(const std::string& type) {
  if (type != kFloat && type != kShort && type != kLong) {
    return InvalidArgument("type '{}': it must be float32, int16 or int32", type.substr(0, 100));
  }
  return absl::OkStatus();
}

bool IsIntegerType(const std::string& type) {
  return type != kFloat;
}

int64_t BytesOfType(const std::string& type) {
  return type == kShort ? 2 : 4;
}

int32_t MostOfType(const std::string& type) {
  return type == kShort ? std::numeric_limits<int16_t>::max() : kMostInteger;
}

float LargestMagnitude(std::span<const float> values) {
  using namespace internal;
  return std::bit_cast<float>(
      HWY_DYNAMIC_DISPATCH(LargestBitsKernel)(values.data(), values.size()));
}

Status ToStored(std::span<const float> values, const Coding& coding, std::span<std::byte> stored) {
  using namespace internal;
  const std::string& type = coding.type;
  const float scale = coding.scale;
  const size_t count = values.size();
  if (type == kFloat) {
    if (!std::isfinite(LargestMagnitude(values))) {
      return InvalidArgument("a coefficient is not finite");
    }
    std::memcpy(stored.data(), values.data(), values.size_bytes());
    return absl::OkStatus();
  }
  const auto most = static_cast<float>(MostOfType(type));
  bool fits = false;
  if (type == kShort) {
    auto* out = reinterpret_cast<int16_t*>(stored.data());
    fits = HWY_DYNAMIC_DISPATCH(Pack16Kernel)(values.data(), count, scale, most, out);
  } else {
    auto* out = reinterpret_cast<int32_t*>(stored.data());
    fits = HWY_DYNAMIC_DISPATCH(Pack32Kernel)(values.data(), count, scale, most, out);
  }
  if (!fits) {
    return InvalidArgument("a coefficient is not a whole number that {} can hold, times {}", type,
                           scale);
  }
  return absl::OkStatus();
}

void FromStored(std::span<const std::byte> stored, const Coding& coding, std::span<float> values) {
  using namespace internal;
  const std::string& type = coding.type;
  const float scale = coding.scale;
  if (type == kShort) {
    const auto* from = reinterpret_cast<const int16_t*>(stored.data());
    HWY_DYNAMIC_DISPATCH(Unpack16Kernel)(from, values.size(), scale, values.data());
  } else if (type == kLong) {
    const auto* from = reinterpret_cast<const int32_t*>(stored.data());
    HWY_DYNAMIC_DISPATCH(Unpack32Kernel)(from, values.size(), scale, values.data());
  } else {
    std::memcpy(values.data(), stored.data(), stored.size());
  }
}

void FoldSigns(std::span<const std::byte> stored, const std::string& type,
               std::span<std::byte> folded) {
  using namespace internal;
  const size_t count = stored.size() / static_cast<size_t>(BytesOfType(type));
  if (type == kShort) {
    HWY_DYNAMIC_DISPATCH(Fold16Kernel)
    (reinterpret_cast<const int16_t*>(stored.data()), count,
     reinterpret_cast<int16_t*>(folded.data()));
  } else {
    HWY_DYNAMIC_DISPATCH(Fold32Kernel)
    (reinterpret_cast<const int32_t*>(stored.data()), count,
     reinterpret_cast<int32_t*>(folded.data()));
  }
}

void UnfoldSigns(const std::string& type, std::span<std::byte> folded) {
  using namespace internal;
  const size_t count = folded.size() / static_cast<size_t>(BytesOfType(type));
  if (type == kShort) {
    HWY_DYNAMIC_DISPATCH(Unfold16Kernel)(count, reinterpret_cast<int16_t*>(folded.data()));
  } else {
    HWY_DYNAMIC_DISPATCH(Unfold32Kernel)(count, reinterpret_cast<int32_t*>(folded.data()));
  }
}

Status RoundToStored(const Coding& coding, std::span<float> values) {
  using namespace internal;
  const auto most = static_cast<float>(MostOfType(coding.type));
  const float largest = LargestMagnitude(values);
  if (!HWY_DYNAMIC_DISPATCH(RoundKernel)(values.size(), coding.scale, most, values.data())) {
    return OutOfRange("a coefficient of {} is more than {} holds at a scale of {}", largest,
                      coding.type, coding.scale);
  }
  return absl::OkStatus();
}

}  // namespace fovea::store
#endif  // HWY_ONCE
