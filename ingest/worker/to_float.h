#ifndef INGEST_WORKER_TO_FLOAT_H_
#define INGEST_WORKER_TO_FLOAT_H_

#include <cmath>
#include <cstdint>
#include <limits>
#include <type_traits>

namespace fovea::ingest {

/// `value` as float32; counts it in `rounded` if float32 does not hold it exactly. A double beyond
/// the range of float32 becomes infinite (and is not counted here).
template <typename T>
float ToFloat(T value, uint64_t* rounded) {
  if constexpr (std::is_same_v<T, double>) {
    if (!(std::abs(value) <= std::numeric_limits<float>::max())) {
      return std::isnan(value) ? std::numeric_limits<float>::quiet_NaN()
                               : std::copysign(std::numeric_limits<float>::infinity(),
                                               static_cast<float>(value > 0 ? 1 : -1));
    }
  }
  const auto result = static_cast<float>(value);
  if constexpr (sizeof(T) >= 4 && !std::is_same_v<T, float>) {
    // Both as double, or for 64-bit integers as long double, which hold every value exactly.
    using Exact = std::conditional_t<sizeof(T) == 8 && std::is_integral_v<T>, long double, double>;
    *rounded += static_cast<Exact>(result) != static_cast<Exact>(value) ? 1 : 0;
  }
  return result;
}

}  // namespace fovea::ingest

#endif  // INGEST_WORKER_TO_FLOAT_H_
