#ifndef TESTS_SYSTEM_SERVER_FOVEAD_PROCESS_H_
#define TESTS_SYSTEM_SERVER_FOVEAD_PROCESS_H_

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <fstream>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>
#include <signal.h>
#include <spawn.h>

namespace fovea::testing {

/// A fovead; killed, if it still runs, when this goes.
class Fovead {
 public:
  Fovead(std::vector<std::string> arguments, std::string log,
         const std::string& program = FOVEA_BINARY_DIR "/bin/fovead")
      : log_(std::move(log)) {
    int out[2];
    EXPECT_EQ(pipe2(out, O_CLOEXEC), 0);
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, out[1], STDOUT_FILENO);
    posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, log_.c_str(),
                                     O_CREAT | O_WRONLY | O_TRUNC, 0600);
    arguments.insert(arguments.begin(), program);
    std::vector<char*> argv;
    for (std::string& argument : arguments) {
      argv.push_back(argument.data());
    }
    argv.push_back(nullptr);
    EXPECT_EQ(posix_spawn(&pid_, program.c_str(), &actions, nullptr, argv.data(), environ), 0);
    posix_spawn_file_actions_destroy(&actions);
    close(out[1]);
    stdout_ = fdopen(out[0], "r");
  }
  ~Fovead() {
    if (pid_ > 0) {
      kill(pid_, SIGKILL);
      Wait();
    }
    fclose(stdout_);
  }

  /// The next line of stdout, without its end; empty at the end.
  std::string ReadLine() {
    char line[256] = "";
    if (fgets(line, sizeof(line), stdout_) == nullptr) {
      return "";
    }
    std::string text(line);
    text.pop_back();
    return text;
  }
  /// All of stdout that is left.
  std::string ReadAll() {
    std::string text;
    char block[4096];
    for (size_t size = 0; (size = fread(block, 1, sizeof(block), stdout_)) > 0;) {
      text.append(block, size);
    }
    return text;
  }
  void Signal(int signal) const { kill(pid_, signal); }
  /// Waits for the end; the exit status, or -1 for a signal.
  int Wait() {
    int status = 0;
    waitpid(pid_, &status, 0);
    pid_ = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }
  [[nodiscard]] std::string Log() const {
    std::stringstream text;
    text << std::ifstream(log_).rdbuf();
    return text.str();
  }

 private:
  const std::string log_;
  pid_t pid_ = -1;
  FILE* stdout_ = nullptr;
};

}  // namespace fovea::testing

#endif  // TESTS_SYSTEM_SERVER_FOVEAD_PROCESS_H_
