#ifndef INGEST_SAMPLE_TYPE_H_
#define INGEST_SAMPLE_TYPE_H_

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace fovea::ingest {

/// How one sample of dense voxels lies in a file.
enum class SampleType : uint8_t {
  kUint8,
  kInt8,
  kUint16,
  kInt16,
  kUint32,
  kInt32,
  kUint64,
  kInt64,
  kFloat16,
  kFloat32,
  kFloat64,
};

[[nodiscard]] int64_t BytesOf(SampleType type);
/// "uint8" ... "float64".
[[nodiscard]] std::string_view NameOf(SampleType type);
/// The type of that name, if there is one.
[[nodiscard]] std::optional<SampleType> SampleTypeOf(std::string_view name);
/// All names, one blank between them.
[[nodiscard]] std::string ListSampleTypes();

}  // namespace fovea::ingest

#endif  // INGEST_SAMPLE_TYPE_H_
