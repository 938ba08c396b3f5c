#include "tests/unit/service/server/good_requests.h"

#include <filesystem>
#include <utility>

#include <google/protobuf/text_format.h>
#include <gtest/gtest.h>

#include "fovea/v1/coefficients.pb.h"
#include "fovea/v1/datasets.pb.h"
#include "fovea/v1/ingest.pb.h"
#include "fovea/v1/jobs.pb.h"
#include "fovea/v1/render.pb.h"

namespace fovea::server {
namespace {

/// Two views that together have every field of a FrameSpec.
constexpr char kOrthographic[] = R"(
  field: "density"
  view { orthographic { azimuth_deg: 30 elevation_deg: 20 span_voxels: 60
                        center { at { x: 20 y: 18 z: 15 } space: SPACE_VOXEL } } }
  fovea { at { x: 20 y: 18 z: 15 } space: SPACE_VOXEL }
  rate: 12
  transfer_function { points { value: 0 color { red: 0.1 green: 0.2 blue: 0.3 } opacity: 0.1 }
                      points { value: 1 color { red: 0.5 green: 0.6 blue: 0.7 } opacity: 0.5 } }
  weighting { kind: FALLOFF falloff_per_voxel: 0.1 }
  smoothing: SMOOTHING_FULL width_px: 32 height_px: 24 encoding: JPEG jpeg_quality: 80
  background { red: 0.1 green: 0.2 blue: 0.3 }
  fovea_marker: true strict: true window: WINDOW_CUBE reconstruction: RECONSTRUCTION_EXACT
  basis: BASIS_BILINEAR compositing: COMPOSITING_EMISSION
  lighting { ambient: 0.3 diffuse: 0.7 specular: 0.2 shininess: 16 to_light { x: 1 y: 2 z: 3 } }
  clip { box { lower { x: 1 y: 1 z: 1 } upper { x: 30 y: 30 z: 30 } space: SPACE_VOXEL }
         planes { normal { x: 1 y: 0.5 z: 0.5 } offset: -5 space: SPACE_VOXEL } }
  mode: MODE_TWO_PHASE)";
constexpr char kColor[] = R"(
  color_field: "density"
  color_transfer_function { points { value: 0 color { red: 0.1 green: 0.2 blue: 0.3 } opacity: 0.1 } })";
constexpr char kPerspective[] = R"(
  view { perspective { eye { at { x: -50 y: 18 z: 15 } space: SPACE_VOXEL }
                       target { at { x: 20 y: 18 z: 15 } space: SPACE_VOXEL }
                       up { x: 0.1 y: 0.2 z: 1 } fov_y_deg: 45 } }
  rate_xyz { x: 12 y: 10 z: 8 } width_px: 32 height_px: 24)";

constexpr char kHeader[] = R"(header {
  dataset: "live" durability: COMMITTED fields: "value"
  lower { x: 1 y: 1 z: 1 } upper { x: 17 y: 17 z: 17 } voxel { x: 1 y: 1 z: 1 }
  step_seconds: 0.1 start_seconds: 1 watermark_seconds: 0.5 most_ahead: 100 on_missing: SKIP
  duplicates: LAST least_value: -1 greatest_value: 9 reach_voxels: 8 background: 0.5
  world_unit: "m" value_unit: "K" clock: "since the start" chunk_edge: 16 })";
constexpr char kUpload[] = R"(header {
  dataset: "up" step: 0 time_ns: 5 frame_number: 3 nx: 2 ny: 2 nz: 3
  fields { name: "density" type: "uint8" value_unit: "K" }
  index_to_world: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1] world_unit: "m"
  wavelet: "haar" lossless: true chunk_edge: 16 series { id: "0123456789abcdef" steps: 4 } })";
constexpr char kPiece[] = R"(piece { field: 0 offset: 0 data: "twelve bytes" })";
constexpr char kBatch[] = R"(batch {
  sequence: 1 time_ns: 1100000000 time_ns: 1100000000 x: 2 x: 3 y: 2 y: 3 z: 2 z: 3 value: 1 value: 2
  complete_before_ns: 1200000000 last: true })";

/// `%o` and `%p` stand for the two specs, `%g` for the first without colours of its own.
std::string Expand(std::string text) {
  for (const auto& [mark, spec] :
       {std::pair("%o", std::string(kOrthographic) + kColor),
        std::pair("%g", std::string(kOrthographic)), std::pair("%p", std::string(kPerspective))}) {
    for (size_t at = 0; (at = text.find(mark)) != std::string::npos;) {
      text.replace(at, 2, "spec {" + spec + "}");
    }
  }
  return text;
}

/// With every service linked, whatever else the program uses.
const google::protobuf::DescriptorPool& Pool() {
  for (const auto* type :
       {v1::GetDatasetRequest::descriptor(), v1::RenderFrameRequest::descriptor(),
        v1::StreamCoefficientsRequest::descriptor(), v1::IngestFilesRequest::descriptor(),
        v1::GetJobRequest::descriptor()}) {
    EXPECT_NE(type->file()->service_count(), 0);
  }
  return *google::protobuf::DescriptorPool::generated_pool();
}

GoodRequest Make(const std::string& method, const std::vector<std::string>& messages,
                 absl::StatusCode code = absl::StatusCode::kOk) {
  GoodRequest request;
  request.code = code;
  request.method = Pool().FindMethodByName("fovea.v1." + method);
  EXPECT_NE(request.method, nullptr) << method;
  for (const std::string& text : messages) {
    std::shared_ptr<google::protobuf::Message> message(
        google::protobuf::MessageFactory::generated_factory()
            ->GetPrototype(request.method->input_type())
            ->New());
    EXPECT_TRUE(google::protobuf::TextFormat::ParseFromString(Expand(text), message.get()))
        << method;
    request.messages.push_back(std::move(message));
  }
  return request;
}

}  // namespace

std::vector<GoodRequest> GoodRequests() {
  constexpr auto kNotFound = absl::StatusCode::kNotFound;
  const std::string plume = R"(dataset: "plume" )";
  return {
      Make("Render.RenderFrame", {plume + "step: 3 %o"}),
      Make("Render.RenderFrame", {plume + "time_ns: 9000000000 %p"}),
      Make("Render.RenderSequence",
           {plume + "steps { first: 0 last: 3 stride: 1 } %o start_index: 1 window: 2 "
                    "stream_id: '0123456789abcdef'"}),
      Make("Render.RenderSequence", {plume + "steps { first: 0 } follow: true %p"}),
      Make("Render.RenderSequence",
           {plume + "%o path { frames: 9 keys { frame: 0 view { azimuth_deg: 30 elevation_deg: 20 }"
                    " span_voxels: 60 fovea { x: 20 y: 18 z: 15 } rate: 12 step: 1 } }"}),
      Make("Render.RenderSequence",
           {plume + "%p path { frames: 9 keys { frame: 1 eye { x: -50 y: 18 z: 15 } fov_y_deg: 45 }"
                    " keys { frame: 5 target { x: 20 y: 18 z: 15 } up { x: 0.1 y: 0.2 z: 1 } } }"}),
      Make("Render.RefineFrame", {plume + "step: 3 %o first_frame_ms: 5"}),
      Make("Render.RefineFrame", {plume + "time_ns: 9000000000 %p"}),
      Make("Render.Explore", {plume + "step: 3 %o view_id: 7 moving: true frame_budget_ms: 5 "
                                      "window: 2 reset_spec: true"}),
      Make("Render.Explore", {plume + "latest: true %p", "time_ns: 9000000000"}),
      Make("Render.PlanFrame",
           {plume + "step: 3 %g budget { total_ms: 1000 memory_bytes: 1000000000 "
                    "bytes_read: 1000000000 coefficients: 1000000 }"}),
      Make("Render.PlanFrame", {plume + "time_ns: 9000000000"}),
      Make("Render.Acknowledge", {"stream_id: '0123456789abcdef' index: 1"}, kNotFound),
      Make("Datasets.ListDatasets", {"page_size: 10 page_token: 'after:a'"}),
      Make("Datasets.GetDataset", {plume}),
      Make("Datasets.WatchDataset", {plume + "first_step: 2 wait: true"}),
      Make("Datasets.GetHistogram", {plume + "step: 3 field: 'density'"}),
      Make("Datasets.GetHistogram", {plume + "time_ns: 9000000000"}),
      Make("Datasets.DeleteDataset", {"dataset: 'no-such'"}, kNotFound),
      Make("Coefficients.StreamCoefficients", {plume + "step: 3 %o"}),
      Make("Coefficients.StreamCoefficients",
           {plume +
            "time_ns: 9000000000 spec { rate: 12 } held { step: 3 fovea { x: 20 y: 18 z: 15 }"
            " rate_xyz { x: 8 y: 8 z: 8 } content: 1 }"},
           absl::StatusCode::kFailedPrecondition),
      Make("Coefficients.StreamCoefficients", {plume + "spec { rate: 12 } resume_token: 'x'"},
           absl::StatusCode::kInvalidArgument),
      Make("Ingest.UploadStep", {kUpload, kPiece}),
      Make("Ingest.StreamReadings", {kHeader}),
      Make("Ingest.StreamReadings", {kHeader, kBatch}),
      Make("Ingest.IngestFiles",
           {"dataset: 'made' files: 'a_#.raw' raw: '16x16x16:uint8:le' grids: 'density' "
            "field: 'smoke' frames_per_second: 24 on_missing: SKIP registration: SAME "
            "wavelet: 'haar' lossless: false tolerance: 0.5"}),
      Make("Jobs.CreateExport",
           {plume + "output: 'shot/f.##.png' steps { first: 0 last: 3 stride: 1 } %o "
                    "animation_json: '{\"frames\": 2, \"keys\": [{\"frame\": 1, \"rate\": 9}]}' "
                    "frames_per_second: 24 overwrite: true"}),
      Make("Jobs.GetJob", {"id: 'no-such'"}, kNotFound),
      Make("Jobs.ListJobs", {"page_size: 10 page_token: 'after:7'"}),
      Make("Jobs.WatchJob", {"id: 'no-such'"}, kNotFound),
      Make("Jobs.CancelJob", {"id: 'no-such'"}, kNotFound),
  };
}

std::vector<const google::protobuf::MethodDescriptor*> AllMethods() {
  std::vector<const google::protobuf::MethodDescriptor*> methods;
  for (const auto& entry :
       std::filesystem::directory_iterator(FOVEA_SOURCE_DIR "/proto/fovea/v1")) {
    const std::string name = "fovea/v1/" + entry.path().filename().string();
    const auto* file = Pool().FindFileByName(name);
    EXPECT_NE(file, nullptr) << name << " is not linked";
    for (int i = 0; file != nullptr && i < file->service_count(); ++i) {
      for (int k = 0; k < file->service(i)->method_count(); ++k) {
        methods.push_back(file->service(i)->method(k));
      }
    }
  }
  return methods;
}

}  // namespace fovea::server
