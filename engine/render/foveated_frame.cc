#include "engine/render/foveated_frame.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace fovea::render {
namespace {

// A rectangle of a level of the largest volume, seen obliquely, stays well inside.
constexpr int64_t kFarthestPixel = int64_t{1} << 20;

// Sheared coordinates of a pixel, far beyond what a view can ask for.
constexpr double kFarthestWarp = 1e18;

bool IsInRange(const Rect& rect) {
  return std::max({std::abs(rect.u0), std::abs(rect.u1), std::abs(rect.v0), std::abs(rect.v1)}) <=
         kFarthestPixel;
}

Status ValidateShape(const FrameLevel& level, size_t number, int64_t width) {
  if (level.width != width || width < 1) {
    return InvalidArgument("foveated frame: level {} has pixels {} voxels wide where {} are due",
                           number, level.width, width);
  }
  if (level.rect.IsEmpty() || !IsInRange(level.rect)) {
    return InvalidArgument("foveated frame: level {} has no pixels, or lies further out than {}",
                           number, kFarthestPixel);
  }
  const auto pixels = static_cast<size_t>(level.rect.Width() * level.rect.Height());
  if (level.kinds.size() != pixels || level.values.size() != pixels) {
    return InvalidArgument("foveated frame: level {} has {} kinds and {} values for {} pixels",
                           number, level.kinds.size(), level.values.size(), pixels);
  }
  return absl::OkStatus();
}

bool IsSplit(const FrameLevel& level, int64_t u, int64_t v) {
  return level.rect.Contains(u, v) && level.kinds[level.Index(u, v)] == PixelKind::kSplit;
}

/// Whether every pixel is of a kind, and present exactly if its parent is split.
bool FollowsItsParent(const FrameLevel& level, const FrameLevel* coarser) {
  for (int64_t v = level.rect.v0; v < level.rect.v1; ++v) {
    for (int64_t u = level.rect.u0; u < level.rect.u1; ++u) {
      const PixelKind kind = level.kinds[level.Index(u, v)];
      const bool due = coarser == nullptr || IsSplit(*coarser, u >> 1, v >> 1);
      if (kind > PixelKind::kSplit || (kind != PixelKind::kAbsent) != due) {
        return false;
      }
    }
  }
  return true;
}

bool HoldsItsChildren(const FrameLevel& level, const FrameLevel* finer) {
  for (int64_t v = level.rect.v0; v < level.rect.v1; ++v) {
    for (int64_t u = level.rect.u0; u < level.rect.u1; ++u) {
      if (IsSplit(level, u, v) && (finer == nullptr || !finer->rect.Contains(2 * u, 2 * v) ||
                                   !finer->rect.Contains(2 * u + 1, 2 * v + 1))) {
        return false;
      }
    }
  }
  return true;
}

}  // namespace

Status Validate(const std::vector<FrameLevel>& levels, const Rect& sheet) {
  if (levels.empty() || levels.size() > kMostFrameLevels) {
    return InvalidArgument("foveated frame: {} levels where 1 to {} are allowed", levels.size(),
                           kMostFrameLevels);
  }
  if (sheet.IsEmpty() || !IsInRange(sheet)) {
    return InvalidArgument("foveated frame: its sheet is empty, or lies further out than {}",
                           kFarthestPixel);
  }
  int64_t width = levels.front().width;
  if (width < 1 || width > kFarthestPixel || (width & (width - 1)) != 0) {
    return InvalidArgument("foveated frame: pixels {} voxels wide; a power of two is due", width);
  }
  for (size_t l = 0; l < levels.size(); ++l, width /= 2) {
    FOVEA_RETURN_IF_ERROR(ValidateShape(levels[l], l, width));
  }
  for (size_t l = 0; l < levels.size(); ++l) {
    const FrameLevel* coarser = l > 0 ? &levels[l - 1] : nullptr;
    const FrameLevel* finer = l + 1 < levels.size() ? &levels[l + 1] : nullptr;
    if (!FollowsItsParent(levels[l], coarser) || !HoldsItsChildren(levels[l], finer)) {
      return InvalidArgument("foveated frame: pixels of level {} do not fit those around it", l);
    }
  }
  return absl::OkStatus();
}

Status Validate(const FoveatedFrame& frame) {
  if (frame.width_px < 1 || frame.height_px < 1 ||
      !std::all_of(frame.warp.begin(), frame.warp.end(),
                   [](double m) { return std::abs(m) <= kFarthestWarp; })) {
    return InvalidArgument("foveated frame: picture size or warp is out of range");
  }
  return Validate(frame.levels, frame.sheet);
}

std::array<double, 6> WarpForSize(const FoveatedFrame& frame, int width_px, int height_px) {
  const std::array<double, 6>& m = frame.warp;
  if (width_px == frame.width_px && height_px == frame.height_px) {
    return m;
  }
  const double scale = static_cast<double>(frame.height_px) / height_px;
  const auto rescaled_offset = [&](int row) {
    const double middle =
        m[row] * (frame.width_px - 1) / 2.0 + m[row + 1] * (frame.height_px - 1) / 2.0 + m[row + 2];
    return middle - scale * (m[row] * (width_px - 1) / 2.0 + m[row + 1] * (height_px - 1) / 2.0);
  };
  return {scale * m[0], scale * m[1], rescaled_offset(0),
          scale * m[3], scale * m[4], rescaled_offset(3)};
}

}  // namespace fovea::render
