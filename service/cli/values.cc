#include "service/cli/values.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <iterator>
#include <string_view>

#include "ingest/protocol.h"
#include "service/cli/number_list.h"

namespace fovea::cli {
StatusOr<double> ParseNumber(std::string_view text) {
  const std::optional<double> value = Number<double>(Trimmed(text));
  if (!value) {
    return InvalidArgument("'{}' is not a number", text);
  }
  return *value;
}

StatusOr<frames::Position> ParsePosition(std::string_view text) {
  const bool world = text.ends_with('w') || text.ends_with('W');
  std::array<double, 3> at{};
  if (!ReadList<double>(world ? text.substr(0, text.size() - 1) : text, ',', at)) {
    return InvalidArgument("'{}' is not X,Y,Z (voxels) or X,Y,Zw (world units)", text);
  }
  return frames::Position{{at[0], at[1], at[2]}, world};
}

StatusOr<Vec3> ParseVector(std::string_view text) {
  std::array<double, 3> v{};
  if (!ReadList<double>(text, ',', v)) {
    return InvalidArgument("'{}' is not X,Y,Z", text);
  }
  return Vec3{v[0], v[1], v[2]};
}

StatusOr<Rate> ParseRate(std::string_view text) {
  if (const std::optional<double> all = Number<double>(Trimmed(text))) {
    return Rate(*all);
  }
  std::array<double, 3> along{};
  if (!ReadList<double>(text, ',', along)) {
    return InvalidArgument("'{}' is not a number, nor RX,RY,RZ", text);
  }
  return Rate(along[0], along[1], along[2]);
}

StatusOr<store::AskedWindow> ParseRetained(std::string_view text) {
  const size_t colon = text.rfind(':');
  const auto position = ParsePosition(text.substr(0, colon));
  const auto rate = colon == std::string_view::npos ? StatusOr<Rate>(InvalidArgument("no rate"))
                                                    : ParseRate(text.substr(colon + 1));
  if (!position.ok() || !rate.ok()) {
    return InvalidArgument("'{}' is not X,Y,Z:RATE (voxels) or X,Y,Zw:RATE (world units)", text);
  }
  return store::AskedWindow{{position->at, *rate}, position->world};
}

std::string FormatRetained(const store::RetainedWindow& window) {
  return fmt::format("{}:{}", FormatPosition({window.at, false}), FormatRate(window.rate));
}

StatusOr<WindowShape> ParseWindow(std::string_view text) {
  for (const auto window : {WindowShape::kCube, WindowShape::kSphere, WindowShape::kSmooth}) {
    if (text == WindowName(window)) {
      return window;
    }
  }
  return InvalidArgument("'{}' is not cube, sphere or smooth", text);
}

StatusOr<std::pair<double, double>> ParseView(std::string_view text) {
  std::array<double, 2> angles{};
  if (!ReadList<double>(text, ',', angles)) {
    return InvalidArgument("'{}' is not AZ,EL in degrees, such as 30,20", text);
  }
  return std::pair(angles[0], angles[1]);
}

StatusOr<std::pair<int64_t, int64_t>> ParseSize(std::string_view text) {
  std::array<int64_t, 2> size{};
  if (!ReadList<int64_t>(text, 'x', size)) {
    return InvalidArgument("'{}' is not WxH in pixels, such as 512x512", text);
  }
  return std::pair(size[0], size[1]);
}

StatusOr<Box3> ParseBox(std::string_view text) {
  std::array<int64_t, 6> at{};
  if (!ReadList<int64_t>(text, ',', at)) {
    return InvalidArgument("'{}' is not X0,Y0,Z0,X1,Y1,Z1 in whole voxels", text);
  }
  const Box3 box{{at[0], at[1], at[2]}, {at[3], at[4], at[5]}};
  if (box.IsEmpty()) {
    return InvalidArgument(
        "'{}' holds no voxel: each of X1,Y1,Z1 must be above X0,Y0,Z0 (it is not included)", text);
  }
  return box;
}

StatusOr<StepRange> ParseSteps(std::string_view text) {
  const Status bad = InvalidArgument(
      "'{}' is not a range of steps: A, A-B, A-BxS or A-, counted from 0, B included", text);
  StepRange range;
  std::string_view rest = text;
  if (const size_t cross = rest.find('x'); cross != std::string_view::npos) {
    const std::optional<int64_t> stride = Number<int64_t>(rest.substr(cross + 1));
    if (!stride || *stride < 1) {
      return bad;
    }
    range.stride = *stride;
    rest = rest.substr(0, cross);
  }
  const size_t dash = rest.find('-');
  const std::optional<int64_t> first = Number<int64_t>(rest.substr(0, dash));
  if (!first || *first < 0) {
    return bad;
  }
  range.first = *first;
  range.last = range.first;
  if (dash != std::string_view::npos) {
    const std::string_view last = rest.substr(dash + 1);
    range.last = Number<int64_t>(last);
    if (range.last ? *range.last < range.first : !last.empty()) {
      return bad;
    }
  }
  return range;
}

StatusOr<Shard> ParseShard(std::string_view text) {
  std::array<int64_t, 2> part{};
  if (!ReadList<int64_t>(text, '/', part) || part[0] < 0 || part[0] >= part[1]) {
    return InvalidArgument("'{}' is not i/n with i from 0 to n - 1, such as 0/4", text);
  }
  return Shard{part[0], part[1]};
}

StatusOr<render::Weighting> ParseWeighting(std::string_view text) {
  constexpr std::string_view kFalloff = "falloff:";
  if (text == "none") {
    return render::Weighting{};
  }
  if (text == "chop") {
    return render::Weighting{render::Weighting::Kind::kChop, 0};
  }
  if (text.starts_with(kFalloff)) {
    if (const auto a = Number<double>(text.substr(kFalloff.size()))) {
      return render::Weighting{render::Weighting::Kind::kFalloff, *a};
    }
  }
  return InvalidArgument("'{}' is not none, chop or falloff:A (A per voxel, such as falloff:0.05)",
                         text);
}

StatusOr<Reconstruction> ParseReconstruction(std::string_view text) {
  for (const auto how : {Reconstruction::kExact, Reconstruction::kFast}) {
    if (text == ReconstructionName(how)) {
      return how;
    }
  }
  return InvalidArgument("'{}' is not exact or fast", text);
}

StatusOr<render::Smoothing> ParseSmoothing(std::string_view text) {
  for (const auto smoothing :
       {render::Smoothing::kNone, render::Smoothing::kImage, render::Smoothing::kFull}) {
    if (text == SmoothingName(smoothing)) {
      return smoothing;
    }
  }
  return InvalidArgument("'{}' is not none, image or full", text);
}

StatusOr<render::Basis> ParseBasis(std::string_view text) {
  for (const auto basis : {render::Basis::kBilinear, render::Basis::kBspline}) {
    if (text == BasisName(basis)) {
      return basis;
    }
  }
  return InvalidArgument("'{}' is not bilinear or bspline", text);
}

StatusOr<render::Color> ParseColor(std::string_view text) {
  std::array<float, 3> parts{};
  if (!ReadList<float>(text, ',', parts)) {
    return InvalidArgument("'{}' is not R,G,B, each 0 to 1, linear light", text);
  }
  return render::Color{parts[0], parts[1], parts[2]};
}

StatusOr<render::TransferFunction> ParseTransfer(const std::string& text) {
  if (!text.ends_with(".json")) {
    return render::ParseTransferFunction(text);
  }
  constexpr std::streamsize kMaxBytes = 1 << 20;
  std::ifstream file(text, std::ios::binary);
  std::string content(static_cast<size_t>(kMaxBytes), '\0');
  if (!file) {
    return NotFound("transfer function file '{}' cannot be opened", text);
  }
  file.read(content.data(), kMaxBytes);
  if (file.gcount() == kMaxBytes) {
    return FailedPrecondition("transfer function file '{}' is longer than 1 MiB", text);
  }
  content.resize(static_cast<size_t>(file.gcount()));
  auto transfer = render::ParseTransferFunction(content);
  if (!transfer.ok()) {
    return FailedPrecondition("{}: {}", text, MessageOf(transfer.status()));
  }
  return transfer;
}

std::string FormatPosition(const frames::Position& position) {
  return fmt::format("{},{},{}{}", position.at.x, position.at.y, position.at.z,
                     position.world ? "w" : "");
}

std::string FormatWeighting(const render::Weighting& weighting) {
  switch (weighting.kind) {
    case render::Weighting::Kind::kNone:
      return "none";
    case render::Weighting::Kind::kChop:
      return "chop";
    case render::Weighting::Kind::kFalloff:
      break;
  }
  return fmt::format("falloff:{}", weighting.falloff_per_voxel);
}

const char* WindowName(WindowShape window) {
  switch (window) {
    case WindowShape::kCube:
      return "cube";
    case WindowShape::kSphere:
      return "sphere";
    case WindowShape::kSmooth:
      break;
  }
  return "smooth";
}

const char* ReconstructionName(Reconstruction how) {
  return how == Reconstruction::kFast ? "fast" : "exact";
}

const char* SmoothingName(render::Smoothing smoothing) {
  switch (smoothing) {
    case render::Smoothing::kNone:
      return "none";
    case render::Smoothing::kImage:
      return "image";
    case render::Smoothing::kFull:
      break;
  }
  return "full";
}

const char* BasisName(render::Basis basis) {
  return basis == render::Basis::kBspline ? "bspline" : "bilinear";
}

std::string ShellQuote(const std::string& text) {
  constexpr std::string_view kPlain =
      "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_,.:/=+-@%";
  if (!text.empty() && text.find_first_not_of(kPlain) == std::string::npos) {
    return text;
  }
  std::string quoted = "'";
  for (const char letter : text) {
    quoted += letter == '\'' ? std::string("'\\''") : std::string(1, letter);
  }
  return quoted + "'";
}

namespace {

std::string FormatVector(const Vec3& v) {
  return fmt::format("{},{},{}", v.x, v.y, v.z);
}

std::string ViewFlags(const frames::ViewSpec& resolved) {
  if (const auto& camera = resolved.perspective) {
    std::string flags = fmt::format("--eye {} --target {} --fov {}", FormatPosition(camera->eye),
                                    FormatPosition(*camera->target), *camera->fov_y_deg);
    return *camera->up == Vec3{0, 0, 1} ? flags : flags + " --up " + FormatVector(*camera->up);
  }
  return fmt::format("--view {},{} --span {}", *resolved.azimuth_deg, *resolved.elevation_deg,
                     *resolved.span_voxels);
}

}  // namespace

std::string PinningFlags(const frames::FrameSpec& resolved, const Int3& dims) {
  std::string flags = fmt::format(
      "--field {} --fovea {} --rate {} {} --size {}x{} --transfer {} "
      "--weighting {} --smoothing {}",
      ShellQuote(*resolved.field), FormatPosition(*resolved.fovea), FormatRate(*resolved.rate),
      ViewFlags(resolved.view), *resolved.width_px, *resolved.height_px,
      ShellQuote(render::FormatTransferFunction(*resolved.transfer)),
      FormatWeighting(*resolved.weighting), SmoothingName(*resolved.smoothing));
  if (resolved.window.value_or(WindowShape::kCube) != WindowShape::kCube) {
    flags += fmt::format(" --window {}", WindowName(*resolved.window));
  }
  if (resolved.reconstruction == Reconstruction::kFast) {
    flags += " --reconstruction fast";
  }
  if (resolved.basis.value_or(render::Basis::kBilinear) != render::Basis::kBilinear) {
    flags += fmt::format(" --basis {}", BasisName(*resolved.basis));
  }
  flags += OptionFlags(resolved);
  const Vec3 middle{static_cast<double>(dims.x) / 2, static_cast<double>(dims.y) / 2,
                    static_cast<double>(dims.z) / 2};
  if (!resolved.view.perspective && resolved.view.center->at != middle) {
    flags += fmt::format(" --center {}", FormatPosition(*resolved.view.center));
  }
  if (*resolved.background != render::Color{}) {
    flags += fmt::format(" --background {},{},{}", resolved.background->red,
                         resolved.background->green, resolved.background->blue);
  }
  if (resolved.encoding == frames::Encoding::kJpeg && *resolved.jpeg_quality != 90) {
    flags += fmt::format(" --quality {}", *resolved.jpeg_quality);
  }
  return flags + (resolved.fovea_marker ? " --fovea-marker" : "") +
         (resolved.strict ? " --strict" : "");
}

StatusOr<std::vector<double>> ParseTimes(const std::string& text) {
  constexpr std::streamsize kMaxBytes = 64 << 20;
  std::string list = text;
  if (std::ifstream file(text, std::ios::binary); file) {
    list.resize(static_cast<size_t>(kMaxBytes));
    file.read(list.data(), kMaxBytes);  // it may have no end
    if (file.gcount() == kMaxBytes) {
      return InvalidArgument("'{}' is too long for a list of times", text);
    }
    list.resize(static_cast<size_t>(file.gcount()));
  } else if (text.find_first_not_of("0123456789+-.eE, ") != std::string::npos) {
    return NotFound("'{}' is neither a list of seconds nor a file that can be read", text);
  }
  FOVEA_ASSIGN_OR_RETURN(std::vector<double> times, ParseTimeList(list));
  if (times.empty()) {
    return InvalidArgument("'{}' holds no times", text);
  }
  return times;
}

StatusOr<std::vector<double>> ParseTimeList(std::string_view list) {
  constexpr std::string_view kBetween = ", \t\r\n;";
  std::vector<double> times;
  for (size_t begin = list.find_first_not_of(kBetween); begin != std::string::npos;
       begin = list.find_first_not_of(kBetween, begin)) {
    const size_t end = std::min(list.find_first_of(kBetween, begin), list.size());
    const auto time = Number<double>(list.substr(begin, end - begin));
    if (!time || !std::isfinite(*time)) {
      constexpr size_t kMostShown = 40;
      const std::string_view shown = list.substr(begin, std::min(end - begin, kMostShown));
      return InvalidArgument("'{}' is not a number of seconds",
                             ingest::Printable(std::string(shown)));
    }
    times.push_back(*time);
    begin = end;
  }
  return times;
}

}  // namespace fovea::cli
