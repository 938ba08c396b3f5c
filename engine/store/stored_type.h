#ifndef ENGINE_STORE_STORED_TYPE_H_
#define ENGINE_STORE_STORED_TYPE_H_

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "engine/base/status.h"
#include "engine/volume/basis.h"

/// The types that coefficients are stored as: float32, or int16 and int32, times a scale. In memory
/// all are floats, which hold those whole numbers exactly that transforms of 8 and 16 bits make.
namespace fovea::store {

/// How values are stored: value = number of this type * scale. The scale of float32 is 1.
struct Coding {
  std::string type = "float32";
  float scale = 1;
  bool is_folded = false;  // files hold whole numbers as FoldSigns makes them
};

/// INVALID_ARGUMENT, naming the types, unless `type` is one of them.
[[nodiscard]] Status CheckStoredType(const std::string& type);
[[nodiscard]] bool IsIntegerType(const std::string& type);
[[nodiscard]] int64_t BytesOfType(const std::string& type);
/// The largest whole number that may be stored as this integer type.
[[nodiscard]] int32_t MostOfType(const std::string& type);

/// The largest |value|; not finite if one of them is not.
[[nodiscard]] float LargestMagnitude(std::span<const float> values);

/// Fills `stored` with the little-endian values of a known type, values.size() of them.
/// INVALID_ARGUMENT if a value is not finite or, of an integer type, not a whole number in its
/// range times the scale.
[[nodiscard]] Status ToStored(std::span<const float> values, const Coding& coding,
                              std::span<std::byte> stored);
/// The reverse.
void FromStored(std::span<const std::byte> stored, const Coding& coding, std::span<float> values);
/// Numbers of an integer type with the sign in the lowest bit: v >= 0 becomes the unsigned 2 v, all
/// others -2 v - 1, so that bits above those of the largest magnitude are zeros. `folded` is as
/// long as `stored`, and may be the same.
void FoldSigns(std::span<const std::byte> stored, const std::string& type,
               std::span<std::byte> folded);
/// The reverse, in place.
void UnfoldSigns(const std::string& type, std::span<std::byte> folded);
/// Makes every value the nearest one that an integer type can store. OUT_OF_RANGE if one of them
/// is more than it holds.
[[nodiscard]] Status RoundToStored(const Coding& coding, std::span<float> values);

}  // namespace fovea::store

#endif  // ENGINE_STORE_STORED_TYPE_H_
