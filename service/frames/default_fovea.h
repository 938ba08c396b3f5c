#ifndef SERVICE_FRAMES_DEFAULT_FOVEA_H_
#define SERVICE_FRAMES_DEFAULT_FOVEA_H_

#include <cstdint>
#include <functional>
#include <string>

#include "engine/base/status.h"
#include "engine/store/dataset.h"
#include "service/frames/spec.h"

/// Where the fovea lies when nobody said. Nothing here depends on the size of the picture, so that
/// whoever asks a server chooses as the server does.
namespace fovea::frames {

/// Whether a place, in voxels, will do.
using Accepts = std::function<bool(const Vec3&)>;

/// Where most was measured, if the dataset knows that; else the densest region of `field` at `step`
/// whose statistics are `stats`; of what `accepts` takes, if it takes anything. If detail is not
/// kept there at the default rate: the middle of the nearest window in which it is.
[[nodiscard]] StatusOr<Vec3> DefaultFoveaOfStep(store::Dataset& dataset, int64_t step,
                                                const std::string& field, const FieldStats& stats,
                                                const Accepts& accepts);

/// What a picture shows: not clipped, before the camera, and in the middle square of the picture.
/// `resolved` has its view, in voxels; it and `info` must outlive the result.
[[nodiscard]] Accepts ShownBy(const store::DatasetInfo& info, const FrameSpec& resolved);

/// A place in the volume that `shown` takes though no dense region is there: the middle of what is
/// cut out, or of the picture; `densest` if those are not shown either.
[[nodiscard]] Vec3 MiddleOfShown(const store::DatasetInfo& info, const FrameSpec& resolved,
                                 const Accepts& shown, const Vec3& densest);

}  // namespace fovea::frames

#endif  // SERVICE_FRAMES_DEFAULT_FOVEA_H_
