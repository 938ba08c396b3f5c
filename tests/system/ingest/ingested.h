#ifndef TESTS_SYSTEM_INGEST_INGESTED_H_
#define TESTS_SYSTEM_INGEST_INGESTED_H_

#include <cmath>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "engine/base/status.h"
#include "engine/fovea/reconstruct.h"
#include "engine/store/dataset.h"
#include "engine/volume/grid.h"
#include "ingest/ingest.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temporary_folder.h"

namespace fovea::testing {

/// All voxels of one field of one step of a store.
inline StatusOr<Grid> StoredVoxels(const std::string& store, int64_t step,
                                   const std::string& field) {
  FOVEA_ASSIGN_OR_RETURN(const auto dataset, store::Dataset::Open(store));
  FOVEA_ASSIGN_OR_RETURN(const auto source, dataset->OpenStep(step, field, store::OnDamage::kFail));
  return ExtractVoxels(*source, Box3::OfSize(dataset->info().hierarchy.dims()));
}

/// 4 units in the last place of the range of values.
inline double FourUlp(double range) {
  return 4 * range * std::ldexp(1.0, -23);
}

}  // namespace fovea::testing

#endif  // TESTS_SYSTEM_INGEST_INGESTED_H_
