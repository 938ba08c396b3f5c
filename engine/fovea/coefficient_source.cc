#include "engine/fovea/coefficient_source.h"

#include <algorithm>

namespace fovea {

Status MemorySource::ReadCoarse(std::span<float> out) {
  if (out.size() != set_.coarse.values.size()) {
    return Internal("ReadCoarse into {} values, the coarse level has {}", out.size(),
                    set_.coarse.values.size());
  }
  std::copy(set_.coarse.values.begin(), set_.coarse.values.end(), out.begin());
  return absl::OkStatus();
}

Status MemorySource::ReadDetail(int level, const Box3& window, std::span<float> out) {
  set_.detail[level].CopyOut(window, out);
  return absl::OkStatus();
}

}  // namespace fovea
