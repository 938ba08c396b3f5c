#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <system_error>

#include "ingest/program_path.h"
#include "service/cli/commands.h"

namespace fovea::cli {

Status Run(const ServeCommand& command) {
  FOVEA_ASSIGN_OR_RETURN(const std::string program, ingest::FindProgram("fovead"));
  std::vector<char*> argv;
  std::string name = "fovead";
  argv.push_back(name.data());
  std::vector<std::string> arguments = command.arguments;
  for (std::string& argument : arguments) {
    argv.push_back(argument.data());
  }
  argv.push_back(nullptr);
  std::fflush(nullptr);
  std::signal(SIGPIPE, SIG_DFL);
  std::signal(SIGXFSZ, SIG_DFL);
  ::execv(program.c_str(), argv.data());
  return FailedPrecondition("cannot start {}: {}", program, std::generic_category().message(errno));
}

}  // namespace fovea::cli
