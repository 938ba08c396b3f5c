#include "service/frames/spec_json.h"

#include <nlohmann/json.hpp>

#include "service/frames/encode.h"

namespace fovea::frames {

using nlohmann::json;

namespace {

json Vec3ToJson(const Vec3& v) {
  return {{"x", v.x}, {"y", v.y}, {"z", v.z}};
}

const char* SpaceToJson(bool world) {
  return world ? "SPACE_WORLD" : "SPACE_VOXEL";
}

json PositionToJson(const Position& position) {
  return {{"at", Vec3ToJson(position.at)}, {"space", SpaceToJson(position.world)}};
}

// A float prints as the shortest decimal that reads back as that float, not as its double.
double Shortest(float value) {
  return std::stod(fmt::format("{}", value));
}

json ColorToJson(const render::Color& color) {
  return {{"red", Shortest(color.red)},
          {"green", Shortest(color.green)},
          {"blue", Shortest(color.blue)}};
}

json PerspectiveToJson(const PerspectiveSpec& view) {
  json perspective = {{"eye", PositionToJson(view.eye)}};
  if (view.target) {
    perspective["target"] = PositionToJson(*view.target);
  }
  if (view.up) {
    perspective["up"] = {{"x", view.up->x}, {"y", view.up->y}, {"z", view.up->z}};
  }
  if (view.fov_y_deg) {
    perspective["fov_y_deg"] = *view.fov_y_deg;
  }
  return {{"perspective", perspective}};
}

json ViewToJson(const ViewSpec& view) {
  if (view.perspective) {
    return PerspectiveToJson(*view.perspective);
  }
  json orthographic = json::object();
  if (view.azimuth_deg) {
    orthographic["azimuth_deg"] = *view.azimuth_deg;
  }
  if (view.elevation_deg) {
    orthographic["elevation_deg"] = *view.elevation_deg;
  }
  if (view.center) {
    orthographic["center"] = PositionToJson(*view.center);
  }
  if (view.span_voxels) {
    orthographic["span_voxels"] = *view.span_voxels;
  }
  return {{"orthographic", orthographic}};
}

json TransferToJson(const render::TransferFunction& transfer) {
  json points = json::array();
  for (const auto& point : transfer.points) {
    points.push_back({{"value", point.value},
                      {"color", ColorToJson(point.color)},
                      {"opacity", Shortest(point.opacity)}});
  }
  return {{"points", points}};
}

json WeightingToJson(const render::Weighting& weighting) {
  switch (weighting.kind) {
    case render::Weighting::Kind::kNone:
      return {{"kind", "NONE"}};
    case render::Weighting::Kind::kChop:
      return {{"kind", "CHOP"}};
    case render::Weighting::Kind::kFalloff:
      break;
  }
  return {{"kind", "FALLOFF"}, {"falloff_per_voxel", weighting.falloff_per_voxel}};
}

const char* SmoothingToJson(render::Smoothing smoothing) {
  switch (smoothing) {
    case render::Smoothing::kNone:
      return "SMOOTHING_NONE";
    case render::Smoothing::kImage:
      return "SMOOTHING_IMAGE";
    case render::Smoothing::kFull:
      break;
  }
  return "SMOOTHING_FULL";
}

const char* WindowToJson(WindowShape window) {
  switch (window) {
    case WindowShape::kCube:
      return "WINDOW_CUBE";
    case WindowShape::kSphere:
      return "WINDOW_SPHERE";
    case WindowShape::kSmooth:
      break;
  }
  return "WINDOW_SMOOTH";
}

json LightingToJson(const render::Lighting& lighting) {
  return {{"ambient", Shortest(lighting.ambient)},
          {"diffuse", Shortest(lighting.diffuse)},
          {"specular", Shortest(lighting.specular)},
          {"shininess", lighting.shininess},
          {"to_light", Vec3ToJson(lighting.to_light)}};
}

json ClipToJson(const ClipSpec& clip) {
  json result = json::object();
  if (clip.box) {
    result["box"] = {{"lower", Vec3ToJson(clip.box->lower)},
                     {"upper", Vec3ToJson(clip.box->upper)},
                     {"space", SpaceToJson(clip.box->world)}};
  }
  for (const ClipPlane& plane : clip.planes) {
    result["planes"].push_back({{"normal", Vec3ToJson(plane.normal)},
                                {"offset", plane.offset},
                                {"space", SpaceToJson(plane.world)}});
  }
  return result;
}

const char* ModeToJson(Mode mode) {
  switch (mode) {
    case Mode::kTwoPhase:
      return "MODE_TWO_PHASE";
    case Mode::kFused:
      return "MODE_FUSED";
    case Mode::kAuto:
      break;
  }
  return "MODE_AUTO";
}

/// What shades and cuts.
void AddOptionsToJson(const FrameSpec& spec, json* result) {
  json& out = *result;
  if (spec.compositing) {
    out["compositing"] = *spec.compositing == render::Compositing::kMaximum
                             ? "COMPOSITING_MAXIMUM"
                             : "COMPOSITING_EMISSION";
  }
  if (spec.lighting) {
    out["lighting"] = LightingToJson(*spec.lighting);
  }
  if (!spec.clip.IsEmpty()) {
    out["clip"] = ClipToJson(spec.clip);
  }
  if (spec.color_field) {
    out["color_field"] = *spec.color_field;
  }
  if (spec.color_transfer) {
    out["color_transfer_function"] = TransferToJson(*spec.color_transfer);
  }
  if (spec.mode) {
    out["mode"] = ModeToJson(*spec.mode);
  }
}

json StatsToJson(const FrameStats& stats) {
  return {{"coefficients", stats.coefficients}, {"chunks_read", stats.chunks_read},
          {"chunks_total", stats.chunks_total}, {"bytes_read", stats.bytes_read},
          {"super_voxels", stats.super_voxels}, {"samples", stats.samples},
          {"read_ms", stats.read_ms},           {"reconstruct_ms", stats.reconstruct_ms},
          {"render_ms", stats.render_ms},       {"smooth_warp_ms", stats.smooth_warp_ms},
          {"encode_ms", stats.encode_ms}};
}

}  // namespace

json SpecToJson(const FrameSpec& spec) {
  json result = {{"view", ViewToJson(spec.view)},
                 {"encoding", EncodingName(spec.encoding)},
                 {"fovea_marker", spec.fovea_marker},
                 {"strict", spec.strict}};
  if (spec.field) {
    result["field"] = *spec.field;
  }
  if (spec.fovea) {
    result["fovea"] = PositionToJson(*spec.fovea);
  }
  if (spec.rate) {
    if (spec.rate->IsIsotropic()) {
      result["rate"] = spec.rate->x;
    } else {
      result["rate_xyz"] = {{"x", spec.rate->x}, {"y", spec.rate->y}, {"z", spec.rate->z}};
    }
  }
  if (spec.window) {
    result["window"] = WindowToJson(*spec.window);
  }
  if (spec.reconstruction) {
    result["reconstruction"] = *spec.reconstruction == Reconstruction::kFast
                                   ? "RECONSTRUCTION_FAST"
                                   : "RECONSTRUCTION_EXACT";
  }
  if (spec.transfer) {
    result["transfer_function"] = TransferToJson(*spec.transfer);
  }
  if (spec.weighting) {
    result["weighting"] = WeightingToJson(*spec.weighting);
  }
  if (spec.smoothing) {
    result["smoothing"] = SmoothingToJson(*spec.smoothing);
  }
  if (spec.basis) {
    result["basis"] = *spec.basis == render::Basis::kBspline ? "BASIS_BSPLINE" : "BASIS_BILINEAR";
  }
  AddOptionsToJson(spec, &result);
  if (spec.width_px) {
    result["width_px"] = *spec.width_px;
  }
  if (spec.height_px) {
    result["height_px"] = *spec.height_px;
  }
  if (spec.jpeg_quality) {
    result["jpeg_quality"] = *spec.jpeg_quality;
  }
  if (spec.background) {
    result["background"] = ColorToJson(*spec.background);
  }
  return result;
}

const char* WarningName(Warning::Code code) {
  return code == Warning::Code::kNotRetained ? "NOT_RETAINED" : "DATA_LOSS";
}

json FrameToJson(const Frame& frame) {
  json result = {{"dataset", frame.dataset},
                 {"step", frame.step},
                 {"time_ns", frame.time_ns},
                 {"used", SpecToJson(frame.used)},
                 {"width_px", frame.width_px},
                 {"height_px", frame.height_px},
                 {"encoding", EncodingName(frame.encoding)},
                 {"stats", StatsToJson(frame.stats)},
                 {"index", frame.index},
                 {"warnings", json::array()}};
  if (frame.frame_number) {
    result["frame_number"] = *frame.frame_number;
  }
  for (const Warning& warning : frame.warnings) {
    result["warnings"].push_back({{"code", WarningName(warning.code)},
                                  {"message", warning.message},
                                  {"count", warning.count}});
  }
  return result;
}

}  // namespace fovea::frames
