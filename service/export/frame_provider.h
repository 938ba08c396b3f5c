#ifndef SERVICE_EXPORT_FRAME_PROVIDER_H_
#define SERVICE_EXPORT_FRAME_PROVIDER_H_

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/store/dataset.h"
#include "service/client/client.h"
#include "service/frames/animation.h"
#include "service/frames/spec.h"

namespace fovea::exports {

/// When a step is, and what its source called it.
struct StepInfo {
  int64_t step = 0;
  int64_t time_ns = 0;
  std::optional<int64_t> frame_number;
};

/// An animation over the steps first, first + stride ... last.
struct Shot {
  const frames::Animation& animation;
  const frames::FrameSpec& spec;  // resolved; what of it the animation does not say
  int64_t first = 0, last = 0, stride = 1;

  [[nodiscard]] int64_t StepAt(int64_t frame) const {
    const int64_t count = (last - first) / stride + 1;
    return animation.StepAt(frame).value_or(first + stride * animation.PlaceIn(count, frame));
  }
};

/// Where the frames of one dataset come from: the engine in this process, or a server. Both give
/// the same bytes. Not thread-safe.
class FrameProvider {
 public:
  virtual ~FrameProvider() = default;
  /// Names the dataset for people and for the manifest; changes when it is made anew, where that
  /// can be known.
  [[nodiscard]] virtual const std::string& identity() const = 0;
  [[nodiscard]] virtual const store::DatasetInfo& info() const = 0;
  /// Time and number of each of these steps. OUT_OF_RANGE for one that is not there.
  [[nodiscard]] virtual StatusOr<std::vector<StepInfo>> Describe(
      const std::vector<int64_t>& steps) = 0;
  /// `spec` with nothing left to default and positions in voxels, checked against the dataset.
  [[nodiscard]] virtual StatusOr<frames::FrameSpec> Resolve(const frames::FrameSpec& spec) = 0;
  [[nodiscard]] virtual StatusOr<frames::Frame> Render(int64_t step,
                                                       const frames::FrameSpec& spec) = 0;
  /// Every one of these steps with one spec, in order; `on_frame` returns an error to stop.
  [[nodiscard]] virtual Status RenderEach(
      const std::vector<int64_t>& steps, const frames::FrameSpec& spec,
      const std::function<Status(const frames::Frame&)>& on_frame) = 0;
  /// The frames `begin` to `end` - 1 of a shot, in order, as RenderEach.
  [[nodiscard]] virtual Status RenderShot(
      const Shot& shot, int64_t begin, int64_t end,
      const std::function<Status(const frames::Frame&)>& on_frame);
};

/// Renders here. `threads` as in frames::RenderFrame.
[[nodiscard]] StatusOr<std::unique_ptr<FrameProvider>> OpenLocal(const std::string& path,
                                                                 int threads);

/// What a server sends so that there is a picture here; it is the same picture.
enum class Transport {
  kPictures,      // as the server renders and encodes them
  kFoveated,      // those of 8 bits as FOVEATED frames, which are expanded here
  kCoefficients,  // coefficients, those that are not here yet; they are rendered here
};

/// Asks the server at `address` ("HOST:PORT") for `dataset`. Pictures of steps that follow each
/// other come as one stream. `threads` is for what is rendered here.
[[nodiscard]] StatusOr<std::unique_ptr<FrameProvider>> OpenRemote(
    const std::string& address, const client::Credentials& credentials, const std::string& dataset,
    Transport transport = Transport::kPictures, int threads = 0);

}  // namespace fovea::exports

#endif  // SERVICE_EXPORT_FRAME_PROVIDER_H_
