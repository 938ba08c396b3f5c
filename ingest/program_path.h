#ifndef INGEST_PROGRAM_PATH_H_
#define INGEST_PROGRAM_PATH_H_

#include <string>

#include "engine/base/status.h"

namespace fovea::ingest {

/// The path of one of our own programs: beside the running program, else in ../libexec/fovea from
/// there, else in the folder $FOVEA_LIBEXEC. NOT_FOUND says where it was looked for.
[[nodiscard]] StatusOr<std::string> FindProgram(const std::string& name);

}  // namespace fovea::ingest

#endif  // INGEST_PROGRAM_PATH_H_
