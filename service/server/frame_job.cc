#include "service/server/frame_job.h"

#include <algorithm>
#include <utility>

#include "engine/fovea/retained_set.h"
#include "service/frames/frames.h"
#include "service/wire/convert.h"
#include "service/wire/requests.h"
#include "service/wire/status.h"

namespace fovea::server {
namespace {

/// No compressed picture is larger than this per pixel.
constexpr int64_t kCompressedBytesPerPixel = 4;
/// The picture's bytes, and what an encoder holds besides them.
constexpr int64_t kEncoderBytesPerPixel = 12;
/// Spec, statistics, bookkeeping.
constexpr int64_t kReplyOverheadBytes = int64_t{256} << 10;

Status CheckCost(int64_t pixels, int64_t super_voxels, const frames::FrameSpec& spec) {
  if (pixels > kMaxPixelsPerFrame) {
    return ResourceExhausted(
        "width_px {} x height_px {} is {} pixels; this server's limit is {} a frame",
        *spec.width_px, *spec.height_px, pixels, kMaxPixelsPerFrame);
  }
  if (super_voxels > kMaxSuperVoxelsPerFrame) {
    return ResourceExhausted(
        "rate {} makes {} super-voxels; this server's limit is {} a frame; ask for a smaller rate",
        FormatRate(*spec.rate), super_voxels, kMaxSuperVoxelsPerFrame);
  }
  return absl::OkStatus();
}

}  // namespace

StatusOr<int64_t> ChooseStep(const std::string& dataset_name, store::Dataset& dataset,
                             uint64_t step, std::optional<int64_t> time_ns) {
  if (time_ns) {
    return frames::StepAtTime(dataset, *time_ns);
  }
  FOVEA_RETURN_IF_ERROR(wire::CheckStep(dataset_name, step, dataset.info().committed_steps));
  return static_cast<int64_t>(step);
}

StatusOr<FrameJob> PrepareFrame(Catalogue& catalogue, const std::string& dataset,
                                const frames::FrameSpec& spec) {
  FOVEA_ASSIGN_OR_RETURN(auto served, catalogue.Find(dataset));
  FOVEA_RETURN_IF_ERROR(wire::CheckStep(dataset, 0, served->dataset().info().committed_steps));
  FOVEA_ASSIGN_OR_RETURN(const frames::FrameSpec defaults, served->DefaultSpec());
  return PrepareFrame(std::move(served), spec, defaults);
}

StatusOr<FrameJob> PrepareFrame(std::shared_ptr<ServedDataset> dataset,
                                const frames::FrameSpec& spec, const frames::FrameSpec& defaults) {
  FrameJob job;
  job.dataset = std::move(dataset);
  store::Dataset& store = job.dataset->dataset();
  const store::DatasetInfo info = store.info();
  auto resolved = frames::ResolveSpec(store, spec, defaults);
  FOVEA_RETURN_IF_ERROR(wire::PointAtSpecField(resolved.status(), "spec"));
  job.spec = *std::move(resolved);

  const auto retained = RetainedSet::Make(info.hierarchy, frames::FoveaOf(job.spec));
  FOVEA_RETURN_IF_ERROR(wire::PointAtSpecField(retained.status(), "spec"));
  const int64_t super_voxels = retained->SuperVoxelCount();
  job.pixels = *job.spec.width_px * *job.spec.height_px;
  FOVEA_RETURN_IF_ERROR(CheckCost(job.pixels, super_voxels, job.spec));
  job.render_bytes = static_cast<int64_t>(frames::FrameBytes(info, *retained, job.spec)) +
                     kEncoderBytesPerPixel * job.pixels;
  const int64_t pixel_bytes =
      std::max(kCompressedBytesPerPixel, wire::RawPixelBytes(job.spec.encoding));
  job.reply_bytes =
      kReplyOverheadBytes + (job.spec.encoding == frames::Encoding::kFoveated
                                 ? frames::MostFoveatedBytes(info, *retained, job.spec)
                                 : pixel_bytes * job.pixels);
  return job;
}

StatusOr<v1::Frame> RenderJob(const FrameJob& job, int64_t step, uint64_t index, int threads) {
  auto rendered = frames::RenderFrame(job.dataset->dataset(), job.dataset->name(), step, job.spec,
                                      threads, job.dataset->volumes());
  FOVEA_RETURN_IF_ERROR(job.dataset->CheckPresent());
  FOVEA_ASSIGN_OR_RETURN(frames::Frame frame, std::move(rendered));
  frame.index = index;
  if (static_cast<int64_t>(frame.pixels.size()) > wire::kMaxFrameBytes) {
    return ResourceExhausted(
        "the encoded frame has {} bytes, above the {} that a frame may have; ask for {}",
        frame.pixels.size(), wire::kMaxFrameBytes,
        frame.encoding == frames::Encoding::kFoveated ? "a lower rate" : "fewer pixels");
  }
  return wire::ToProto(std::move(frame));
}

}  // namespace fovea::server
