#ifndef ENGINE_STORE_STORED_TYPE_H_
#define ENGINE_STORE_STORED_TYPE_H_

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/volume/basis.h"

/// The types that coefficients are stored as: float32, or for reversible integer transforms int16
/// and int32. In memory all are floats, which hold those whole numbers exactly that transforms of 8
/// and 16 bits make.
namespace fovea::store {

/// INVALID_ARGUMENT, naming the types, unless `type` is one of them and `wavelet` can have it.
[[nodiscard]] Status CheckStoredType(const std::string& type, Wavelet wavelet);
/// Whether coefficients of a known type are of the reversible integer transform.
[[nodiscard]] bool IsIntegerType(const std::string& type);
[[nodiscard]] int64_t BytesOfType(const std::string& type);

/// Little-endian bytes of values of a known type. INVALID_ARGUMENT if a value is not finite or, of
/// an integer type, not a whole number in its range.
[[nodiscard]] StatusOr<std::vector<std::byte>> ToStored(std::span<const float> values,
                                                        const std::string& type);
/// The reverse; `stored` holds values.size() values.
void FromStored(std::span<const std::byte> stored, const std::string& type,
                std::span<float> values);

}  // namespace fovea::store

#endif  // ENGINE_STORE_STORED_TYPE_H_
