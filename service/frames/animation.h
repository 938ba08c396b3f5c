#ifndef SERVICE_FRAMES_ANIMATION_H_
#define SERVICE_FRAMES_ANIMATION_H_

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "engine/base/status.h"
#include "service/frames/spec.h"

namespace fovea::frames {

/// What a shot shows at one of its frames. Positions are in voxels.
struct Keyframe {
  struct Angles {
    double azimuth_deg = 0, elevation_deg = 0;
    friend bool operator==(const Angles&, const Angles&) = default;
  };
  int64_t frame = 0;
  std::optional<Angles> view;         // of an orthographic view
  std::optional<double> span_voxels;  // of it
  std::optional<Vec3> eye, target;    // of a camera
  std::optional<Vec3> up;             // of it, world axes
  std::optional<double> fov_y_deg;    // of it
  std::optional<Vec3> fovea;
  std::optional<double> rate;
  std::optional<int64_t> step;
  friend bool operator==(const Keyframe&, const Keyframe&) = default;
};

/// View or camera, fovea, rate, span and step over the frames of a shot: each linear between the
/// keyframes that have it, constant before the first and after the last of them. docs/export.md
/// describes it. A frame takes time with the logarithm of the number of keys. Thread-safe once it
/// is made.
class Animation {
 public:
  static constexpr int64_t kMaxFrames = 1'000'000;
  static constexpr size_t kMaxSentKeys = 4096;  // that a server takes

  /// INVALID_ARGUMENT unless there are 1 to kMaxFrames frames and at least one key, their frames
  /// grow from 0 to at most `frames`, and they move either an orthographic view or a camera whose
  /// eye one of them says.
  [[nodiscard]] static StatusOr<Animation> Make(int64_t frames, std::vector<Keyframe> keys);
  /// From JSON text. INVALID_ARGUMENT naming the key and what is wrong with it.
  [[nodiscard]] static StatusOr<Animation> Parse(const std::string& json_text);
  /// A turn by `degrees` of azimuth in `frames` equal parts, starting at `azimuth_deg`; 360 closes
  /// the loop: the frame after the last would be the first again.
  [[nodiscard]] static Animation Orbit(double azimuth_deg, double elevation_deg, double degrees,
                                       int64_t frames);
  /// The eye of a resolved perspective view turns around its target about `up`, in the same sense.
  [[nodiscard]] static Animation Orbit(const PerspectiveSpec& camera, const Matrix4& index_to_world,
                                       double degrees, int64_t frames);

  [[nodiscard]] int64_t frames() const { return frames_; }
  [[nodiscard]] const std::vector<Keyframe>& keys() const { return keys_; }
  /// `spec` with what the keys say about this frame.
  [[nodiscard]] FrameSpec SpecAt(int64_t frame, const FrameSpec& spec) const;
  /// The time step at this frame, rounded to the nearest; nothing if no key has one.
  [[nodiscard]] std::optional<int64_t> StepAt(int64_t frame) const;
  /// Where no key has a step: which of `count` steps, from 0, this frame shows, so that the frames
  /// are spread evenly over them.
  [[nodiscard]] int64_t PlaceIn(int64_t count, int64_t frame) const {
    return frame * count / frames_;
  }

 private:
  /// One of a keyframe's values, and the keys that have it: places in keys_, in order.
  template <typename T>
  struct Track {
    std::optional<T> Keyframe::*value;
    std::vector<size_t> keys;
  };

  Animation(int64_t frames, std::vector<Keyframe> keys);

  template <typename T>
  void Fill(Track<T>* track) const;
  /// O(log keys).
  template <typename T>
  [[nodiscard]] std::optional<T> Sample(const Track<T>& track, int64_t frame) const;
  /// What the keys say about a perspective view.
  void MoveCamera(int64_t frame, FrameSpec* spec) const;

  int64_t frames_ = 1;
  std::vector<Keyframe> keys_;
  Track<Keyframe::Angles> view_{&Keyframe::view, {}};
  Track<double> span_voxels_{&Keyframe::span_voxels, {}};
  Track<Vec3> eye_{&Keyframe::eye, {}};
  Track<Vec3> target_{&Keyframe::target, {}};
  Track<Vec3> up_{&Keyframe::up, {}};
  Track<double> fov_y_deg_{&Keyframe::fov_y_deg, {}};
  Track<Vec3> fovea_{&Keyframe::fovea, {}};
  Track<double> rate_{&Keyframe::rate, {}};
  Track<int64_t> step_{&Keyframe::step, {}};
};

}  // namespace fovea::frames

#endif  // SERVICE_FRAMES_ANIMATION_H_
