#ifndef SERVICE_SERVER_RATE_CHOOSER_H_
#define SERVICE_SERVER_RATE_CHOOSER_H_

#include <cstdint>

#include "engine/fovea/retained_set.h"
#include "engine/volume/hierarchy.h"

namespace fovea::server {

/// How sharp the next picture of a view is to be: which part, up to 1, of the rate that was asked
/// for. Rates are on a ladder whose rungs are 1.6 apart, so that a large picture costs about four times
/// the one before and all of them together a third more than the last. Learns from what frames
/// took. Not thread-safe.
class RateChooser {
 public:
  /// What a frame is of.
  struct View {
    Hierarchy hierarchy;
    Fovea fovea;  // with the rate that was asked for
    int64_t pixels = 0;
  };

  /// The highest rung whose frame is expected to take at most `ms`; the lowest, if none.
  [[nodiscard]] double Within(double ms, const View& view) const;
  /// The rung to go to from `part`, below 1: the next one, or 1 if that costs hardly more.
  [[nodiscard]] double Next(double part, const View& view) const;
  /// A frame of this part took so long.
  void Learn(double part, const View& view, double took_ms);

  /// The rate of a part: never below 1, and what was asked for at 1.
  [[nodiscard]] static Rate RateOf(double part, const View& view);

 private:
  /// Milliseconds, on a machine as the one of docs/performance.md.
  [[nodiscard]] static double Nominal(double part, const View& view);
  [[nodiscard]] double Expected(double part, const View& view) const {
    return slowness_ * Nominal(part, view);
  }
  double slowness_ = 1;  // of this machine, volume and transfer function
};

}  // namespace fovea::server

#endif  // SERVICE_SERVER_RATE_CHOOSER_H_
