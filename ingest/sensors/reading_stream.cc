#include "ingest/sensors/reading_stream.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <memory>
#include <string_view>
#include <system_error>
#include <utility>

#include <poll.h>

#include "ingest/sequence.h"

namespace fovea::ingest {
namespace {

constexpr size_t kPieceBytes = size_t{1} << 18;
constexpr int kPollMs = 200;

/// A descriptor that is closed, unless it is standard input.
class InputFile {
 public:
  static StatusOr<InputFile> Open(const std::string& path) {
    InputFile file;
    if (path == "-") {
      file.fd_ = STDIN_FILENO;
      return file;
    }
    file.fd_ = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
    if (file.fd_ < 0) {
      return NotFound("cannot open '{}': {}", path, std::generic_category().message(errno));
    }
    return file;
  }
  InputFile(InputFile&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  InputFile& operator=(InputFile&&) = delete;
  ~InputFile() {
    if (fd_ > STDIN_FILENO) {
      ::close(fd_);
    }
  }

  /// Whether there is something to read (or the end); false after kPollMs, or at a signal.
  [[nodiscard]] bool Wait() const {
    pollfd poll{fd_, POLLIN, 0};
    return ::poll(&poll, 1, kPollMs) > 0;
  }
  /// At least one byte, or 0 at the end; -1 and errno.
  [[nodiscard]] ssize_t Read(char* to, size_t most) const { return ::read(fd_, to, most); }

 private:
  InputFile() = default;
  int fd_ = -1;
};

std::string NameOf(const std::string& input) {
  return input == "-" ? "standard input" : input;
}

ReadingFormat FormatOf(const SensorOptions& options, std::string_view input,
                       std::string_view start) {
  if (options.format) {
    return *options.format;
  }
  if (input.ends_with(".f32")) {
    return ReadingFormat::kRecords;
  }
  if (input.ends_with(".jsonl") || input.ends_with(".ndjson") || input.ends_with(".json")) {
    return ReadingFormat::kJsonLines;
  }
  const size_t first = start.find_first_not_of(" \t\r\n");
  const bool object = first != std::string_view::npos && start[first] == '{';
  return object ? ReadingFormat::kJsonLines : ReadingFormat::kCsv;
}

/// One input from its start to its end.
class InputReader {
 public:
  InputReader(const SensorOptions& options, const std::string& input, StreamState* state)
      : options_(options), input_(input), state_(*state) {}

  Status Run(const std::function<bool(const std::string&)>& go_on,
             const std::function<Status(ReadingBlock*)>& on_block) {
    FOVEA_ASSIGN_OR_RETURN(const InputFile file, InputFile::Open(input_));
    for (bool last = false; !last;) {
      if (!go_on(input_)) {
        state_.interrupted = true;
        return absl::OkStatus();
      }
      if (!file.Wait()) {
        continue;
      }
      buffer_.resize(held_ + kPieceBytes);
      const ssize_t got = file.Read(buffer_.data() + held_, kPieceBytes);
      if (got < 0 && (errno == EINTR || errno == EAGAIN)) {
        continue;
      }
      if (got < 0) {
        return FailedPrecondition("cannot read '{}': {}", NameOf(input_),
                                  std::generic_category().message(errno));
      }
      last = got == 0;
      if (last && !go_on(input_)) {  // Ctrl-C ends what writes into a pipe as well
        state_.interrupted = true;
        return absl::OkStatus();
      }
      held_ += static_cast<size_t>(got);
      state_.bytes += static_cast<uint64_t>(got);
      FOVEA_RETURN_IF_ERROR(Take(last, on_block));
    }
    return absl::OkStatus();
  }

 private:
  Status Take(bool last, const std::function<Status(ReadingBlock*)>& on_block) {
    const std::string_view bytes(buffer_.data(), held_);
    if (parser_ == nullptr) {
      ParserOptions parse;
      parse.format = FormatOf(options_, input_, bytes);
      parse.columns = options_.columns;
      parse.separator = options_.separator;
      parse.time_unit_s = options_.time_unit_s;
      parse.keys = &state_.keys;
      parse.bad = &state_.bad;
      parser_ = MakeReadingParser(parse, NameOf(input_));
    }
    block_.Clear();
    FOVEA_ASSIGN_OR_RETURN(const size_t taken, parser_->Parse(bytes, last, &block_));
    std::memmove(buffer_.data(), buffer_.data() + taken, held_ - taken);
    held_ -= taken;
    if (state_.value_names.empty()) {
      state_.value_names = parser_->value_names();
    }
    return block_.readings.empty() ? absl::OkStatus() : on_block(&block_);
  }

  const SensorOptions& options_;
  const std::string& input_;
  StreamState& state_;
  std::unique_ptr<ReadingParser> parser_;
  std::vector<char> buffer_;
  size_t held_ = 0;
  ReadingBlock block_;
};

}  // namespace

StatusOr<std::vector<std::string>> FindInputs(const SensorOptions& options) {
  if (std::find(options.inputs.begin(), options.inputs.end(), "-") != options.inputs.end()) {
    if (options.inputs.size() > 1) {
      return InvalidArgument("'-' (standard input) goes with no other input");
    }
    return options.inputs;
  }
  FOVEA_ASSIGN_OR_RETURN(const std::vector<SequenceFile> files,
                         ResolveInputs(options.inputs, OnMissing::kSkip));
  std::vector<std::string> paths;
  for (const SequenceFile& file : files) {
    paths.push_back(file.path);
  }
  return paths;
}

Status ReadAll(const SensorOptions& options, const std::vector<std::string>& inputs,
               const std::function<bool(const std::string& input)>& go_on, const OnBlock& on_block,
               StreamState* state) {
  state->bad.most = options.max_bad;
  for (size_t i = 0; i < inputs.size() && !state->interrupted; ++i) {
    FOVEA_RETURN_IF_ERROR(
        InputReader(options, inputs[i], state).Run(go_on, [&](ReadingBlock* block) {
          return on_block(i, block);
        }));
  }
  return absl::OkStatus();
}

}  // namespace fovea::ingest
