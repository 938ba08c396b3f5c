#ifndef SERVICE_FRAMES_FOVEATED_PICTURE_H_
#define SERVICE_FRAMES_FOVEATED_PICTURE_H_

#include <array>
#include <optional>
#include <string>
#include <variant>

#include "engine/render/foveated_frame.h"
#include "engine/render/image.h"
#include "engine/render/perspective.h"
#include "engine/render/transfer_function.h"
#include "service/frames/spec.h"

/// A picture before it is expanded: all that the picture follows from. The server encodes it, and
/// whoever expands it gets the same picture (docs/formats/foveated-frame.md).
namespace fovea::frames {

/// Column and row of the red dot's centre, in pixels.
using Marker = std::array<double, 2>;

struct FoveatedPicture {
  std::variant<render::FoveatedFrame, render::PerspectiveFrame> frame;
  render::Smoothing smoothing = render::Smoothing::kFull;
  render::Basis basis = render::Basis::kBilinear;
  render::Color background;
  std::optional<Marker> marker;

  [[nodiscard]] int width_px() const;
  [[nodiscard]] int height_px() const;
};

/// Holds leaf values to what FOVEATED sends. Pictures of 8 bits come from these, so that they are
/// the same wherever they are expanded. RAW_RGBA_F32 comes from leaf values as they are.
void SnapLeaves(FoveatedPicture* picture, int threads);

/// Smoothed and warped, without background and marker.
[[nodiscard]] render::Image ExpandImage(FoveatedPicture picture, int threads);

/// Encode, with the marker where pictures have 8 bits.
[[nodiscard]] StatusOr<std::string> EncodeMarked(render::Image image,
                                                 const std::optional<Marker>& marker,
                                                 Encoding encoding, const render::Color& background,
                                                 int jpeg_quality);

/// `foveated`, a frame of Encoding::kFoveated, as the server would have sent it in `encoding`: in
/// RAW_RGBA8, PNG and JPEG byte for byte, in RAW_RGBA_F32 within 1.5 / 2^kLeafBits. DATA_LOSS if
/// its pixels are damaged or are of another size; INVALID_ARGUMENT if it is not of kFoveated, or
/// `encoding` is. Thread-safe.
[[nodiscard]] StatusOr<Frame> ExpandFrame(const Frame& foveated, Encoding encoding,
                                          int threads = 0);

}  // namespace fovea::frames

#endif  // SERVICE_FRAMES_FOVEATED_PICTURE_H_
