#include "engine/render/spent_pixels.h"

#include <algorithm>

namespace fovea::render {
namespace {

/// Marks the runs whose pixels are all `is_spent(u, v)`.
template <typename IsSpent>
void Mark(const Rect& rect, const IsSpent& is_spent, SpentPixels* spent) {
  spent->Clear(rect);
  for (int64_t v = rect.v0; v < rect.v1; ++v) {
    uint8_t* runs = spent->runs.data() + (v - rect.v0) * spent->runs_in_row;
    for (int64_t r = 0; r < spent->runs_in_row; ++r) {
      const int64_t begin = rect.u0 + r * SpentPixels::kRun;
      const int64_t end = std::min(begin + SpentPixels::kRun, rect.u1);
      bool all = true;
      for (int64_t u = begin; all && u < end; ++u) {
        all = is_spent(u, v);
      }
      runs[r] = all ? 1 : 0;
      spent->any = spent->any || all;
    }
  }
}

/// Whether pixel (u, v) is spent, and all pixels around it, or all of those that are split.
bool SpentAround(const Layer& layer, const std::vector<float>& left, float limit, bool all,
                 int64_t u, int64_t v) {
  if (left[layer.Index(u, v)] >= limit) {
    return false;
  }
  for (int64_t dv = -1; dv <= 1; ++dv) {
    for (int64_t du = -1; du <= 1; ++du) {
      if ((all ? layer.plan.rect.Contains(u + du, v + dv) : layer.IsSplit(u + du, v + dv)) &&
          left[layer.Index(u + du, v + dv)] >= limit) {
        return false;
      }
    }
  }
  return true;
}

bool AnyBelow(const std::vector<float>& left, float limit) {
  float least = 1;
  for (const float value : left) {
    least = value < least ? value : least;
  }
  return least < limit;
}

}  // namespace

void SpentPixels::Clear(const Rect& rect) {
  any = false;
  runs_in_row = (rect.Width() + kRun - 1) / kRun;
  runs.assign(static_cast<size_t>(runs_in_row * rect.Height()), 0);
}

void LeftBehindFront(const Layer& layer, const std::vector<float>& reach,
                     std::vector<float>* left) {
  left->resize(reach.size());
  for (size_t i = 0; i < reach.size(); ++i) {
    (*left)[i] = reach[i] * layer.front.transmittance[i];
  }
}

void PassDownReach(const Layer& parent, const std::vector<float>& left, const Layer& layer,
                   std::vector<float>* reach) {
  const Rect& rect = layer.plan.rect;
  reach->resize(layer.split.size());
  for (int64_t v = rect.v0; v < rect.v1; ++v) {
    // The rectangle is one of whole parents.
    const float* from = left.data() + parent.Index(rect.u0 >> 1, v >> 1);
    float* to = reach->data() + layer.Index(rect.u0, v);
    for (int64_t i = 0; i < rect.Width() / 2; ++i) {
      to[2 * i] = from[i];
      to[2 * i + 1] = from[i];
    }
  }
}

void FindSpentChildren(const Layer& parent, const std::vector<float>& left, const Layer& layer,
                       float limit, bool whole_neighbourhood, SpentPixels* spent) {
  if (!AnyBelow(left, limit)) {
    spent->Clear(layer.plan.rect);
    return;
  }
  Mark(
      layer.plan.rect,
      [&](int64_t u, int64_t v) {
        return !parent.IsSplit(u >> 1, v >> 1) ||
               SpentAround(parent, left, limit, whole_neighbourhood, u >> 1, v >> 1);
      },
      spent);
}

void FindSpent(const Layer& layer, const std::vector<float>& left, float limit,
               SpentPixels* spent) {
  if (!AnyBelow(left, limit)) {
    spent->Clear(layer.plan.rect);
    return;
  }
  Mark(
      layer.plan.rect,
      [&](int64_t u, int64_t v) {
        const size_t i = layer.Index(u, v);
        return layer.split[i] != 0 ? SpentAround(layer, left, limit, false, u, v) : left[i] < limit;
      },
      spent);
}

}  // namespace fovea::render
