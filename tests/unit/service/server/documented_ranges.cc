#include "tests/unit/service/server/documented_ranges.h"

#include <limits>
#include <map>

namespace fovea::server {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr int kSteps = 5;

// The ranges that proto/fovea/v1 documents, in its order; dimensions are those of "plume".
const Rule kRules[] = {
    {"dataset", Is::kName},
    {"step", Is::kStep, 0, kSteps},
    {"time_ns", Is::kTime},
    {"spec.field", Is::kName},
    {"spec.view.orthographic.azimuth_deg", Is::kFinite},
    {"spec.view.orthographic.elevation_deg", Is::kRange, -90, 90},
    {"spec.view.orthographic.center.at.*", Is::kFinite},
    {"spec.view.orthographic.center.space", Is::kEnum},
    {"spec.view.orthographic.span_voxels", Is::kAbove, 0},
    {"spec.view.perspective.eye", Is::kNeeded},
    {"spec.view.perspective.eye.at.*", Is::kRange, -1e9, 1e9},
    {"spec.view.perspective.eye.space", Is::kEnum},
    {"spec.view.perspective.target.at.*", Is::kRange, -1e9, 1e9},
    {"spec.view.perspective.target.space", Is::kEnum},
    {"spec.view.perspective.up.*", Is::kFinite},
    {"spec.view.perspective.fov_y_deg", Is::kRange, 0.01, 170},
    {"spec.fovea.at.x", Is::kRange, 0, 40},
    {"spec.fovea.at.y", Is::kRange, 0, 36},
    {"spec.fovea.at.z", Is::kRange, 0, 30},
    {"spec.fovea.space", Is::kEnum},
    {"spec.rate", Is::kRange, 1, 65536},
    {"spec.transfer_function.points", Is::kCount, 1, 4096},
    {"spec.transfer_function.points[].value", Is::kFinite},
    {"spec.transfer_function.points[].color.*", Is::kRange, 0, 1},
    {"spec.transfer_function.points[].opacity", Is::kRange, 0, 1},
    {"spec.weighting.kind", Is::kEnum},
    {"spec.weighting.falloff_per_voxel", Is::kRange, 0, 1e6},
    {"spec.smoothing", Is::kEnum},
    {"spec.width_px", Is::kRange, 1, 16384},
    {"spec.height_px", Is::kRange, 1, 16384},
    {"spec.encoding", Is::kEnum},
    {"spec.jpeg_quality", Is::kRange, 1, 100},
    {"spec.background.*", Is::kRange, 0, 1},
    {"spec.fovea_marker", Is::kAny},
    {"spec.strict", Is::kAny},
    {"spec.window", Is::kEnum},
    {"spec.rate_xyz.*", Is::kRange, 1, 65536},
    {"spec.reconstruction", Is::kEnum},
    {"spec.basis", Is::kEnum},
    {"spec.compositing", Is::kEnum},
    {"spec.lighting.ambient", Is::kRange, 0, 1},
    {"spec.lighting.diffuse", Is::kRange, 0, 1},
    {"spec.lighting.specular", Is::kRange, 0, 1},
    {"spec.lighting.shininess", Is::kPowerOf2, 1, 256},
    {"spec.lighting.to_light.*", Is::kFinite},
    {"spec.clip.box.lower.*", Is::kFinite},
    {"spec.clip.box.upper", Is::kNeeded},
    {"spec.clip.box.upper.*", Is::kAbove, 1},
    {"spec.clip.box.space", Is::kEnum},
    {"spec.clip.planes", Is::kCount, 0, 6},
    {"spec.clip.planes[].normal", Is::kNeeded},
    {"spec.clip.planes[].normal.*", Is::kFinite},
    {"spec.clip.planes[].offset", Is::kFinite},
    {"spec.clip.planes[].space", Is::kEnum},
    {"spec.color_field", Is::kName},
    {"spec.color_transfer_function.points", Is::kCount, 1, 4096},
    {"spec.color_transfer_function.points[].value", Is::kFinite},
    {"spec.color_transfer_function.points[].color.*", Is::kRange, 0, 1},
    {"spec.color_transfer_function.points[].opacity", Is::kRange, 0, 1},
    {"spec.mode", Is::kEnum},
    {"steps.first", Is::kStep, 0, 4, "last"},
    {"steps.last", Is::kStep, 0, kSteps},
    {"steps.stride", Is::kRange, 1, kMost64},
    {"start_index", Is::kRange, 0, 4},
    {"window", Is::kRange, 0, 64},
    {"stream_id", Is::kWord},
    {"follow", Is::kAny},
    {"budget.total_ms", Is::kAbove, 0},
    {"budget.memory_bytes", Is::kRange, 1, kMost64},
    {"budget.bytes_read", Is::kRange, 1, kMost64},
    {"budget.coefficients", Is::kRange, 1, kMost64},
    {"first_frame_ms", Is::kRange, 1, 10'000},
    {"latest", Is::kAny},
    {"reset_spec", Is::kAny},
    {"view_id", Is::kAny},
    {"moving", Is::kAny},
    {"frame_budget_ms", Is::kRange, 1, 10'000},
    {"acknowledged", Is::kRange, -1, -1},
    {"Acknowledge:stream_id", Is::kName},
    {"Acknowledge:index", Is::kAny},  // of a stream that runs: sequence_test.cc
    {"page_size", Is::kRange, 0, 1000},
    {"page_token", Is::kWord},
    {"first_step", Is::kAny},
    {"wait", Is::kAny},
    {"WatchDataset:dataset", Is::kAny},  // the good one waits for those that are not there
    {"GetHistogram:field", Is::kName},
    {"held", Is::kCount, 0, 16},
    {"held[].step", Is::kStep, 0, kSteps},
    {"held[].fovea.x", Is::kRange, 0, 40},
    {"held[].fovea.y", Is::kRange, 0, 36},
    {"held[].fovea.z", Is::kRange, 0, 30},
    {"held[].rate_xyz", Is::kNeeded},
    {"held[].rate_xyz.*", Is::kRange, 1, 65536},
    {"held[].content", Is::kCount, 1, 1},
    {"resume_token", Is::kWord},
    {"IngestFiles:dataset", Is::kNewName},
    {"files", Is::kFile},
    {"raw", Is::kWord},
    {"grids", Is::kCount, 0, 64},
    {"field", Is::kText, 0, 64},
    {"IngestFiles:frames_per_second", Is::kRange, 1e-6, 1e6},
    {"on_missing", Is::kEnum},
    {"registration", Is::kEnum},
    {"wavelet", Is::kWord},
    {"lossless", Is::kAny},
    {"tolerance", Is::kAbove, 0},
    {"header.dataset", Is::kNewName},
    {"header.step", Is::kRange, 0, 999'999},
    {"header.time_ns", Is::kAny},
    {"header.frame_number", Is::kAny},  // but -2^63
    {"header.nx", Is::kRange, 1, 65536},
    {"header.ny", Is::kRange, 1, 65536},
    {"header.nz", Is::kRange, 1, 65536},
    {"UploadStep:header.fields", Is::kCount, 1, 64},
    {"header.fields[].name", Is::kNewName},
    {"header.fields[].type", Is::kWord, 0, 0, "header"},
    {"header.fields[].value_unit", Is::kText, 0, 64},
    {"header.index_to_world", Is::kAny},  // none or 16: upload_test.cc
    {"header.wavelet", Is::kWord, 0, 0, "header"},
    {"header.lossless", Is::kAny},
    {"header.series.id", Is::kWord, 0, 0, "header"},
    {"header.series.steps", Is::kRange, 1, 1'000'000},
    {"piece.field", Is::kRange, 0, 0},
    {"piece.offset", Is::kRange, 0, 0},
    {"piece.data", Is::kWord},
    {"header.durability", Is::kEnum},
    {"header.fields", Is::kCount, 0, 64},
    {"header.lower", Is::kNeeded},
    {"header.lower.*", Is::kFinite},
    {"header.upper", Is::kNeeded},
    {"header.upper.*", Is::kRange, 1, 65537, "voxel"},
    {"header.voxel", Is::kNeeded},
    {"header.voxel.*", Is::kAbove, 0},
    {"header.step_seconds", Is::kRange, 1e-9, 9.2e9},
    {"header.start_seconds", Is::kRange, -9.2e9, 9.2e9},
    {"header.watermark_seconds", Is::kRange, 0, 9.2e9},
    {"header.most_ahead", Is::kRange, 1, 10'000},
    {"header.on_missing", Is::kEnum},
    {"header.duplicates", Is::kEnum},
    {"header.least_value", Is::kRange, -kInfinity, 9, "greatest_value"},
    {"header.greatest_value", Is::kRange, -1, kInfinity},
    {"header.reach_voxels", Is::kRange, 1, 1099511627776.0},
    {"header.background", Is::kRange, -1e37, 1e37},
    {"header.world_unit", Is::kText, 0, 64},
    {"header.value_unit", Is::kText, 0, 64},
    {"header.clock", Is::kText, 0, 256},
    {"header.chunk_edge", Is::kWord},
    {"batch.sequence", Is::kRange, 1, kMost64},
    {"batch.time_ns", Is::kCount, 2, 2, "x"},
    {"batch.x", Is::kCount, 2, 2},
    {"batch.y", Is::kCount, 2, 2},
    {"batch.z", Is::kCount, 2, 2},
    {"batch.value", Is::kCount, 2, 2},
    {"batch.complete_before_ns", Is::kAny},
    {"batch.last", Is::kAny},
    {"output", Is::kFile},
    {"animation_json", Is::kWord},
    {"CreateExport:frames_per_second", Is::kRange, 0.01, 1000},
    {"overwrite", Is::kAny},
    {"id", Is::kName, 0, 0, "job"},
};

}  // namespace

const Rule* RuleOf(const std::string& method, const std::string& path) {
  static const auto* rules = [] {
    auto* all = new std::map<std::string, const Rule*>;
    for (const Rule& rule : kRules) {
      all->emplace(rule.path, &rule);
    }
    return all;
  }();
  const std::string any = path.substr(0, path.rfind('.') + 1) + "*";
  for (const std::string& name : {method + ":" + path, path, any}) {
    if (const auto found = rules->find(name); found != rules->end()) {
      return found->second;
    }
  }
  return nullptr;
}

}  // namespace fovea::server
