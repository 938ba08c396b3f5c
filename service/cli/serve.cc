#include "service/cli/become.h"
#include "service/cli/commands.h"

namespace fovea::cli {

Status Run(const ServeCommand& command) {
  return Become("fovead", command.arguments);
}

}  // namespace fovea::cli
