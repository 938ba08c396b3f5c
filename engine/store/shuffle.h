#ifndef ENGINE_STORE_SHUFFLE_H_
#define ENGINE_STORE_SHUFFLE_H_

#include <cstddef>
#include <cstdint>

/// The filters of Blosc, which put like bytes, or like bits, of values side by side, and back.
/// Compiled for every instruction set and chosen at run time; all give the same bytes. What is
/// written must not overlap what is read, and has as many bytes: `count` values of `type_bytes`,
/// which is 1, 2 or 4.
namespace fovea::store {

/// The first bytes of all values, then the second ...
void ShuffleBytes(const std::byte* values, size_t count, int type_bytes, std::byte* planes);
void UnshuffleBytes(const std::byte* planes, size_t count, int type_bytes, std::byte* values);

/// From the lowest bits of all values, eight in a byte, the first in its lowest bit; then the
/// second lowest ... `count` must be a multiple of 8. `scratch` is as large as the values.
void UnshuffleBits(const std::byte* planes, size_t count, int type_bytes, std::byte* scratch,
                   std::byte* values);

}  // namespace fovea::store

#endif  // ENGINE_STORE_SHUFFLE_H_
