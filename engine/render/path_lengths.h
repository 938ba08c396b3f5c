#ifndef ENGINE_RENDER_PATH_LENGTHS_H_
#define ENGINE_RENDER_PATH_LENGTHS_H_

#include <cstddef>

#include "engine/render/combine_kernels.h"
#include "engine/render/image.h"

/// In perspective every ray's path through a slice has its own length (Layer::path). What a pixel
/// has gathered is passed on to rays with other paths free of its thickness: T becomes T^ratio, and
/// C becomes C (1 - T^ratio) / (1 - T).
namespace fovea::render {

/// What the 2 `count` children of a run of parents inherit, from the parents' paths to their own;
/// depths too, which in perspective count paths.
void LengthenInherited(const float* parent_paths, const float* child_paths, size_t count,
                       Inheritance* inherited);

/// Values of a run of pixels, from their own paths to the common one, 1.
void TakeCommonPath(const float* paths, size_t count, Rgba* values);

/// A value on a path `ratio` times as long.
[[nodiscard]] Rgba Lengthened(const Rgba& value, float ratio);

}  // namespace fovea::render

#endif  // ENGINE_RENDER_PATH_LENGTHS_H_
