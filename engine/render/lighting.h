#ifndef ENGINE_RENDER_LIGHTING_H_
#define ENGINE_RENDER_LIGHTING_H_

#include "engine/render/renderer.h"
#include "engine/render/slab_kernel.h"
#include "engine/render/view.h"

namespace fovea::render {

/// The light as kernels use it, in the axes of the view's slices. A gradient of a 1/50 of the
/// transfer function's range per super-voxel is where surfaces begin.
[[nodiscard]] KernelLight MakeLight(const Lighting& lighting, const TransferFunction& transfer,
                                    const ShearView& view, const Matrix4& index_to_world);

}  // namespace fovea::render

#endif  // ENGINE_RENDER_LIGHTING_H_
