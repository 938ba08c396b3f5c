#ifndef ENGINE_STORE_STORE_FOLDER_H_
#define ENGINE_STORE_STORE_FOLDER_H_

#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/store/dataset.h"
#include "engine/store/file.h"
#include "engine/store/layout.h"

/// The folder of a store and what is in it beside data: how it is made, so that whoever dies on the
/// way leaves what can be made again, and swept behind a writer that died.
namespace fovea::store {

/// Makes `path` an empty directory that only we write to: what a Create that was killed left in it
/// is removed. ALREADY_EXISTS, touching nothing, if there is anything else.
[[nodiscard]] StatusOr<WriterLock> ClaimFolder(FileSystem& files, const std::string& path);

/// Makes the folders and metadata of a store without steps in a claimed folder; the group's
/// zarr.json appears last.
[[nodiscard]] Status MakeEmptyStore(FileSystem& files, const std::string& path,
                                    const DatasetInfo& info);

/// Removes temporary files, and files of steps that are not committed, and cuts arrays back to the
/// committed steps. Makes the copy of the group if it is missing or damaged. Only for who holds the
/// lock. DATA_LOSS if metadata of an array or field is missing or says what cannot be.
[[nodiscard]] Status SweepStore(FileSystem& files, const std::string& path,
                                const DatasetInfo& info);

/// Adds the zarr.json of every array, and behind them that of the group, to `batch`.
[[nodiscard]] Status WriteMetadata(const std::string& path, const DatasetInfo& info,
                                   const std::vector<ArraySpec>& arrays, FileBatch* batch);

}  // namespace fovea::store

#endif  // ENGINE_STORE_STORE_FOLDER_H_
