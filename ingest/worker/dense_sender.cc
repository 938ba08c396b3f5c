#include "ingest/worker/dense_sender.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#include <vector>

#include "ingest/protocol.h"
#include "ingest/slab_ring.h"
#include "ingest/worker/slab_sender.h"
#include "ingest/worker/to_float.h"

namespace fovea::ingest {
namespace {

/// Of a slab, if a row is no longer: so little memory is new, and all of it stays in the caches.
constexpr int64_t kBytesAtOnce = 512 << 10;

/// IEEE 754 binary16, as its bits.
struct Half {
  uint16_t bits = 0;
};

float Widened(Half half) {
  const uint32_t sign = static_cast<uint32_t>(half.bits & 0x8000) << 16;
  const uint32_t exponent = (half.bits >> 10) & 0x1F;
  const uint32_t fraction = half.bits & 0x3FF;
  if (exponent == 0) {  // zero and the subnormals: fraction x 2^-24
    const float magnitude = static_cast<float>(fraction) * 0x1p-24F;
    return sign != 0 ? -magnitude : magnitude;
  }
  const uint32_t wide = exponent == 31 ? 255 : exponent + 112;
  return std::bit_cast<float>(sign | wide << 23 | fraction << 13);
}
template <typename T>
T Widened(T sample) {
  return sample;
}

/// Samples in the order of this machine to float32; returns how many float32 does not hold exactly.
/// What a slope makes is rounded anyway.
template <typename T>
uint64_t Convert(std::span<const std::byte> bytes, const DenseFormat& format, std::byte* to) {
  uint64_t rounded = 0;
  for (size_t i = 0; i + sizeof(T) <= bytes.size(); i += sizeof(T), to += sizeof(float)) {
    T raw;
    std::memcpy(&raw, bytes.data() + i, sizeof(T));
    const auto sample = Widened(raw);
    float value = 0;
    if (format.IsIdentity()) {
      value = ToFloat(sample, &rounded);
    } else {
      uint64_t ignored = 0;
      value = ToFloat(static_cast<double>(sample) * format.slope + format.intercept, &ignored);
    }
    std::memcpy(to, &value, sizeof(float));
  }
  return rounded;
}

using Converter = uint64_t (*)(std::span<const std::byte>, const DenseFormat&, std::byte*);

Converter ConverterOf(SampleType type) {
  switch (type) {
    case SampleType::kUint8:
      return Convert<uint8_t>;
    case SampleType::kInt8:
      return Convert<int8_t>;
    case SampleType::kUint16:
      return Convert<uint16_t>;
    case SampleType::kInt16:
      return Convert<int16_t>;
    case SampleType::kUint32:
      return Convert<uint32_t>;
    case SampleType::kInt32:
      return Convert<int32_t>;
    case SampleType::kUint64:
      return Convert<uint64_t>;
    case SampleType::kInt64:
      return Convert<int64_t>;
    case SampleType::kFloat16:
      return Convert<Half>;
    case SampleType::kFloat32:
      return Convert<float>;
    case SampleType::kFloat64:
      return Convert<double>;
  }
  return nullptr;
}

/// How a step travels: as it is in the file, or converted to float32.
struct Travel {
  DenseType type = DenseType::kFloat32;
  bool as_it_is = false;
};

Travel TravelOf(const DenseFormat& format) {
  if (!format.IsIdentity()) {
    return {};
  }
  switch (format.type) {
    case SampleType::kUint8:
      return {DenseType::kUint8, true};
    case SampleType::kInt8:
      return {DenseType::kInt8, true};
    case SampleType::kUint16:
      return {DenseType::kUint16, true};
    case SampleType::kInt16:
      return {DenseType::kInt16, true};
    case SampleType::kFloat32:
      return {DenseType::kFloat32, true};
    default:
      return {};
  }
}

/// This machine is little-endian (payload.h sees to it), so big-endian values are swapped.
void Swap(std::span<std::byte> bytes, size_t size) {
  for (size_t i = 0; i + size <= bytes.size(); i += size) {
    std::reverse(bytes.data() + i, bytes.data() + i + size);
  }
}

}  // namespace

Status SendDense(const DenseFormat& format, const Box3& extent, DenseSamples* samples,
                 Channel* channel) {
  const Int3& dims = format.dims;
  const Box3 box = Box3::OfSize(dims);
  if (!extent.Contains(box)) {
    return InvalidArgument("its {} x {} x {} voxels are not inside what is asked for", dims.x,
                           dims.y, dims.z);
  }
  const Travel travel = TravelOf(format);
  SlabSender sender(channel);
  FOVEA_RETURN_IF_ERROR(sender.Start({0, travel.type, box}));
  FieldEnd end{box, 0};
  const int64_t row_bytes = dims.x * BytesOf(format.type);
  const int64_t at_once = std::max<int64_t>(1, kBytesAtOnce / (dims.x * BytesOf(travel.type)));
  std::vector<std::byte> unconverted;
  for (int64_t left = dims.y * dims.z; left > 0;) {
    const int64_t rows = std::min(left, at_once);
    const auto bytes = static_cast<size_t>(rows * row_bytes);
    FOVEA_ASSIGN_OR_RETURN(const std::span<std::byte> slab, sender.Next());
    unconverted.resize(travel.as_it_is ? 0 : bytes);
    const std::span<std::byte> read = travel.as_it_is ? slab.first(bytes) : std::span(unconverted);
    FOVEA_RETURN_IF_ERROR(samples->ReadNext(read));
    if (format.big_endian) {
      Swap(read, static_cast<size_t>(BytesOf(format.type)));
    }
    if (!travel.as_it_is) {
      end.rounded += ConverterOf(format.type)(read, format, slab.data());
    }
    FOVEA_RETURN_IF_ERROR(sender.Send(rows));
    left -= rows;
  }
  return sender.Finish(end);
}

}  // namespace fovea::ingest
