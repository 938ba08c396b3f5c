#ifndef SERVICE_FRAMES_LEAF_PLANES_H_
#define SERVICE_FRAMES_LEAF_PLANES_H_

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "engine/base/status.h"
#include "engine/render/foveated_frame.h"

/// Leaf values of a FOVEATED frame as planes of bytes and back: "Values" of
/// docs/formats/foveated-frame.md.
namespace fovea::frames {

/// A plane for the high and the low bytes of each of four channels.
inline constexpr size_t kLeafPlanes = 8;

/// The levels of all images of a frame, in order.
using LevelsOfFrame = std::vector<const render::FrameLevel*>;

[[nodiscard]] size_t CountLeaves(const LevelsOfFrame& levels);

/// `to` has kLeafPlanes * CountLeaves(levels) bytes.
void WriteLeafPlanes(const LevelsOfFrame& levels, int bits, std::span<uint8_t> to);

/// Fills the leaves of levels whose kinds are there. `planes` has as many bytes as were written.
/// DATA_LOSS for a value outside its range.
[[nodiscard]] Status ReadLeafPlanes(std::span<const uint8_t> planes, int bits,
                                    const std::vector<render::FrameLevel*>& levels);

}  // namespace fovea::frames

#endif  // SERVICE_FRAMES_LEAF_PLANES_H_
