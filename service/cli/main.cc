#include <cstdio>
#include <string>
#include <variant>
#include <vector>

#include "service/cli/commands.h"
#include "service/cli/console.h"

int main(int argc, char** argv) {
  using namespace fovea;
  cli::InstallSignalHandlers();
  const cli::ParseResult parsed =
      cli::ParseCommandLine(std::vector<std::string>(argv + 1, argv + argc));
  if (!parsed.command) {
    parsed.exit_status == 0 ? cli::PrintLine(parsed.text) : cli::PrintError(parsed.text);
    return parsed.exit_status;
  }
  const Status status =
      std::visit([](const auto& command) { return cli::Run(command); }, *parsed.command);
  if (!status.ok()) {
    cli::PrintError(cli::WithFlag(status));
    return 1;
  }
  if (std::fflush(stdout) != 0 || std::ferror(stdout) != 0) {
    cli::PrintError("cannot write to stdout");
    return 1;
  }
  return 0;
}
