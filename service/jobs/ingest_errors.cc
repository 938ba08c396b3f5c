#include "service/jobs/ingest_errors.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cstddef>

#include <absl/strings/str_join.h>
#include <fmt/format.h>

namespace fovea::jobs {
namespace {

/// Of `fovea jobs ingest`, and so of IngestFilesRequest.
constexpr std::array<std::string_view, 9> kFlags = {"--raw",     "--grid",       "--field",
                                                    "--fps",     "--on-missing", "--registration",
                                                    "--wavelet", "--lossless",   "--tolerance"};

/// The flags in `text` that jobs do not have, each once.
std::vector<std::string> ForeignFlags(std::string_view text) {
  std::vector<std::string> flags;
  for (size_t at = 0; (at = text.find("--", at)) != std::string_view::npos;) {
    const bool begins_word = at == 0 || text[at - 1] == ' ' || text[at - 1] == '(';
    size_t end = at + 2;
    while (end < text.size() && (std::islower(static_cast<unsigned char>(text[end])) != 0 ||
                                 (text[end] == '-' && end > at + 2))) {
      ++end;
    }
    const std::string_view flag = text.substr(at, end - at);
    at = end;
    if (begins_word && flag.size() > 2 &&
        std::find(kFlags.begin(), kFlags.end(), flag) == kFlags.end() &&
        std::find(flags.begin(), flags.end(), flag) == flags.end()) {
      flags.emplace_back(flag);
    }
  }
  return flags;
}

}  // namespace

std::optional<Failure> FailureOf(std::string_view message, const std::vector<std::string>& files) {
  std::string_view name;
  for (const std::string& file : files) {
    const std::string_view rest = message.substr(std::min(file.size(), message.size()));
    if (message.starts_with(file) && rest.starts_with(": ") && file.size() > name.size()) {
      name = file;
    }
  }
  if (name.empty()) {
    return std::nullopt;
  }
  const std::string_view reason = message.substr(name.size() + 2);
  if (reason.starts_with("cannot write ")) {
    return std::nullopt;  // the disk's fault, whatever was read meanwhile
  }
  return Failure{std::string(name), std::string(reason)};
}

std::string ForJobs(std::string text) {
  const std::vector<std::string> flags = ForeignFlags(text);
  if (!flags.empty()) {
    text += fmt::format("; a job has no {}: `fovea ingest`, where the files are, has",
                        absl::StrJoin(flags, ", "));
  }
  return text;
}

}  // namespace fovea::jobs
