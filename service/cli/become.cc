#include "service/cli/become.h"

#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <system_error>

#include "ingest/program_path.h"

namespace fovea::cli {

Status Become(const std::string& program, const std::vector<std::string>& arguments) {
  FOVEA_ASSIGN_OR_RETURN(const std::string path, ingest::FindProgram(program));
  std::vector<std::string> texts{program};
  texts.insert(texts.end(), arguments.begin(), arguments.end());
  std::vector<char*> argv;
  for (std::string& text : texts) {
    argv.push_back(text.data());
  }
  argv.push_back(nullptr);
  std::fflush(nullptr);
  std::signal(SIGPIPE, SIG_DFL);
  std::signal(SIGXFSZ, SIG_DFL);
  ::execv(path.c_str(), argv.data());
  return FailedPrecondition("cannot start {}: {}", path, std::generic_category().message(errno));
}

}  // namespace fovea::cli
