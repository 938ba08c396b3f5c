#include "service/frames/spec_json.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace fovea::frames {
namespace {

TEST(SpecJson, HasTheProtosNamesAndOnlyWhatIsThere) {
  FrameSpec spec;
  EXPECT_FALSE(SpecToJson(spec).contains("rate"));
  spec.rate = 40;
  spec.fovea = Position{{1, 2, 3}, true};
  spec.view.azimuth_deg = 30;
  spec.background = render::Color{0.1F, 0, 1};
  spec.transfer = render::TransferFunction{{{0.5, {1, 0.25F, 0}, 0.1F}}};
  spec.weighting = render::Weighting{render::Weighting::Kind::kFalloff, 0.05};
  spec.smoothing = render::Smoothing::kImage;
  spec.reconstruction = Reconstruction::kFast;
  spec.basis = render::Basis::kBspline;
  spec.encoding = Encoding::kRawRgbaF32;
  const auto expected = nlohmann::json::parse(R"({
    "rate": 40.0, "encoding": "RAW_RGBA_F32", "fovea_marker": false, "strict": false,
    "fovea": {"at": {"x": 1.0, "y": 2.0, "z": 3.0}, "space": "SPACE_WORLD"},
    "view": {"orthographic": {"azimuth_deg": 30.0}},
    "background": {"red": 0.1, "green": 0.0, "blue": 1.0},
    "transfer_function": {"points": [
      {"value": 0.5, "color": {"red": 1.0, "green": 0.25, "blue": 0.0}, "opacity": 0.1}]},
    "weighting": {"kind": "FALLOFF", "falloff_per_voxel": 0.05},
    "reconstruction": "RECONSTRUCTION_FAST", "smoothing": "SMOOTHING_IMAGE",
    "basis": "BASIS_BSPLINE"})");
  EXPECT_EQ(SpecToJson(spec), expected) << SpecToJson(spec).dump(1);
}

TEST(SpecJson, APerspectiveViewHasTheProtosNames) {
  FrameSpec spec;
  spec.view.perspective = PerspectiveSpec{{{1, 2, 3}}, {}, Vec3{0, 1, 0}, 50};
  EXPECT_EQ(SpecToJson(spec)["view"], nlohmann::json::parse(R"({"perspective": {
    "eye": {"at": {"x": 1.0, "y": 2.0, "z": 3.0}, "space": "SPACE_VOXEL"},
    "up": {"x": 0.0, "y": 1.0, "z": 0.0}, "fov_y_deg": 50.0}})"));
}

TEST(SpecJson, WhatShadesCutsAndColours) {
  FrameSpec spec;
  spec.compositing = render::Compositing::kMaximum;
  spec.lighting = render::Lighting{true, 0.1F, 0.5F, 0.2F, 8, {1, 0, -1}};
  spec.clip.box = ClipBox{{1, 2, 3}, {4, 5, 6}, false};
  spec.clip.planes = {{{0, 1, 0}, 2.5, true}};
  spec.color_field = "heat";
  spec.color_transfer = render::TransferFunction{{{0.5, {1, 0, 0}, 1}}};
  spec.mode = Mode::kFused;
  const auto expected = nlohmann::json::parse(R"({
    "encoding": "PNG", "fovea_marker": false, "strict": false, "view": {"orthographic": {}},
    "compositing": "COMPOSITING_MAXIMUM",
    "lighting": {"ambient": 0.1, "diffuse": 0.5, "specular": 0.2, "shininess": 8,
                 "to_light": {"x": 1.0, "y": 0.0, "z": -1.0}},
    "clip": {"box": {"lower": {"x": 1.0, "y": 2.0, "z": 3.0},
                     "upper": {"x": 4.0, "y": 5.0, "z": 6.0}, "space": "SPACE_VOXEL"},
             "planes": [{"normal": {"x": 0.0, "y": 1.0, "z": 0.0}, "offset": 2.5,
                         "space": "SPACE_WORLD"}]},
    "color_field": "heat",
    "color_transfer_function": {"points": [
      {"value": 0.5, "color": {"red": 1.0, "green": 0.0, "blue": 0.0}, "opacity": 1.0}]},
    "mode": "MODE_FUSED"})");
  EXPECT_EQ(SpecToJson(spec), expected) << SpecToJson(spec).dump(1);
}

TEST(FrameJson, LeavesThePixelsOut) {
  Frame frame;
  frame.dataset = "lab/plume";
  frame.pixels = "secret";
  frame.frame_number = 21;
  frame.stats.coefficients = 5;
  frame.warnings.push_back({"damaged", 2});
  const nlohmann::json value = FrameToJson(frame);
  EXPECT_EQ(value["frame_number"], 21);
  EXPECT_EQ(value["stats"]["coefficients"], 5);
  EXPECT_EQ(value["warnings"][0]["count"], 2);
  EXPECT_EQ(value.dump().find("secret"), std::string::npos);
}

}  // namespace
}  // namespace fovea::frames
