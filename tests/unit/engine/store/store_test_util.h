#ifndef TESTS_UNIT_ENGINE_STORE_STORE_TEST_UTIL_H_
#define TESTS_UNIT_ENGINE_STORE_STORE_TEST_UTIL_H_

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "engine/store/dataset.h"
#include "engine/store/dataset_writer.h"
#include "engine/volume/brick_grid.h"
#include "engine/volume/coefficient_set.h"
#include "engine/volume/geometry.h"

namespace fovea::store::testing {

/// A folder of its own for one test, removed with its contents.
class TemporaryFolder {
 public:
  TemporaryFolder();
  ~TemporaryFolder();
  [[nodiscard]] std::string Path(const std::string& name) const { return path_ / name; }

 private:
  std::filesystem::path path_;
};

/// One field of one step, and what should come back.
struct StepData {
  CoefficientSet coefficients;
  FieldStats stats;
};

/// A soft moving ball in emptiness, with noise inside it that is never the same twice: `seed`.
[[nodiscard]] StepData MakeStep(const Int3& dims, int64_t chunk_edge, int seed);

/// The same as whole numbers that int16 holds.
[[nodiscard]] StepData WholeStep(const Int3& dims, int64_t chunk_edge, int seed);

/// float32 fields of a volume; everything else as it comes.
[[nodiscard]] DatasetInfo MakeInfo(const Int3& dims, int64_t chunk_edge,
                                   const std::vector<std::string>& fields = {"density"});

/// Writes `steps` steps of every field, MakeStep(dims, edge, seed = step) each, or WholeStep where
/// its type is one of whole numbers, 1 s apart.
[[nodiscard]] Status WriteSteps(DatasetWriter* writer, int64_t steps);

/// Creates a store and writes into it.
[[nodiscard]] Status MakeStore(const std::string& path, const DatasetInfo& info, int64_t steps,
                               FileSystem& files = RealFileSystem());

/// All of one level as [7][z][y][x].
[[nodiscard]] StatusOr<std::vector<float>> ReadLevel(CoefficientSource* source, int level);

/// Reads every coefficient; an error if one cannot be had.
[[nodiscard]] Status ReadEverything(CoefficientSource* source);

/// Every file below `path`, in a fixed order, but for the lock and the copy of the
/// group: those that readers read.
[[nodiscard]] std::vector<std::string> FilesBelow(const std::string& path);

/// Changes one byte of a file in place: xor with `mask` at `offset`, from the end if negative.
void FlipByte(const std::string& path, int64_t offset, int mask = 0x10);

}  // namespace fovea::store::testing

#endif  // TESTS_UNIT_ENGINE_STORE_STORE_TEST_UTIL_H_
