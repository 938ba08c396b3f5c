#include "service/frames/foveated_picture.h"

#include <utility>

#include "engine/base/stopwatch.h"
#include "engine/render/expand.h"
#include "engine/render/leaf_scale.h"
#include "service/frames/encode.h"
#include "service/frames/foveated_codec.h"
#include "service/frames/marker.h"

namespace fovea::frames {

int FoveatedPicture::width_px() const {
  const auto* flat = std::get_if<render::FoveatedFrame>(&frame);
  return flat != nullptr ? flat->width_px
                         : std::get<render::PerspectiveFrame>(frame).pinhole.width_px;
}

int FoveatedPicture::height_px() const {
  const auto* flat = std::get_if<render::FoveatedFrame>(&frame);
  return flat != nullptr ? flat->height_px
                         : std::get<render::PerspectiveFrame>(frame).pinhole.height_px;
}

void SnapLeaves(FoveatedPicture* picture, int threads) {
  if (auto* flat = std::get_if<render::FoveatedFrame>(&picture->frame)) {
    render::SnapLeaves(threads, &flat->levels);
    return;
  }
  for (render::FaceFrame& face : std::get<render::PerspectiveFrame>(picture->frame).faces) {
    render::SnapLeaves(threads, &face.levels);
  }
}

render::Image ExpandImage(FoveatedPicture picture, int threads) {
  if (const auto* flat = std::get_if<render::FoveatedFrame>(&picture.frame)) {
    return render::Expand(*flat, flat->width_px, flat->height_px, picture.smoothing, picture.basis,
                          threads);
  }
  return render::ExpandPerspective(std::get<render::PerspectiveFrame>(std::move(picture.frame)),
                                   picture.smoothing, picture.basis, threads);
}

StatusOr<std::string> EncodeMarked(render::Image image, const std::optional<Marker>& marker,
                                   Encoding encoding, const render::Color& background,
                                   int jpeg_quality) {
  if (marker && encoding != Encoding::kRawRgbaF32) {
    DrawFoveaMarker(&image, (*marker)[0], (*marker)[1]);
  }
  return Encode(image, encoding, background, jpeg_quality);
}

StatusOr<Frame> ExpandFrame(const Frame& foveated, Encoding encoding, int threads) {
  if (foveated.encoding != Encoding::kFoveated || encoding == Encoding::kFoveated) {
    return InvalidArgument("a frame of {} cannot be expanded to {}",
                           EncodingName(foveated.encoding), EncodingName(encoding));
  }
  FOVEA_ASSIGN_OR_RETURN(FoveatedPicture picture, DecodeFoveated(foveated.pixels));
  if (picture.width_px() != foveated.width_px || picture.height_px() != foveated.height_px) {
    return DataLoss("a FOVEATED frame of {} x {} pixels holds a picture of {} x {}",
                    foveated.width_px, foveated.height_px, picture.width_px(), picture.height_px());
  }
  Frame frame = foveated;
  frame.encoding = frame.used.encoding = encoding;
  const std::optional<Marker> marker = picture.marker;
  const render::Color background = picture.background;
  Stopwatch watch;
  render::Image image = ExpandImage(std::move(picture), threads);
  frame.stats.smooth_warp_ms = watch.RestartMs();
  FOVEA_ASSIGN_OR_RETURN(frame.pixels,
                         EncodeMarked(std::move(image), marker, encoding, background,
                                      static_cast<int>(foveated.used.jpeg_quality.value_or(90))));
  return frame;
}

}  // namespace fovea::frames
