#ifndef ENGINE_RENDER_FRAME_SCRATCH_H_
#define ENGINE_RENDER_FRAME_SCRATCH_H_

#include "engine/render/combine.h"
#include "engine/render/expand.h"
#include "engine/render/foveated_frame.h"
#include "engine/render/thick_ray.h"

namespace fovea::render {

/// What the frames of one viewer can share: buffers that keep their capacity from frame to frame,
/// so that frames of the same shape allocate nothing. Any frame may follow any other. For one
/// frame at a time; frames rendered at the same time need one each.
struct FrameScratch {
  TraceScratch trace;
  CombineScratch combine;
  FoveatedFrame frame;
  ExpandScratch expand;
};

}  // namespace fovea::render

#endif  // ENGINE_RENDER_FRAME_SCRATCH_H_
