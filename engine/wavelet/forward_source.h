#ifndef ENGINE_WAVELET_FORWARD_SOURCE_H_
#define ENGINE_WAVELET_FORWARD_SOURCE_H_

#include <array>
#include <cstdint>
#include <deque>
#include <memory>
#include <span>
#include <vector>

#include "engine/volume/brick_grid.h"
#include "engine/volume/geometry.h"
#include "engine/wavelet/forward_kernels.h"

/// Where the forward stream takes the values of a level from: slices or bricks, of which a few
/// layers are held at a time. Reading is safe from several threads between changes.
namespace fovea::wavelet::internal {

/// What a level looks like to those that read it.
struct LevelShape {
  Wavelet wavelet = Wavelet::kHaar;
  Int3 dims;
  int64_t edge = 16;
  /// Taken from values as they are read, so that the background is 0: exact zeros where nothing is.
  /// (CDF 9/7 does not take a constant to exact zeros; the others do.)
  float bias = 0;
  /// Of absent bricks, less the bias.
  float fill = 0;
};

/// Bricks of the coarser level that are neighbours along x.
struct Strip {
  Int3 at;  // the first
  int64_t bricks = 1;
};

/// The children of a strip, as TransformStrip wants them, and the memory that it and they need. One
/// thread's.
template <typename Value>
struct StripMemory {
  explicit StripMemory(const LevelShape& shape);

  StripInput<Value> input;
  std::vector<const Value*> slices;
  std::vector<int64_t> rows;
  std::vector<CopiedChild> copied;
  bool copies_last = false;  // they are the last ones of a row, and copies of the one before
  /// Of each axis: where its children are in the level; those that are wanted.
  std::array<std::vector<int64_t>, 3> samples;
  std::shared_ptr<Value> children, work, detail;
};

template <typename Value>
class Source {
 public:
  virtual ~Source() = default;
  /// Slices that have come, from the first on.
  [[nodiscard]] virtual int64_t available() const = 0;
  /// The bricks {y, x} of layer z of the coarser level that are not background, in that order.
  [[nodiscard]] virtual std::vector<std::array<int64_t, 2>> Parents(int64_t z) const = 0;
  /// The children of a strip; false if one of them is no Value (not whole, too large).
  [[nodiscard]] virtual bool Fetch(const Strip& strip, StripMemory<Value>* memory) const = 0;
  /// Slices before `slice` are not read any more.
  virtual void Release(int64_t slice) = 0;
};

/// Slices in memory, of type From.
template <typename Value, typename From>
class DenseSource : public Source<Value> {
 public:
  explicit DenseSource(const LevelShape& shape) : shape_(shape) {}
  void Add(std::span<const From> slices, std::shared_ptr<const void> owner);

  [[nodiscard]] int64_t available() const override { return available_; }
  [[nodiscard]] std::vector<std::array<int64_t, 2>> Parents(int64_t z) const override;
  [[nodiscard]] bool Fetch(const Strip& strip, StripMemory<Value>* memory) const override;
  void Release(int64_t slice) override;

 private:
  struct Slab {
    int64_t first = 0, last = 0;
    const From* values = nullptr;
    std::shared_ptr<const void> owner;
  };
  [[nodiscard]] const From* Slice(int64_t z) const;

  const LevelShape shape_;
  int64_t available_ = 0;
  std::deque<Slab> slabs_;
};

/// A stored brick of a layer.
template <typename From>
struct BrickAt {
  std::array<int64_t, 2> at{};  // y, x
  const From* values = nullptr;
};

/// Layers of bricks of type From.
template <typename Value, typename From>
class BrickSource : public Source<Value> {
 public:
  explicit BrickSource(const LevelShape& shape);
  /// The next layer: its bricks in the order of `at`, held by `owner`.
  void Add(std::vector<BrickAt<From>> bricks, std::shared_ptr<const void> owner);

  [[nodiscard]] int64_t available() const override;
  [[nodiscard]] std::vector<std::array<int64_t, 2>> Parents(int64_t z) const override;
  [[nodiscard]] bool Fetch(const Strip& strip, StripMemory<Value>* memory) const override;
  void Release(int64_t slice) override;

 private:
  struct Layer {
    std::vector<BrickAt<From>> bricks;
    std::shared_ptr<const void> owner;
  };
  /// Bricks along x that a strip meets, at most.
  static constexpr int64_t kAround = 2 * MostBricks<Value>(Wavelet::kHaar) + 2;
  using Neighbours = std::array<const From*, kAround>;
  /// The bricks at (z, y) with x from `first` on; those that are absent are of background.
  [[nodiscard]] Neighbours Find(int64_t z, int64_t y, int64_t first) const;

  const LevelShape shape_;
  int64_t first_layer_ = 0;  // of those in layers_
  std::deque<Layer> layers_;
  std::vector<From> absent_;
};

}  // namespace fovea::wavelet::internal

#endif  // ENGINE_WAVELET_FORWARD_SOURCE_H_
