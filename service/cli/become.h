#ifndef SERVICE_CLI_BECOME_H_
#define SERVICE_CLI_BECOME_H_

#include <string>
#include <vector>

#include "engine/base/status.h"
#include "service/cli/commands.h"

namespace fovea::cli {

/// This process goes on as `program`, one of ours, with these arguments; returns only if it cannot.
[[nodiscard]] Status Become(const std::string& program, const std::vector<std::string>& arguments);

/// What asks a server needs gRPC, which takes longer to load than a frame to render: `fovea`, which
/// is without it, becomes `fovea-remote` for such a command, and returns only if it cannot; for all
/// others, and in `fovea-remote`, it returns OK.
[[nodiscard]] Status HandOver(const Command& command, const std::vector<std::string>& arguments);

}  // namespace fovea::cli

#endif  // SERVICE_CLI_BECOME_H_
