#include "engine/store/stored_size.h"

#include <filesystem>
#include <system_error>

#include "engine/store/layout.h"

namespace fovea::store {
namespace {

/// The next place in a grid of files, the last axis first; false behind the last one.
bool Advance(const std::vector<int64_t>& grid, std::vector<int64_t>* at) {
  for (size_t axis = grid.size(); axis-- > 0;) {
    if (++(*at)[axis + 1] < grid[axis]) {
      return true;
    }
    (*at)[axis + 1] = 0;
  }
  return false;
}

StatusOr<uint64_t> BytesOfStep(const std::string& folder, const ArraySpec& array, int64_t step) {
  const std::vector<int64_t> grid = array.FileGrid();
  std::vector<int64_t> at(grid.size() + 1, 0);
  at.front() = step;
  uint64_t bytes = 0;
  do {
    const std::string path = folder + "/" + ChunkName(at);
    std::error_code error;
    const uint64_t size = std::filesystem::file_size(path, error);
    if (!error) {
      bytes += size;
    } else if (error != std::errc::no_such_file_or_directory) {
      return Unavailable("cannot read the size of {}: {}", path, error.message());
    }
  } while (Advance(grid, &at));
  return bytes;
}

}  // namespace

StatusOr<std::vector<ArrayBytes>> StepBytes(const std::string& store_path, const DatasetInfo& info,
                                            const std::string& field, int64_t step) {
  std::vector<ArrayBytes> all;
  const std::string folder = field + "/";
  for (const ArraySpec& array : AllArrays(info)) {
    if (array.path.starts_with(folder) && array.FileSteps() == 1) {
      FOVEA_ASSIGN_OR_RETURN(const uint64_t bytes,
                             BytesOfStep(store_path + "/" + array.path, array, step));
      all.push_back({array.path.substr(folder.size()), bytes});
    }
  }
  return all;
}

}  // namespace fovea::store
