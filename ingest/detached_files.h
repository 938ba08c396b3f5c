#ifndef INGEST_DETACHED_FILES_H_
#define INGEST_DETACHED_FILES_H_

#include <string>
#include <vector>

#include "engine/base/status.h"

namespace fovea::ingest {

/// Where the files are that a header names. They must lie beside the header or below its folder,
/// and be there: absolute names and `..` are refused (INVALID_ARGUMENT), since a header is a
/// foreign text that must not choose what is read. Errors name the header and the file.
[[nodiscard]] StatusOr<std::vector<std::string>> FindDetached(
    const std::string& header, const std::vector<std::string>& names);

}  // namespace fovea::ingest

#endif  // INGEST_DETACHED_FILES_H_
