#ifndef SERVICE_EXPORT_ANIMATION_H_
#define SERVICE_EXPORT_ANIMATION_H_

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "service/frames/spec.h"

namespace fovea::exports {

/// View or camera, fovea, rate, span and step over the frames of a shot: keyframes, linear between,
/// constant before the first and after the last that has the value. docs/export.md describes the
/// file.
class Animation {
 public:
  /// From JSON text. INVALID_ARGUMENT naming the key and what is wrong with it.
  [[nodiscard]] static StatusOr<Animation> Parse(const std::string& json_text);
  /// A turn by `degrees` of azimuth in `frames` equal parts, starting at `azimuth_deg`; 360 closes
  /// the loop: the frame after the last would be the first again.
  [[nodiscard]] static Animation Orbit(double azimuth_deg, double elevation_deg, double degrees,
                                       int64_t frames);

  /// The eye of a resolved perspective view turns around its target about `up`, in the same sense.
  [[nodiscard]] static Animation Orbit(const frames::PerspectiveSpec& camera,
                                       const Matrix4& index_to_world, double degrees,
                                       int64_t frames);

  [[nodiscard]] int64_t frames() const { return frames_; }
  /// `spec` with what the keys say about this frame.
  [[nodiscard]] frames::FrameSpec SpecAt(int64_t frame, const frames::FrameSpec& spec) const;
  /// The time step at this frame, rounded to the nearest; nothing if no key has one.
  [[nodiscard]] std::optional<int64_t> StepAt(int64_t frame) const;

 private:
  struct Key {
    int64_t frame = 0;
    std::array<double, 3> value{};
  };
  using Track = std::vector<Key>;
  friend class AnimationParser;
  [[nodiscard]] static std::optional<std::array<double, 3>> Sample(const Track& track,
                                                                   int64_t frame);

  /// What the keys say about a perspective view.
  void MoveCamera(int64_t frame, frames::FrameSpec* spec) const;

  int64_t frames_ = 1;
  Track view_, fovea_, rate_, span_, step_;
  Track eye_, target_, up_, fov_;
};

}  // namespace fovea::exports

#endif  // SERVICE_EXPORT_ANIMATION_H_
