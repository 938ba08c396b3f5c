#ifndef SERVICE_FRAMES_FRAMES_H_
#define SERVICE_FRAMES_FRAMES_H_

#include <optional>
#include <string>

#include "engine/base/status.h"
#include "engine/fovea/coefficient_source.h"
#include "engine/render/plan.h"
#include "engine/store/dataset.h"
#include "service/frames/spec.h"
#include "service/frames/volume_cache.h"

/// From a dataset and a spec to the bytes of a frame. The command line and the server both come
/// through here, so that they give the same pictures. Thread-safe.
namespace fovea::frames {

/// INVALID_ARGUMENT naming field, value and range, for whatever can be told without a dataset.
[[nodiscard]] Status ValidateSpec(const FrameSpec& spec);

/// The dataset's own defaults, everything filled in: default field, fovea at the densest region
/// seen over the series, rate, view, transfer function over the series' value range. Reads
/// statistics and coarse levels of at most 16 steps. FAILED_PRECONDITION without a step.
[[nodiscard]] StatusOr<FrameSpec> DefaultSpec(store::Dataset& dataset);

/// `spec` with what it left out taken from `defaults`, positions in voxels, checked against the
/// dataset. A field other than the default one gets its own transfer function and fovea; a fovea
/// that nobody chose and the view or the clip does not show moves to what they show. Errors as
/// ValidateSpec; NOT_FOUND for an unknown field, listing those there are.
[[nodiscard]] StatusOr<FrameSpec> ResolveSpec(store::Dataset& dataset, const FrameSpec& spec,
                                              const FrameSpec& defaults);

/// Fills in what a perspective view leaves out, its positions in voxels. INVALID_ARGUMENT naming
/// field, value and range.
[[nodiscard]] Status ResolveCamera(const store::DatasetInfo& info, PerspectiveSpec* view);

/// About the bytes that a frame holds while it is rendered, its encoding left out.
[[nodiscard]] double FrameBytes(const store::DatasetInfo& info, const RetainedSet& retained,
                                const FrameSpec& resolved);

/// An upper bound of the bytes of the frame in Encoding::kFoveated.
[[nodiscard]] int64_t MostFoveatedBytes(const store::DatasetInfo& info, const RetainedSet& retained,
                                        const FrameSpec& resolved);

/// What the renderer is told for a spec that came from ResolveSpec.
[[nodiscard]] render::RenderSettings RenderSettingsOf(const FrameSpec& resolved, int threads);

/// A warning if `retained` reaches outside the windows that the dataset keeps detail in.
[[nodiscard]] std::optional<Warning> RetentionWarning(const store::DatasetInfo& info,
                                                      const RetainedSet& retained);

/// A warning if chunks of `field` at `step` were damaged.
[[nodiscard]] std::optional<Warning> DamageWarning(const store::ReadStats& read,
                                                   const std::string& field, int64_t step);

/// Coefficients that a frame is made of: those of its field, and of its color_field, or null.
struct FrameCoefficients {
  CoefficientSource* value = nullptr;
  CoefficientSource* color = nullptr;
};

/// Reconstructs, renders and encodes: `used`, size, encoding, pixels and statistics of a frame; who
/// gave the coefficients knows the rest. `info`: hierarchy and index_to_world are looked at, and
/// retention. Errors as RenderFrame, but for the step's.
[[nodiscard]] StatusOr<Frame> RenderCoefficients(const FrameCoefficients& coefficients,
                                                 const store::DatasetInfo& info,
                                                 const FrameSpec& resolved, int threads);

/// Reads, reconstructs, renders and encodes. `resolved` must come from ResolveSpec. The picture
/// does not depend on `threads` (0: all processors), nor on whether volumes are `shared` with other
/// frames; a two-phase frame whose volume is there already reads nothing, and its statistics say
/// so. OUT_OF_RANGE for a step that is not there, RESOURCE_EXHAUSTED for what the machine's memory
/// could not hold.
[[nodiscard]] StatusOr<Frame> RenderFrame(store::Dataset& dataset, const std::string& dataset_name,
                                          int64_t step, const FrameSpec& resolved, int threads,
                                          const SharedVolumes& shared = {});

/// What the frame of `resolved`, an orthographic view, counts and holds in memory while it is
/// rendered.
[[nodiscard]] render::FrameCounts CountFrame(const store::DatasetInfo& info,
                                             const RetainedSet& retained,
                                             const FrameSpec& resolved);

/// The step a time falls on: the last one not after it. OUT_OF_RANGE before the first.
[[nodiscard]] StatusOr<int64_t> StepAtTime(store::Dataset& dataset, int64_t time_ns);

}  // namespace fovea::frames

#endif  // SERVICE_FRAMES_FRAMES_H_
