#include <array>
#include <cmath>

#include "service/cli/number_list.h"
#include "service/cli/values.h"

namespace fovea::cli {
namespace {

/// Exactly N numbers; whether a w for world units follows them.
template <size_t N>
bool ReadSpatial(std::string_view text, std::array<double, N>* numbers, bool* world) {
  *world = text.ends_with('w') || text.ends_with('W');
  return ReadList<double>(*world ? text.substr(0, text.size() - 1) : text, ',', *numbers);
}

std::string FormatVec3(const Vec3& v) {
  return fmt::format("{},{},{}", v.x, v.y, v.z);
}

const char* ModeName(frames::Mode mode) {
  switch (mode) {
    case frames::Mode::kTwoPhase:
      return "two-phase";
    case frames::Mode::kFused:
      return "fused";
    case frames::Mode::kAuto:
      break;
  }
  return "auto";
}

}  // namespace

StatusOr<render::Compositing> ParseCompositing(std::string_view text) {
  if (text == "emission") {
    return render::Compositing::kEmissionAbsorption;
  }
  if (text == "maximum") {
    return render::Compositing::kMaximum;
  }
  return InvalidArgument("'{}' is not emission or maximum", text);
}

StatusOr<render::Lighting> ParseLighting(std::string_view text) {
  render::Lighting lighting;
  lighting.enabled = true;
  if (text.empty()) {
    return lighting;
  }
  std::array<double, 4> parts{0, 0, 0, static_cast<double>(lighting.shininess)};
  if (!ReadList<double>(text, ',', parts) &&
      !ReadList<double>(text, ',', std::span(parts).first<3>())) {
    return InvalidArgument(
        "'{}' is not AMBIENT,DIFFUSE,SPECULAR[,SHININESS], such as 0.3,0.7,0.2,16 (which is meant "
        "where nothing, or another flag, follows)",
        text);
  }
  lighting.ambient = static_cast<float>(parts[0]);
  lighting.diffuse = static_cast<float>(parts[1]);
  lighting.specular = static_cast<float>(parts[2]);
  // What is no whole number is outside the range as -1 is.
  const bool whole = parts[3] >= 1 && parts[3] <= 256 && parts[3] == std::floor(parts[3]);
  lighting.shininess = whole ? static_cast<int>(parts[3]) : -1;
  return lighting;
}

StatusOr<Vec3> ParseDirection(std::string_view text) {
  std::array<double, 3> to{};
  if (!ReadList<double>(text, ',', to)) {
    return InvalidArgument("'{}' is not X,Y,Z, a direction in the world", text);
  }
  return Vec3{to[0], to[1], to[2]};
}

StatusOr<frames::ClipBox> ParseClipBox(std::string_view text) {
  std::array<double, 6> at{};
  bool world = false;
  if (!ReadSpatial(text, &at, &world)) {
    return InvalidArgument(
        "'{}' is not X0,Y0,Z0,X1,Y1,Z1 (voxels), or that with a trailing w (world units)", text);
  }
  return frames::ClipBox{{at[0], at[1], at[2]}, {at[3], at[4], at[5]}, world};
}

StatusOr<frames::ClipPlane> ParseClipPlane(std::string_view text) {
  std::array<double, 4> at{};
  bool world = false;
  if (!ReadSpatial(text, &at, &world)) {
    return InvalidArgument(
        "'{}' is not NX,NY,NZ,OFFSET (voxels), or that with a trailing w (world units)", text);
  }
  return frames::ClipPlane{{at[0], at[1], at[2]}, at[3], world};
}

StatusOr<frames::Mode> ParseMode(std::string_view text) {
  for (const auto mode : {frames::Mode::kTwoPhase, frames::Mode::kFused, frames::Mode::kAuto}) {
    if (text == ModeName(mode)) {
      return mode;
    }
  }
  return InvalidArgument("'{}' is not two-phase, fused or auto", text);
}

std::string OptionFlags(const frames::FrameSpec& resolved) {
  std::string flags;
  if (resolved.compositing == render::Compositing::kMaximum) {
    flags += " --compositing maximum";
  }
  if (const auto& lighting = resolved.lighting) {
    flags += fmt::format(" --lighting {},{},{},{}", lighting->ambient, lighting->diffuse,
                         lighting->specular, lighting->shininess);
    if (lighting->to_light != Vec3{}) {
      flags += fmt::format(" --light {}", FormatVec3(lighting->to_light));
    }
  }
  if (const auto& box = resolved.clip.box) {
    flags += fmt::format(" --clip-box {},{}{}", FormatVec3(box->lower), FormatVec3(box->upper),
                         box->world ? "w" : "");
  }
  for (const frames::ClipPlane& plane : resolved.clip.planes) {
    flags += fmt::format(" --clip-plane {},{}{}", FormatVec3(plane.normal), plane.offset,
                         plane.world ? "w" : "");
  }
  if (resolved.color_field) {
    flags += fmt::format(" --color-field {} --color-transfer {}", ShellQuote(*resolved.color_field),
                         ShellQuote(render::FormatTransferFunction(*resolved.color_transfer)));
  }
  if (resolved.mode && *resolved.mode != frames::Mode::kTwoPhase) {
    flags += fmt::format(" --mode {}", ModeName(*resolved.mode));
  }
  return flags;
}

}  // namespace fovea::cli
