#ifndef SERVICE_WIRE_UPLOAD_SPEC_H_
#define SERVICE_WIRE_UPLOAD_SPEC_H_

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "engine/store/dataset.h"
#include "engine/volume/basis.h"
#include "engine/volume/geometry.h"

/// An uploaded step as plain structs (proto/fovea/v1/ingest.proto says what each field means).
namespace fovea::wire {

struct UploadSpec {
  enum class Type { kUint8, kInt8, kUint16, kInt16, kFloat32 };
  struct Field {
    std::string name;
    Type type = Type::kFloat32;
    std::string value_unit;
  };
  std::string dataset;
  int64_t step = 0;
  int64_t time_ns = 0;
  std::optional<int64_t> frame_number;
  Int3 dims;
  std::vector<Field> fields;
  std::optional<Matrix4> index_to_world;
  std::string world_unit;
  std::optional<Wavelet> wavelet;
  bool lossless = false;
  std::optional<int64_t> chunk_edge;
  std::optional<store::SourceInfo> source;
};

/// What became of it.
struct UploadAnswer {
  bool already = false;  // the step was there; nothing was taken
  int64_t committed_steps = 0;
  uint64_t nonfinite_values = 0;
};

}  // namespace fovea::wire

#endif  // SERVICE_WIRE_UPLOAD_SPEC_H_
