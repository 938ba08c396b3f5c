#ifndef ENGINE_RENDER_SPENT_PIXELS_H_
#define ENGINE_RENDER_SPENT_PIXELS_H_

#include <cstdint>
#include <vector>

#include "engine/render/thick_ray.h"

/// Which pixels have nothing to gain any more, because too little of their rays is left. ALGORITHM,
/// skip: a pixel is spent with its children only if the pixels around it that are split are spent
/// too, since smooth splitting mixes them.
namespace fovea::render {

/// The spent pixels of a level, in runs of kRun from plan.rect.u0.
struct SpentPixels {
  static constexpr int64_t kRun = 8;
  bool any = false;
  int64_t runs_in_row = 0;
  std::vector<uint8_t> runs;  // row by row; 1: all of the run's pixels are spent

  /// None is spent.
  void Clear(const Rect& rect);
};

/// What is left of each ray behind a level's front: `reach`, what arrives there, times what the
/// front lets through.
void LeftBehindFront(const Layer& layer, const std::vector<float>& reach, std::vector<float>* left);

/// What arrives at a level, from what is left behind its parent's front.
void PassDownReach(const Layer& parent, const std::vector<float>& left, const Layer& layer,
                   std::vector<float>* reach);

/// The pixels of `layer` whose parents are spent: less than `limit` of their rays is left. While it
/// is not yet known which pixels around will be split, all of them must be spent.
void FindSpentChildren(const Layer& parent, const std::vector<float>& left, const Layer& layer,
                       float limit, bool whole_neighbourhood, SpentPixels* spent);

/// The pixels of a level that are spent themselves.
void FindSpent(const Layer& layer, const std::vector<float>& left, float limit, SpentPixels* spent);

}  // namespace fovea::render

#endif  // ENGINE_RENDER_SPENT_PIXELS_H_
