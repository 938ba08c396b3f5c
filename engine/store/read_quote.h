#ifndef ENGINE_STORE_READ_QUOTE_H_
#define ENGINE_STORE_READ_QUOTE_H_

#include <string>

#include "engine/base/status.h"
#include "engine/fovea/retained_set.h"
#include "engine/store/dataset.h"
#include "engine/store/file_system.h"

namespace fovea::store {

/// What read_stats() of a freshly opened step will say once its coarse level and the windows of
/// `retained` were read, found out from the tables chunk_max_W and the indices of the shards: no
/// coefficient is read. In a store without damage exactly that. `dataset` must be a stored one.
/// Errors as Dataset::OpenStep and ReadDetail.
[[nodiscard]] StatusOr<ReadStats> QuoteRead(Dataset& dataset, int64_t step,
                                            const std::string& field, OnDamage on_damage,
                                            const RetainedSet& retained,
                                            FileSystem& files = RealFileSystem());

}  // namespace fovea::store

#endif  // ENGINE_STORE_READ_QUOTE_H_
