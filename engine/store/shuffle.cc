#include "engine/store/shuffle.h"

#include <cstring>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/store/shuffle.cc"
#include <hwy/foreach_target.h>  // IWYU pragma: keep
// foreach_target.h must come first
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace fovea::store::internal::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

/// Eight planes of bits, `count` / 8 bytes each, to one plane of bytes.
void JoinBitsKernel(const uint8_t* bits, size_t count, uint8_t* bytes) {
  const hn::ScalableTag<uint8_t> d;
  const size_t n = hn::Lanes(d);
  const size_t plane = count / 8;
  size_t i = 0;
  for (; i + n <= count; i += n) {
    auto v = hn::Zero(d);
    for (size_t bit = 0; bit < 8; ++bit) {
      uint8_t mask[HWY_MAX_BYTES / 8 + 8] = {};  // at least 8 bytes are read
      std::memcpy(mask, bits + bit * plane + i / 8, n / 8);
      const auto is_set = hn::LoadMaskBits(d, mask);
      v = hn::Or(v, hn::IfThenElseZero(is_set, hn::Set(d, static_cast<uint8_t>(1U << bit))));
    }
    hn::StoreU(v, d, bytes + i);
  }
  for (; i < count; ++i) {
    unsigned value = 0;
    for (size_t bit = 0; bit < 8; ++bit) {
      value |= (unsigned{bits[bit * plane + i / 8]} >> (i % 8) & 1U) << bit;
    }
    bytes[i] = static_cast<uint8_t>(value);
  }
}

void Split2Kernel(const uint8_t* values, size_t count, uint8_t* planes) {
  const hn::ScalableTag<uint8_t> d;
  const size_t n = hn::Lanes(d);
  size_t i = 0;
  for (; i + n <= count; i += n) {
    hn::Vec<decltype(d)> low, high;
    hn::LoadInterleaved2(d, values + 2 * i, low, high);
    hn::StoreU(low, d, planes + i);
    hn::StoreU(high, d, planes + count + i);
  }
  for (; i < count; ++i) {
    planes[i] = values[2 * i];
    planes[count + i] = values[2 * i + 1];
  }
}

void Join2Kernel(const uint8_t* planes, size_t count, uint8_t* values) {
  const hn::ScalableTag<uint8_t> d;
  const size_t n = hn::Lanes(d);
  size_t i = 0;
  for (; i + n <= count; i += n) {
    hn::StoreInterleaved2(hn::LoadU(d, planes + i), hn::LoadU(d, planes + count + i), d,
                          values + 2 * i);
  }
  for (; i < count; ++i) {
    values[2 * i] = planes[i];
    values[2 * i + 1] = planes[count + i];
  }
}

void Split4Kernel(const uint8_t* values, size_t count, uint8_t* planes) {
  const hn::ScalableTag<uint8_t> d;
  const size_t n = hn::Lanes(d);
  size_t i = 0;
  for (; i + n <= count; i += n) {
    hn::Vec<decltype(d)> a, b, c, e;
    hn::LoadInterleaved4(d, values + 4 * i, a, b, c, e);
    hn::StoreU(a, d, planes + i);
    hn::StoreU(b, d, planes + count + i);
    hn::StoreU(c, d, planes + 2 * count + i);
    hn::StoreU(e, d, planes + 3 * count + i);
  }
  for (; i < count; ++i) {
    for (size_t k = 0; k < 4; ++k) {
      planes[k * count + i] = values[4 * i + k];
    }
  }
}

void Join4Kernel(const uint8_t* planes, size_t count, uint8_t* values) {
  const hn::ScalableTag<uint8_t> d;
  const size_t n = hn::Lanes(d);
  size_t i = 0;
  for (; i + n <= count; i += n) {
    hn::StoreInterleaved4(hn::LoadU(d, planes + i), hn::LoadU(d, planes + count + i),
                          hn::LoadU(d, planes + 2 * count + i),
                          hn::LoadU(d, planes + 3 * count + i), d, values + 4 * i);
  }
  for (; i < count; ++i) {
    for (size_t k = 0; k < 4; ++k) {
      values[4 * i + k] = planes[k * count + i];
    }
  }
}

}  // namespace fovea::store::internal::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace fovea::store {
namespace internal {

HWY_EXPORT(JoinBitsKernel);
HWY_EXPORT(Split2Kernel);
HWY_EXPORT(Join2Kernel);
HWY_EXPORT(Split4Kernel);
HWY_EXPORT(Join4Kernel);

namespace {

const uint8_t* In(const std::byte* bytes) {
  return reinterpret_cast<const uint8_t*>(bytes);
}
uint8_t* Out(std::byte* bytes) {
  return reinterpret_cast<uint8_t*>(bytes);
}

}  // namespace
}  // namespace internal

void ShuffleBytes(const std::byte* values, size_t count, int type_bytes, std::byte* planes) {
  using namespace internal;
  if (type_bytes == 2) {
    HWY_DYNAMIC_DISPATCH(Split2Kernel)(In(values), count, Out(planes));
  } else if (type_bytes == 4) {
    HWY_DYNAMIC_DISPATCH(Split4Kernel)(In(values), count, Out(planes));
  } else {
    std::memcpy(planes, values, count);
  }
}

void UnshuffleBytes(const std::byte* planes, size_t count, int type_bytes, std::byte* values) {
  using namespace internal;
  if (type_bytes == 2) {
    HWY_DYNAMIC_DISPATCH(Join2Kernel)(In(planes), count, Out(values));
  } else if (type_bytes == 4) {
    HWY_DYNAMIC_DISPATCH(Join4Kernel)(In(planes), count, Out(values));
  } else {
    std::memcpy(values, planes, count);
  }
}

void UnshuffleBits(const std::byte* planes, size_t count, int type_bytes, std::byte* scratch,
                   std::byte* values) {
  using namespace internal;
  for (size_t at = 0; at < count * static_cast<size_t>(type_bytes); at += count) {
    HWY_DYNAMIC_DISPATCH(JoinBitsKernel)(In(planes) + at, count, Out(scratch) + at);
  }
  UnshuffleBytes(scratch, count, type_bytes, values);
}

}  // namespace fovea::store
#endif  // HWY_ONCE
