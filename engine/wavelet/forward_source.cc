#include "engine/wavelet/forward_source.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <type_traits>
#include <utility>

#include "engine/base/buffers.h"
#include "engine/wavelet/forward_stream.h"

namespace fovea::wavelet::internal {
namespace {

/// How many children a strip has along an axis.
int64_t ChildrenOf(const LevelShape& shape, int64_t bricks) {
  return 2 * (bricks * shape.edge + 2 * MarginOf(shape.wavelet));
}

int64_t FirstChild(const LevelShape& shape, int64_t brick) {
  return 2 * (brick * shape.edge - MarginOf(shape.wavelet));
}

/// The sample that position `at` of an axis of n samples stands for: continued as the wavelet asks,
/// mirrored about the first and the last, or (Haar) the nearest. Far outside, where no coefficient
/// depends on it, some sample of the strip that starts at `first`.
int64_t Continued(Wavelet wavelet, int64_t at, int64_t n, int64_t first) {
  if (at >= 0 && at < n) {
    return at;
  }
  if (wavelet == Wavelet::kHaar || n == 1) {
    return std::clamp<int64_t>(at, 0, n - 1);
  }
  const int64_t period = 2 * (n - 1);
  const int64_t in_period = ((at % period) + period) % period;
  return std::max({in_period < n ? in_period : period - in_period, first, int64_t{0}});
}

/// Finds the samples of a strip; those inside the level along x are [input.first, input.last).
template <typename Value>
void PlaceStrip(const LevelShape& shape, const Strip& strip, StripMemory<Value>* memory) {
  const auto wanted = [&](int axis) {
    const int64_t inside = (shape.dims[axis] + 1) / 2 - strip.at[axis] * shape.edge;
    return shape.wavelet == Wavelet::kHaar ? std::min(inside, shape.edge) : shape.edge;
  };
  memory->input.wanted_y = wanted(1);
  memory->input.wanted_z = wanted(2);
  for (int axis = 0; axis < 3; ++axis) {
    const int64_t first = FirstChild(shape, strip.at[axis]);
    const int64_t n = shape.dims[axis];
    std::vector<int64_t>& samples = memory->samples[static_cast<size_t>(axis)];
    const int64_t unwanted = axis == 0 ? 0 : shape.edge - wanted(axis);
    samples.resize(
        static_cast<size_t>(ChildrenOf(shape, axis == 0 ? strip.bricks : 1) - 2 * unwanted));
    for (int64_t i = 0; i < std::ssize(samples); ++i) {
      samples[static_cast<size_t>(i)] = Continued(shape.wavelet, first + i, n, first);
    }
    memory->input.lift[static_cast<size_t>(axis)] = n > 1;
  }
  const std::vector<int64_t>& xs = memory->samples[0];
  const int64_t first = FirstChild(shape, strip.at.x);
  memory->input.bricks = strip.bricks;
  memory->input.first = std::max<int64_t>(0, -first);
  memory->input.last = std::min(std::ssize(xs), shape.dims.x - first);
  memory->copied.clear();
  for (int64_t i = 0; i < std::ssize(xs); ++i) {
    if (i < memory->input.first || i >= memory->input.last) {
      memory->copied.push_back({i, xs[static_cast<size_t>(i)] - first});
    }
  }
  memory->input.copied = memory->copied;
  memory->copies_last = shape.wavelet == Wavelet::kHaar && !memory->copied.empty();
}

/// Copies `count` values; false if one is not a whole number that a voxel of type Value may be.
/// kMeans: they are no voxels, but made by the transform, and all right.
template <bool kMeans, typename Value, typename From>
bool Convert(const From* from, int64_t count, float bias, Value* to) {
  if constexpr (std::is_same_v<Value, From> && (kMeans || std::is_same_v<Value, float>)) {
    if (bias == 0) {
      constexpr int64_t kUsual = 16;  // a row of a brick
      if (count == kUsual) {
        std::memcpy(to, from, kUsual * sizeof(Value));  // no call: the size is known
      } else {
        std::memcpy(to, from, static_cast<size_t>(count) * sizeof(Value));
      }
      return true;
    }
  }
  if constexpr (std::is_same_v<Value, float>) {
    for (int64_t i = 0; i < count; ++i) {
      to[i] = static_cast<float>(from[i]) - bias;
    }
    return true;
  } else {
    constexpr int32_t kMost = sizeof(Value) == 2 ? kMostShortVoxel : kMostVoxel;
    bool good = true;
    for (int64_t i = 0; i < count; ++i) {
      if constexpr (std::is_same_v<From, float>) {
        const bool fits = from[i] >= -static_cast<float>(kMost) && from[i] <= kMost;
        to[i] = static_cast<Value>(fits ? from[i] : 0.0F);
        good &= fits && static_cast<float>(to[i]) == from[i];
      } else {
        if constexpr (std::numeric_limits<From>::max() > kMost) {
          good &= from[i] >= -kMost && from[i] <= kMost;
        }
        to[i] = static_cast<Value>(from[i]);
      }
    }
    return good;
  }
}

/// Fills in the children of a row that are copies of others.
template <typename Value>
void CopyChildren(const StripMemory<Value>& memory, Value* row) {
  const int64_t width = std::ssize(memory.samples[0]);
  if (memory.copies_last) {
    std::fill(row + width - std::ssize(memory.copied), row + width,
              row[memory.copied.front().from]);
    return;
  }
  for (const CopiedChild& child : memory.copied) {
    row[child.to] = row[child.from];
  }
}

/// Lets the rows be those of the strip's own memory, and whole.
template <typename Value>
void UseOwnChildren(StripMemory<Value>* memory) {
  const int64_t width = std::ssize(memory->samples[0]);
  const int64_t height = std::ssize(memory->samples[1]);
  const int64_t depth = std::ssize(memory->samples[2]);
  for (int64_t i = 0; i < depth; ++i) {
    memory->slices[static_cast<size_t>(i)] = memory->children.get() + i * height * width;
  }
  for (int64_t i = 0; i < height; ++i) {
    memory->rows[static_cast<size_t>(i)] = i * width;
  }
  memory->input.first = 0;
  memory->input.last = width;
  memory->input.copied = {};
  memory->input.next = 0;
}

}  // namespace

template <typename Value>
StripMemory<Value>::StripMemory(const LevelShape& shape) {
  const int64_t most = MostBricks<Value>(shape.wavelet);
  const auto count = static_cast<size_t>(ChildrenOf(shape, 1));
  const auto cube = static_cast<size_t>(shape.edge * shape.edge * shape.edge);
  slices.resize(count);
  rows.resize(count);
  children = TakeBuffer<Value>(count * count * static_cast<size_t>(ChildrenOf(shape, most)));
  const size_t cells = WorkCells<Value>(shape.wavelet, shape.edge);
  work = TakeBuffer<Value>(cells);
  std::fill_n(work.get(), cells, Value{0});  // what pads rows is lifted too
  detail = TakeBuffer<Value>(7 * cube * static_cast<size_t>(most));
  input.slices = slices.data();
  input.rows = rows.data();
  input.edge = shape.edge;
}

template <typename Value, typename From>
void DenseSource<Value, From>::Add(std::span<const From> slices,
                                   std::shared_ptr<const void> owner) {
  const int64_t count = std::ssize(slices) / (shape_.dims.x * shape_.dims.y);
  slabs_.push_back({available_, available_ + count, slices.data(), std::move(owner)});
  available_ += count;
}

template <typename Value, typename From>
std::vector<std::array<int64_t, 2>> DenseSource<Value, From>::Parents(int64_t /*z*/) const {
  const auto bricks = [&](int64_t n) { return ((n + 1) / 2 + shape_.edge - 1) / shape_.edge; };
  std::vector<std::array<int64_t, 2>> parents;
  for (int64_t y = 0; y < bricks(shape_.dims.y); ++y) {
    for (int64_t x = 0; x < bricks(shape_.dims.x); ++x) {
      parents.push_back({y, x});
    }
  }
  return parents;
}

template <typename Value, typename From>
const From* DenseSource<Value, From>::Slice(int64_t z) const {
  const auto slab = std::find_if(slabs_.begin(), slabs_.end(),
                                 [&](const Slab& of) { return z >= of.first && z < of.last; });
  return slab->values + (z - slab->first) * shape_.dims.x * shape_.dims.y;
}

template <typename Value, typename From>
bool DenseSource<Value, From>::Fetch(const Strip& strip, StripMemory<Value>* memory) const {
  PlaceStrip(shape_, strip, memory);
  const auto [inside, end] = std::pair(memory->input.first, memory->input.last);
  const int64_t first = FirstChild(shape_, strip.at.x) + inside;
  const auto& [xs, ys, zs] = memory->samples;
  if constexpr (std::is_same_v<Value, float> && std::is_same_v<From, float>) {
    const bool copies = !memory->copied.empty();
    if (shape_.bias == 0 && end % 2 == 0 && !(copies && shape_.wavelet == Wavelet::kHaar)) {
      for (size_t i = 0; i < zs.size(); ++i) {
        memory->slices[i] = Slice(zs[i]) + first;
      }
      for (size_t i = 0; i < ys.size(); ++i) {
        memory->rows[i] = ys[i] * shape_.dims.x;
      }
      const bool is_last = first + end - inside >= shape_.dims.x;
      memory->input.next =
          is_last ? 2 * shape_.edge * shape_.dims.x - first : 2 * strip.bricks * shape_.edge;
      return true;
    }
  }
  UseOwnChildren(memory);
  Value* row = memory->children.get();
  bool good = true;
  for (const int64_t z : zs) {
    const From* const slice = Slice(z);
    for (const int64_t y : ys) {
      good &= Convert</*kMeans=*/false>(slice + y * shape_.dims.x + first, end - inside,
                                        shape_.bias, row + inside);
      CopyChildren(*memory, row);
      row += xs.size();
    }
  }
  return good;
}

template <typename Value, typename From>
void DenseSource<Value, From>::Release(int64_t slice) {
  while (!slabs_.empty() && slabs_.front().last <= slice) {
    slabs_.pop_front();
  }
}

template <typename Value, typename From>
BrickSource<Value, From>::BrickSource(const LevelShape& shape)
    : shape_(shape),
      absent_(static_cast<size_t>(shape.edge * shape.edge * shape.edge),
              static_cast<From>(shape.fill + shape.bias)) {}

template <typename Value, typename From>
void BrickSource<Value, From>::Add(std::vector<BrickAt<From>> bricks,
                                   std::shared_ptr<const void> owner) {
  layers_.push_back({std::move(bricks), std::move(owner)});
}

template <typename Value, typename From>
int64_t BrickSource<Value, From>::available() const {
  return std::min((first_layer_ + std::ssize(layers_)) * shape_.edge, shape_.dims.z);
}

template <typename Value, typename From>
std::vector<std::array<int64_t, 2>> BrickSource<Value, From>::Parents(int64_t z) const {
  const int64_t around = MarginOf(shape_.wavelet) > 0 ? 1 : 0;
  const auto last = [&](int64_t n) { return ((n + 1) / 2 - 1) / shape_.edge; };
  std::vector<std::array<int64_t, 2>> parents;
  const int64_t end = std::min(2 * z + 2 + around, first_layer_ + std::ssize(layers_));
  for (int64_t layer = std::max(2 * z - around, first_layer_); layer < end; ++layer) {
    for (const BrickAt<From>& brick : layers_[static_cast<size_t>(layer - first_layer_)].bricks) {
      const auto [by, bx] = brick.at;
      for (int64_t y = std::max<int64_t>(by - around, 0) / 2;
           y <= std::min((by + around) / 2, last(shape_.dims.y)); ++y) {
        for (int64_t x = std::max<int64_t>(bx - around, 0) / 2;
             x <= std::min((bx + around) / 2, last(shape_.dims.x)); ++x) {
          parents.push_back({y, x});
        }
      }
    }
  }
  std::sort(parents.begin(), parents.end());
  parents.erase(std::unique(parents.begin(), parents.end()), parents.end());
  return parents;
}

template <typename Value, typename From>
typename BrickSource<Value, From>::Neighbours BrickSource<Value, From>::Find(int64_t z, int64_t y,
                                                                             int64_t first) const {
  Neighbours found;
  found.fill(absent_.data());
  if (z < first_layer_ || z >= first_layer_ + std::ssize(layers_)) {
    return found;
  }
  const std::vector<BrickAt<From>>& bricks = layers_[static_cast<size_t>(z - first_layer_)].bricks;
  auto brick = std::lower_bound(
      bricks.begin(), bricks.end(), std::array<int64_t, 2>{y, first},
      [](const BrickAt<From>& a, const std::array<int64_t, 2>& b) { return a.at < b; });
  for (; brick != bricks.end() && brick->at[0] == y && brick->at[1] < first + kAround; ++brick) {
    found[static_cast<size_t>(brick->at[1] - first)] = brick->values;
  }
  return found;
}

template <typename Value, typename From>
bool BrickSource<Value, From>::Fetch(const Strip& strip, StripMemory<Value>* memory) const {
  PlaceStrip(shape_, strip, memory);
  const auto [inside, end] = std::pair(memory->input.first, memory->input.last);
  UseOwnChildren(memory);
  const int64_t edge = shape_.edge;
  const Int3& at = strip.at;
  const Int3 corner{2 * at.x - 1, 2 * at.y - 1, 2 * at.z - 1};  // the first brick that may be met
  std::array<std::array<Neighbours, 4>, 4> around;
  for (int z = 0; z < 4; ++z) {
    for (int y = 0; y < 4; ++y) {
      around[z][y] = Find(corner.z + z, corner.y + y, corner.x);
    }
  }
  const int64_t first = FirstChild(shape_, at.x);
  const auto& [xs, ys, zs] = memory->samples;
  Value* row = memory->children.get();
  bool good = true;
  for (const int64_t z : zs) {
    for (const int64_t y : ys) {
      const Neighbours& near = around[z / edge - corner.z][y / edge - corner.y];
      const int64_t in_brick = (z % edge * edge + y % edge) * edge;
      for (int64_t i = inside; i < end;) {
        const int64_t x = first + i;
        const int64_t count = std::min(edge - x % edge, end - i);
        good &= Convert<std::is_same_v<Value, From>>(
            near[static_cast<size_t>(x / edge - corner.x)] + in_brick + x % edge, count,
            shape_.bias, row + i);
        i += count;
      }
      CopyChildren(*memory, row);
      row += xs.size();
    }
  }
  return good;
}

template <typename Value, typename From>
void BrickSource<Value, From>::Release(int64_t slice) {
  while (!layers_.empty() && (first_layer_ + 1) * shape_.edge <= slice) {
    layers_.pop_front();
    ++first_layer_;
  }
}

template struct StripMemory<float>;
template struct StripMemory<int16_t>;
template struct StripMemory<int32_t>;
template class BrickSource<float, float>;
template class BrickSource<int16_t, float>;
template class BrickSource<int16_t, int16_t>;
template class BrickSource<int32_t, float>;
template class BrickSource<int32_t, int32_t>;
#define FOVEA_DENSE_SOURCES(Value)             \
  template class DenseSource<Value, uint8_t>;  \
  template class DenseSource<Value, int8_t>;   \
  template class DenseSource<Value, uint16_t>; \
  template class DenseSource<Value, int16_t>;  \
  template class DenseSource<Value, float>
FOVEA_DENSE_SOURCES(float);
FOVEA_DENSE_SOURCES(int16_t);
FOVEA_DENSE_SOURCES(int32_t);
#undef FOVEA_DENSE_SOURCES

}  // namespace fovea::wavelet::internal
