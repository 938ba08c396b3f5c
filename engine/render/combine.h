#ifndef ENGINE_RENDER_COMBINE_H_
#define ENGINE_RENDER_COMBINE_H_

#include <vector>

#include "engine/render/foveated_frame.h"
#include "engine/render/thick_ray.h"

namespace fovea::render {

/// Buffers of Combine, to be reused.
struct CombineScratch {
  std::vector<float> densities;
};

/// Passes F and K of every split pixel down to its children and composites: a leaf pixel becomes
/// F_0 over F_1 ... over F_leaf over K_leaf ... over K_0. With `smooth_splitting` the children take
/// what they inherit from the split pixels around, interpolated (ALGORITHM, smooth splitting).
/// The layers' F and K grow by what they inherit; `levels` are what they show.
void Combine(bool smooth_splitting, int threads, std::vector<Layer>* layers,
             CombineScratch* scratch, std::vector<FrameLevel>* levels);

}  // namespace fovea::render

#endif  // ENGINE_RENDER_COMBINE_H_
