#include "service/cli/console.h"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <utility>

#include <nlohmann/json.hpp>

namespace fovea::cli {
namespace {

volatile std::sig_atomic_t interrupted = 0;

void OnInterrupt(int signal) {
  interrupted = 1;
  std::signal(signal, SIG_DFL);
}

size_t TerminalColumns() {
  winsize size{};
  return ::ioctl(STDERR_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0 ? size.ws_col : 80;
}

}  // namespace

void InstallSignalHandlers() {
  for (const int signal : {SIGINT, SIGTERM}) {
    struct sigaction action {};
    action.sa_handler = OnInterrupt;
    sigaction(signal, &action, nullptr);
  }
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);
}

void ResetSignalHandlers() {
  for (const int signal : {SIGINT, SIGTERM}) {
    std::signal(signal, SIG_DFL);
  }
}

bool Interrupted() {
  return interrupted != 0;
}

void PrintLine(std::string_view line) {
  std::fwrite(line.data(), 1, line.size(), stdout);
  std::fputc('\n', stdout);
}

void PrintJson(const nlohmann::json& value) {
  PrintLine(value.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace));
}

void Note(const OutputOptions& output, std::string_view line) {
  if (!output.quiet) {
    std::fflush(stdout);
    std::fprintf(stderr, "%.*s\n", static_cast<int>(line.size()), line.data());
  }
}

void Warn(std::string_view message) {
  std::fflush(stdout);
  std::fprintf(stderr, "warning: %.*s\n", static_cast<int>(message.size()), message.data());
}

void PrintError(std::string_view message) {
  std::fflush(stdout);
  std::fprintf(stderr, "fovea: %.*s\n", static_cast<int>(message.size()), message.data());
}

std::string WithFlag(const Status& error) {
  constexpr std::array<std::array<std::string_view, 2>, 44> kFlags = {{
      {"field", "--field"},
      {"fovea", "--fovea"},
      {"rate", "--rate"},
      {"window", "--window"},
      {"azimuth_deg", "--view"},
      {"elevation_deg", "--view"},
      {"center", "--center"},
      {"span_voxels", "--span"},
      {"eye", "--eye"},
      {"target", "--target"},
      {"up", "--up"},
      {"fov_y_deg", "--fov"},
      {"transfer_function", "--transfer"},
      {"falloff_per_voxel", "--weighting"},
      {"weighting", "--weighting"},
      {"compositing", "--compositing"},
      {"lighting", "--lighting"},
      {"clip_box", "--clip-box"},
      {"clip_plane", "--clip-plane"},
      {"color_field", "--color-field"},
      {"color_transfer_function", "--color-transfer"},
      {"mode", "--mode"},
      {"width_px", "--size"},
      {"height_px", "--size"},
      {"jpeg_quality", "--quality"},
      {"background", "--background"},
      {"fovea_marker", "--fovea-marker"},
      {"step", "--step"},
      {"steps", "--steps"},
      {"shard", "--shard"},
      {"fps", "--fps"},
      {"frames_per_second", "--fps"},
      {"output", "--output"},
      {"animation_json", "--animation"},
      {"raw", "--raw"},
      {"wavelet", "--wavelet"},
      {"tolerance", "--tolerance"},
      {"on_missing", "--on-missing"},
      {"registration", "--registration"},
      {"voxel", "--bounds and --voxel"},
      {"lower", "--bounds"},
      {"upper", "--bounds"},
      {"fields", "--field"},
      {"step_seconds", "--step-seconds"},
  }};
  const std::string_view message = MessageOf(error);
  if (!absl::IsInvalidArgument(error) && !absl::IsNotFound(error) && !absl::IsOutOfRange(error)) {
    return std::string(message);
  }
  std::string_view rest = message;
  if (rest.starts_with("server ")) {  // server HOST:PORT: ...
    const size_t colon = rest.find(": ");
    rest = colon == std::string_view::npos ? rest : rest.substr(colon + 2);
  }
  constexpr std::string_view kHeader = "header.";  // of readings
  rest.remove_prefix(rest.starts_with(kHeader) ? kHeader.size() : 0);
  const std::string_view word = rest.substr(0, rest.find_first_of(" :'."));
  for (const auto& [field, flag] : kFlags) {
    if (word == field) {
      return fmt::format("{}: {}", flag, message);
    }
  }
  return std::string(message);
}

std::string CountOf(int64_t count, std::string_view unit) {
  return fmt::format("{} {}{}", count, unit, count == 1 ? "" : "s");
}

std::string DescribeLost(const std::string& field, const std::vector<int64_t>& steps) {
  constexpr size_t kMostRuns = 20;
  std::string list;
  size_t runs = 0;
  for (size_t first = 0, end = 0; first < steps.size(); first = end) {
    end = first + 1;
    while (end < steps.size() && steps[end] == steps[end - 1] + 1) {
      ++end;
    }
    if (runs++ == kMostRuns) {
      list += fmt::format(" and {} more", steps.size() - first);
      break;
    }
    list += (list.empty() ? "" : ", ") + fmt::format("{}", steps[first]);
    if (end - first > 1) {
      list += fmt::format(" to {}", steps[end - 1]);
    }
  }
  return fmt::format(
      "step{} {} of field '{}', of which a repair could save nothing: empty pictures",
      steps.size() == 1 ? "" : "s", list, field);
}

std::string HumanBytes(uint64_t bytes) {
  constexpr std::array<const char*, 5> kUnits = {"B", "KiB", "MiB", "GiB", "TiB"};
  auto amount = static_cast<double>(bytes);
  size_t unit = 0;
  while (amount >= 1024 && unit + 1 < kUnits.size()) {
    amount /= 1024;
    ++unit;
  }
  return unit == 0 ? fmt::format("{} B", bytes) : fmt::format("{:.1f} {}", amount, kUnits[unit]);
}

std::string HumanSeconds(double seconds) {
  if (seconds < 10) {
    return fmt::format("{:.1f} s", seconds);
  }
  const auto whole = static_cast<int64_t>(std::llround(seconds));
  if (whole < 60) {
    return fmt::format("{} s", whole);
  }
  if (whole < 3600) {
    return fmt::format("{} min {} s", whole / 60, whole % 60);
  }
  return fmt::format("{} h {} min", whole / 3600, whole % 3600 / 60);
}

Progress::Progress(const OutputOptions& output, std::string what, std::string unit)
    : quiet_(output.quiet),
      terminal_(::isatty(STDERR_FILENO) == 1),
      what_(std::move(what)),
      unit_(std::move(unit)) {}

Progress::~Progress() {
  if (line_open_) {
    std::fputs("\r\x1b[K", stderr);
  }
}

std::string Progress::Line(int64_t done, int64_t total, std::string_view now) const {
  std::string line = total < 0 ? fmt::format("{}: {} {}", what_, done, unit_)
                               : fmt::format("{}: {} of {} {}", what_, done, total, unit_);
  const double seconds = since_start_.ElapsedMs() / 1000;
  const int64_t counted = done - first_done_;
  if (counted > 0 && seconds > 0) {
    const double rate = static_cast<double>(counted) / seconds;
    line += fmt::format(", {:.{}f} a second", rate, rate < 10 ? 2 : 0);
    if (done < total) {
      line += ", " + HumanSeconds(static_cast<double>(total - done) / rate) + " left";
    }
  }
  return now.empty() ? line : fmt::format("{}  {}", line, now);
}

void Progress::Update(int64_t done, int64_t total, std::string_view now) {
  if (first_done_ < 0) {
    first_done_ = done;
  }
  Show(done, done == total && shown_done_ != done, Line(done, total, now));
}

void Progress::Show(int64_t done, bool last, std::string line) {
  constexpr double kTerminalEveryMs = 100;
  constexpr double kPlainEveryMs = 5000;
  const bool due =
      shown_done_ < 0 || since_shown_.ElapsedMs() >= (terminal_ ? kTerminalEveryMs : kPlainEveryMs);
  if (quiet_ || (!last && !due)) {
    return;
  }
  shown_done_ = done;
  (void)since_shown_.RestartMs();
  if (terminal_) {
    line.resize(std::min(line.size(), TerminalColumns() - 1));
    std::fprintf(stderr, "\r%s\x1b[K", line.c_str());
    std::fflush(stderr);
    line_open_ = true;
  } else {
    std::fprintf(stderr, "%s\n", line.c_str());
  }
}

}  // namespace fovea::cli
