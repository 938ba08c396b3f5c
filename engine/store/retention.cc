#include "engine/store/retention.h"

#include <algorithm>
#include <span>
#include <utility>

#include "engine/store/metadata.h"

namespace fovea::store {
namespace {

/// The part of `box` on one side of `cut` along `axis`.
Box3 Below(Box3 box, int axis, int64_t cut) {
  box.hi[axis] = std::min(box.hi[axis], cut);
  return box;
}
Box3 From(Box3 box, int axis, int64_t cut) {
  box.lo[axis] = std::max(box.lo[axis], cut);
  return box;
}

bool Holds(std::span<const Box3> boxes, Box3 rest) {
  if (rest.IsEmpty()) {
    return true;
  }
  while (!boxes.empty() && Intersect(boxes.front(), rest).IsEmpty()) {
    boxes = boxes.subspan(1);
  }
  if (boxes.empty()) {
    return false;
  }
  const Box3& first = boxes.front();
  for (int axis = 0; axis < 3; ++axis) {
    if (!Holds(boxes.subspan(1), Below(rest, axis, first.lo[axis])) ||
        !Holds(boxes.subspan(1), From(rest, axis, first.hi[axis]))) {
      return false;
    }
    rest = Below(From(rest, axis, first.lo[axis]), axis, first.hi[axis]);
  }
  return true;
}

}  // namespace

bool UnionContains(const std::vector<Box3>& boxes, const Box3& box) {
  return Holds(boxes, box);
}

std::vector<RetainedWindow> InVoxels(const std::vector<AskedWindow>& asked,
                                     const Matrix4& index_to_world) {
  std::vector<RetainedWindow> windows;
  for (const auto& [window, in_world] : asked) {
    windows.push_back(window);
    if (in_world) {
      windows.back().at = index_to_world.Inverse().TransformPoint(window.at);
    }
  }
  return windows;
}

StatusOr<RetainedChunks> RetainedChunks::Make(const DatasetInfo& info) {
  RetainedChunks chunks;
  chunks.edge_ = info.chunk_edge;
  chunks.finest_ = info.hierarchy.finest();
  if (info.retention.empty()) {
    return chunks;
  }
  if (info.retention.size() > kMaxRetainedWindows) {
    return InvalidArgument("{} windows to retain: at most {} can be", info.retention.size(),
                           kMaxRetainedWindows);
  }
  chunks.keeps_all_ = false;
  chunks.kept_.resize(static_cast<size_t>(chunks.finest_));
  for (const RetainedWindow& window : info.retention) {
    const StatusOr<RetainedSet> set = RetainedSet::Make(info.hierarchy, {window.at, window.rate});
    FOVEA_RETURN_IF_ERROR(Annotate(
        set.status(), fmt::format("the window to retain at {:.9g},{:.9g},{:.9g}, rate {}",
                                  window.at.x, window.at.y, window.at.z, FormatRate(window.rate))));
    for (int level = 0; level < chunks.finest_; ++level) {
      const Box3 kept = chunks.ChunksOf(set->window(level));
      if (!kept.IsEmpty()) {
        chunks.kept_[static_cast<size_t>(level)].push_back(kept);
      }
    }
  }
  return chunks;
}

Box3 RetainedChunks::ChunksOf(const Box3& window) const {
  if (window.IsEmpty()) {
    return {};
  }
  Box3 chunks;
  for (int axis = 0; axis < 3; ++axis) {
    chunks.lo[axis] = window.lo[axis] / edge_;
    chunks.hi[axis] = (window.hi[axis] + edge_ - 1) / edge_;
  }
  return chunks;
}

bool RetainedChunks::Keeps(int level, const Int3& chunk) const {
  if (keeps_all_) {
    return true;
  }
  const std::vector<Box3>& boxes = kept_[static_cast<size_t>(level)];
  return std::any_of(boxes.begin(), boxes.end(),
                     [&](const Box3& box) { return box.Contains(chunk); });
}

bool RetainedChunks::Covers(int level, const Box3& window) const {
  return keeps_all_ || UnionContains(kept_[static_cast<size_t>(level)], ChunksOf(window));
}

bool RetainedChunks::Covers(const RetainedSet& asked) const {
  for (int level = 0; level < finest_; ++level) {
    if (!Covers(level, asked.window(level))) {
      return false;
    }
  }
  return true;
}

bool RetainedChunks::Covers(const RetainedChunks& other) const {
  if (keeps_all_ || other.keeps_all_) {
    return keeps_all_;
  }
  for (size_t level = 0; level < kept_.size(); ++level) {
    for (const Box3& box : other.kept_[level]) {
      if (!UnionContains(kept_[level], box)) {
        return false;
      }
    }
  }
  return true;
}

NewestRetention::NewestRetention(FileSystem& files, std::string store_path, const DatasetInfo& info)
    : files_(files), path_(std::move(store_path)) {
  retained_ = RetainedChunks::Make(info).value_or(retained_);
}

bool NewestRetention::WasDropped(int level, const Int3& chunk) {
  const std::lock_guard lock(mutex_);
  if (retained_.Keeps(level, chunk)) {
    if (const StatusOr<DatasetInfo> now = ReadGroup(files_, path_); now.ok()) {
      retained_ = RetainedChunks::Make(*now).value_or(retained_);
    }
  }
  return !retained_.Keeps(level, chunk);
}

}  // namespace fovea::store
