#ifndef ENGINE_STORE_METADATA_H_
#define ENGINE_STORE_METADATA_H_

#include <cstdint>
#include <string>
#include <string_view>

#include "engine/base/status.h"
#include "engine/store/dataset.h"
#include "engine/store/file_system.h"
#include "engine/store/layout.h"

/// The zarr.json files of a store: written, and read as if an enemy had written them.
namespace fovea::store {

inline constexpr std::string_view kMetadataName = "zarr.json";
/// A copy of the group's zarr.json as it was when the store was made, for repair. Readers of Zarr
/// do not see it.
inline constexpr std::string_view kGroupCopyName = ".fovea.group.json";
inline constexpr int64_t kMaxSteps = 1'000'000'000;

/// The zarr.json of the group: the `fovea` attributes, with a CRC32C over themselves.
[[nodiscard]] StatusOr<std::string> GroupJson(const DatasetInfo& info);
/// The same for the copy: without steps, and what comes with them.
[[nodiscard]] StatusOr<std::string> GroupCopyJson(const DatasetInfo& info);
/// The zarr.json of the group that holds the arrays of one field.
[[nodiscard]] std::string FieldGroupJson();
[[nodiscard]] std::string ArrayJson(const ArraySpec& spec, int64_t steps);

/// Reads the group of the store at `store_path`, or the copy. Errors as Dataset::Open.
[[nodiscard]] StatusOr<DatasetInfo> ReadGroup(FileSystem& files, const std::string& store_path,
                                              std::string_view name = kMetadataName);
/// Checks an array's zarr.json against what it must be and returns its number of steps. DATA_LOSS
/// naming the file if it is missing or says anything else.
[[nodiscard]] StatusOr<int64_t> ReadArraySteps(FileSystem& files, const std::string& store_path,
                                               const ArraySpec& spec);
/// Checks the zarr.json of the group that holds the arrays of `field`.
[[nodiscard]] Status CheckFieldGroup(FileSystem& files, const std::string& store_path,
                                     const std::string& field);

}  // namespace fovea::store

#endif  // ENGINE_STORE_METADATA_H_
