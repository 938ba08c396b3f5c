#include <cstdio>
#include <exception>
#include <new>
#include <string>
#include <variant>
#include <vector>

#include "service/cli/become.h"
#include "service/cli/commands.h"
#include "service/cli/console.h"

namespace fovea {
namespace {

int Main(const std::vector<std::string>& arguments) {
  cli::InstallSignalHandlers();
  const cli::ParseResult parsed = cli::ParseCommandLine(arguments);
  if (!parsed.command) {
    parsed.exit_status == 0 ? cli::PrintLine(parsed.text) : cli::PrintError(parsed.text);
    return parsed.exit_status;
  }
  Status status = cli::HandOver(*parsed.command, arguments);
  if (status.ok()) {
    status = std::visit([](const auto& command) { return cli::Run(command); }, *parsed.command);
  }
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

}  // namespace
}  // namespace fovea

int main(int argc, char** argv) {
  try {
    return fovea::Main(std::vector<std::string>(argv + 1, argv + argc));
  } catch (const std::bad_alloc&) {
    fovea::cli::PrintError("out of memory: a smaller --size or a lower --rate needs less");
  } catch (const std::exception& error) {
    fovea::cli::PrintError(std::string("internal error: ") + error.what());
  }
  return 1;
}
