#ifndef SERVICE_EXPORT_NPY_H_
#define SERVICE_EXPORT_NPY_H_

#include <cstdint>
#include <string>
#include <vector>

namespace fovea::exports {

/// The header of a NumPy .npy file (version 1.0) of little-endian float32 in C order; the values
/// follow it. Its length is a multiple of 64.
[[nodiscard]] std::string NpyHeader(const std::vector<int64_t>& shape);

}  // namespace fovea::exports

#endif  // SERVICE_EXPORT_NPY_H_
