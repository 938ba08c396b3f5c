#ifndef SERVICE_CLI_DATASET_OUTPUT_H_
#define SERVICE_CLI_DATASET_OUTPUT_H_

#include <string>

#include "service/cli/commands.h"

namespace fovea::cli {

/// What is said and done before a new dataset is made at `path`: a note if its name is one that
/// servers do not list, and the folder that it goes into, with a note if that is not there yet.
void PrepareOutput(const OutputOptions& output, const std::string& path);

}  // namespace fovea::cli

#endif  // SERVICE_CLI_DATASET_OUTPUT_H_
