#ifndef SERVICE_SERVER_FRAME_JOB_H_
#define SERVICE_SERVER_FRAME_JOB_H_

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "engine/base/status.h"
#include "fovea/v1/render.pb.h"
#include "service/frames/spec.h"
#include "service/server/catalogue.h"

namespace fovea::server {

/// What one frame may cost on a server, whoever asks.
inline constexpr int64_t kMaxPixelsPerFrame = int64_t{1} << 25;
inline constexpr int64_t kMaxSuperVoxelsPerFrame = int64_t{1} << 28;

/// A frame that can be rendered: everything about it but the step is known and admitted.
struct FrameJob {
  std::shared_ptr<ServedDataset> dataset;
  frames::FrameSpec spec;  // resolved
  int64_t pixels = 0;
  int64_t render_bytes = 0;  // memory while it is rendered
  int64_t reply_bytes = 0;   // an upper bound of the encoded frame
};

/// The step that a request names: the last one not after `time_ns`, else `step`. OUT_OF_RANGE,
/// saying which there are.
[[nodiscard]] StatusOr<int64_t> ChooseStep(const std::string& dataset_name, store::Dataset& dataset,
                                           uint64_t step, std::optional<int64_t> time_ns);

/// Looks the dataset up, fills in its defaults, and checks what the frame will cost. Reads the
/// disk. RESOURCE_EXHAUSTED, with the limit, for a frame above the limits.
[[nodiscard]] StatusOr<FrameJob> PrepareFrame(Catalogue& catalogue, const std::string& dataset,
                                              const frames::FrameSpec& spec);

/// The same for a dataset that is known. Reads the disk only for what neither `spec` nor `defaults`
/// says: the defaults of another field, the transfer function of a color_field.
[[nodiscard]] StatusOr<FrameJob> PrepareFrame(std::shared_ptr<ServedDataset> dataset,
                                              const frames::FrameSpec& spec,
                                              const frames::FrameSpec& defaults);

/// Renders one step and makes the message of it.
[[nodiscard]] StatusOr<v1::Frame> RenderJob(const FrameJob& job, int64_t step, uint64_t index,
                                            int threads);

}  // namespace fovea::server

#endif  // SERVICE_SERVER_FRAME_JOB_H_
