#include "engine/wavelet/forward_stream.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include "engine/base/buffers.h"
#include "engine/base/parallel.h"
#include "engine/wavelet/forward_kernels.h"
#include "engine/wavelet/forward_source.h"

// Each level below the voxels takes the means of the next finer one as layers of bricks. As soon as
// all children of a layer of coefficients are there, it is transformed strip by strip of bricks,
// every strip from a block of children that reaches as far around it as the filters do.

namespace fovea::wavelet {
namespace {

using internal::BrickAt;
using internal::BrickSource;
using internal::DenseSource;
using internal::LevelShape;
using internal::MarginOf;
using internal::Source;
using internal::Strip;
using internal::StripMemory;
using internal::TransformStrip;

/// Memory of strips that threads use by turns.
template <typename Value>
class StripPool {
 public:
  std::unique_ptr<StripMemory<Value>> Take(const LevelShape& shape) {
    const std::lock_guard lock(mutex_);
    if (free_.empty()) {
      return std::make_unique<StripMemory<Value>>(shape);
    }
    auto memory = std::move(free_.back());
    free_.pop_back();
    return memory;
  }
  void GiveBack(std::unique_ptr<StripMemory<Value>> memory) {
    const std::lock_guard lock(mutex_);
    free_.push_back(std::move(memory));
  }

 private:
  std::mutex mutex_;
  std::vector<std::unique_ptr<StripMemory<Value>>> free_;
};

/// Fills the values of a brick past its first `counts` along each axis.
template <typename Value>
void FillPast(const Int3& counts, int64_t edge, Value fill, Value* cells) {
  const Int3 kept{std::clamp<int64_t>(counts.x, 0, edge), std::clamp<int64_t>(counts.y, 0, edge),
                  std::clamp<int64_t>(counts.z, 0, edge)};
  for (int64_t z = 0; z < kept.z; ++z) {
    Value* const slice = cells + z * edge * edge;
    for (int64_t y = 0; kept.x < edge && y < kept.y; ++y) {
      std::fill(slice + y * edge + kept.x, slice + (y + 1) * edge, fill);
    }
    std::fill(slice + kept.y * edge, slice + edge * edge, fill);
  }
  std::fill(cells + kept.z * edge * edge, cells + edge * edge * edge, fill);
}

/// The largest |value|; not finite if one is not. Magnitudes are in the order of their bits, NaN
/// the largest of all, and compilers make vectors of integers.
float LargestOf(std::span<const float> values) {
  int32_t largest = 0;
  for (const float value : values) {
    largest = std::max(largest, std::bit_cast<int32_t>(value) & INT32_MAX);
  }
  return std::bit_cast<float>(largest);
}

/// The largest |value|.
template <typename Value>
float LargestOf(std::span<const Value> values) {
  Value least = 0, most = 0;
  for (const Value value : values) {
    least = std::min(least, value);
    most = std::max(most, value);
  }
  return std::max(-static_cast<float>(least), static_cast<float>(most));
}

/// The larger of two that LargestOf gave: NaN if one is.
float Larger(float a, float b) {
  return std::bit_cast<int32_t>(a) > std::bit_cast<int32_t>(b) ? a : b;
}

template <typename Value>
class Stream final : public ForwardStream {
 public:
  Stream(const ForwardStreamOptions& options, DetailSink* sink)
      : options_(options),
        sink_(*sink),
        bias_(options.basis.wavelet == Wavelet::kCdf97 ? options.background : 0.0F),
        coarse_(Box3::OfSize(options.hierarchy.DimsAt(0)), options.background),
        levels_(static_cast<size_t>(options.hierarchy.finest())) {
    for (int level = 0; level + 1 < options_.hierarchy.finest(); ++level) {
      auto source = std::make_unique<BrickSource<Value, Value>>(ShapeOf(level + 1));
      levels_[static_cast<size_t>(level)].means = source.get();
      levels_[static_cast<size_t>(level)].source = std::move(source);
    }
  }

  Status Push(const VoxelSpan& slices, std::shared_ptr<const void> owner) override {
    return Do([&] {
      return std::visit([&](auto values) { return PushSlices(values, std::move(owner)); }, slices);
    });
  }
  Status Push(std::shared_ptr<const BrickGrid> bricks, int64_t layers) override {
    return Do([&] { return PushBricks(std::move(bricks), layers); });
  }
  StatusOr<Grid> Finish() override {
    FOVEA_RETURN_IF_ERROR(status_);
    if (received_ < options_.hierarchy.dims().z) {
      return FailedPrecondition("the forward transform got {} slices of {}", received_,
                                options_.hierarchy.dims().z);
    }
    status_ = FailedPrecondition("the forward transform was finished before");
    return std::move(coarse_);
  }

 private:
  /// From the values of level l + 1 to level l.
  struct Level {
    std::unique_ptr<Source<Value>> source;
    BrickSource<Value, Value>* means = nullptr;  // the source, where it is the level above's means
    int64_t next = 0;                            // the layer of bricks to make
  };

  template <typename Action>
  Status Do(const Action& action) {
    FOVEA_RETURN_IF_ERROR(status_);
    status_ = action();
    return status_;
  }

  [[nodiscard]] int64_t CubeOf() const { return options_.edge * options_.edge * options_.edge; }
  [[nodiscard]] LevelShape ShapeOf(int level) const {
    return {options_.basis.wavelet, options_.hierarchy.DimsAt(level), options_.edge,
            level == options_.hierarchy.finest() ? bias_ : 0.0F, options_.background - bias_};
  }

  template <typename From>
  Status PushSlices(std::span<const From> slices, std::shared_ptr<const void> owner);
  Status PushBricks(std::shared_ptr<const BrickGrid> bricks, int64_t layers);
  /// The voxels' source, made as Kind the first time; null if it is of another kind.
  template <typename Kind>
  Kind* SourceOfVoxels();
  /// Counts slices; an error if there are too many.
  Status Receive(int64_t slices);

  Status Advance(int level);
  Status MakeLayer(int level, int64_t z);
  Status MakeStrip(int level, const Strip& strip, StripMemory<Value>* memory, Value* means);
  float ClearPastBorder(int level, const Int3& at, Value* detail) const;
  void PutCoarse(const Int3& at, const Value* means);

  const ForwardStreamOptions options_;
  DetailSink& sink_;
  const float bias_;
  Status status_;
  int64_t received_ = 0;
  Grid coarse_;
  std::vector<Level> levels_;
  std::unique_ptr<Source<Value>> voxels_;  // where nothing is halved
  StripPool<Value> memories_;
};

template <typename Value>
Status Stream<Value>::Receive(int64_t slices) {
  const int64_t all = options_.hierarchy.dims().z;
  if (slices > all - received_) {
    return InvalidArgument("the forward transform got {} slices, of {} that there are",
                           received_ + slices, all);
  }
  received_ += slices;
  return absl::OkStatus();
}

template <typename Value>
template <typename Kind>
Kind* Stream<Value>::SourceOfVoxels() {
  std::unique_ptr<Source<Value>>& source = levels_.empty() ? voxels_ : levels_.back().source;
  if (source == nullptr) {
    source = std::make_unique<Kind>(ShapeOf(options_.hierarchy.finest()));
  }
  return dynamic_cast<Kind*>(source.get());
}

template <typename Value>
template <typename From>
Status Stream<Value>::PushSlices(std::span<const From> slices, std::shared_ptr<const void> owner) {
  const Int3& dims = options_.hierarchy.dims();
  if (std::ssize(slices) % (dims.x * dims.y) != 0) {
    return InvalidArgument("{} values are no whole slices of {} x {}", slices.size(), dims.x,
                           dims.y);
  }
  const int64_t first = received_;
  FOVEA_RETURN_IF_ERROR(Receive(std::ssize(slices) / (dims.x * dims.y)));
  if (levels_.empty()) {
    std::copy(slices.begin(), slices.end(), coarse_.values.begin() + first * dims.x * dims.y);
    return absl::OkStatus();
  }
  auto* const source = SourceOfVoxels<DenseSource<Value, From>>();
  if (source == nullptr) {
    return InvalidArgument("voxels of one kind follow voxels of another");
  }
  source->Add(slices, std::move(owner));
  return Advance(options_.hierarchy.finest() - 1);
}

template <typename Value>
Status Stream<Value>::PushBricks(std::shared_ptr<const BrickGrid> bricks, int64_t layers) {
  const Int3& dims = options_.hierarchy.dims();
  const int64_t edge = options_.edge;
  if (bricks->dims() != dims || bricks->edge() != edge || bricks->channels() != 1 ||
      bricks->background() != options_.background || received_ % edge != 0) {
    return InvalidArgument("bricks of another grid than the options of the transform announce");
  }
  for (int64_t layer = 0; layer < layers; ++layer) {
    const int64_t z = received_ / edge;
    FOVEA_RETURN_IF_ERROR(Receive(std::min(edge, std::max<int64_t>(dims.z - received_, 1))));
    if (levels_.empty()) {
      bricks->CopyOut(coarse_.box, coarse_.values);
      continue;
    }
    auto* const source = SourceOfVoxels<BrickSource<Value, float>>();
    if (source == nullptr) {
      return InvalidArgument("voxels of one kind follow voxels of another");
    }
    std::vector<BrickAt<float>> stored;
    for (auto brick = bricks->bricks().lower_bound({z, 0, 0});
         brick != bricks->bricks().end() && brick->first[0] == z; ++brick) {
      stored.push_back({{brick->first[1], brick->first[2]}, brick->second.data()});
    }
    source->Add(std::move(stored), bricks);
    FOVEA_RETURN_IF_ERROR(Advance(options_.hierarchy.finest() - 1));
  }
  return absl::OkStatus();
}

/// Makes the layers of `level`, and of those below it, whose children are all there.
template <typename Value>
Status Stream<Value>::Advance(int level) {
  Level& here = levels_[static_cast<size_t>(level)];
  const int64_t slices = options_.hierarchy.DimsAt(level + 1).z;
  const int64_t edge = options_.edge;
  const int64_t margin = 2 * MarginOf(options_.basis.wavelet);
  const int64_t layers = (options_.hierarchy.DimsAt(level).z + edge - 1) / edge;
  while (here.next < layers &&
         here.source->available() >= std::min(2 * edge * (here.next + 1) + margin, slices)) {
    FOVEA_RETURN_IF_ERROR(MakeLayer(level, here.next));
    ++here.next;
    here.source->Release(here.next < layers ? 2 * edge * here.next - margin : slices + edge);
    if (level > 0) {
      FOVEA_RETURN_IF_ERROR(Advance(level - 1));
    }
  }
  return absl::OkStatus();
}

/// Where runs of neighbours along x begin, each of at most `most`; and the end.
std::vector<int64_t> Runs(const std::vector<std::array<int64_t, 2>>& bricks, int64_t most) {
  std::vector<int64_t> starts;
  const auto count = std::ssize(bricks);
  for (int64_t i = 0; i < count; ++i) {
    const std::array<int64_t, 2>& at = bricks[static_cast<size_t>(i)];
    if (i == 0 || i - starts.back() == most ||
        bricks[static_cast<size_t>(i - 1)] != std::array<int64_t, 2>{at[0], at[1] - 1}) {
      starts.push_back(i);
    }
  }
  starts.push_back(count);
  return starts;
}

template <typename Value>
Status Stream<Value>::MakeLayer(int level, int64_t z) {
  const std::vector<std::array<int64_t, 2>> parents =
      levels_[static_cast<size_t>(level)].source->Parents(z);
  if (parents.empty()) {
    if (level > 0) {
      levels_[static_cast<size_t>(level - 1)].means->Add({}, nullptr);
    }
    return sink_.EndLayer(level, z);
  }
  const std::vector<int64_t> runs =
      Runs(parents, internal::MostBricks<Value>(options_.basis.wavelet));
  const std::shared_ptr<Value> cells =
      TakeBuffer<Value>(parents.size() * static_cast<size_t>(CubeOf()));
  const Value background = static_cast<Value>(options_.background - bias_);
  std::vector<BrickAt<Value>> means(parents.size());
  std::mutex mutex;
  Status failed;  // of the first strip, in order, that failed
  int64_t failed_at = std::ssize(runs);
  ParallelFor(0, std::ssize(runs) - 1, 2, options_.threads, [&](int64_t first, int64_t last) {
    auto memory = memories_.Take(ShapeOf(level));
    for (int64_t run = first; run < last; ++run) {
      const int64_t begin = runs[static_cast<size_t>(run)],
                    end = runs[static_cast<size_t>(run + 1)];
      const auto [y, x] = parents[static_cast<size_t>(begin)];
      const Status status =
          MakeStrip(level, {{x, y, z}, end - begin}, memory.get(), cells.get() + begin * CubeOf());
      if (!status.ok()) {
        const std::lock_guard lock(mutex);
        if (run < failed_at) {
          failed_at = run;
          failed = status;
        }
        break;
      }
      for (int64_t i = begin; i < end; ++i) {
        Value* const low = cells.get() + i * CubeOf();
        if (!std::all_of(low, low + CubeOf(), [=](Value value) { return value == background; })) {
          means[static_cast<size_t>(i)] = {parents[static_cast<size_t>(i)], low};
        }
      }
    }
    memories_.GiveBack(std::move(memory));
  });
  FOVEA_RETURN_IF_ERROR(failed);
  std::erase_if(means, [](const BrickAt<Value>& brick) { return brick.values == nullptr; });
  if (level == 0) {
    for (const BrickAt<Value>& brick : means) {
      PutCoarse({brick.at[1], brick.at[0], z}, brick.values);
    }
  } else {
    levels_[static_cast<size_t>(level - 1)].means->Add(std::move(means), cells);
  }
  return sink_.EndLayer(level, z);
}

template <typename Value>
Status Stream<Value>::MakeStrip(int level, const Strip& strip, StripMemory<Value>* memory,
                                Value* means) {
  if (!levels_[static_cast<size_t>(level)].source->Fetch(strip, memory)) {
    return InvalidArgument(
        "a voxel is not a whole number of at most {} in magnitude, as this integer transform needs",
        sizeof(Value) == 2 ? kMostShortVoxel : kMostVoxel);
  }
  // Rounding goes up where axis + level is odd.
  memory->input.up = {level % 2 != 0, level % 2 == 0, level % 2 != 0};
  std::array<float, internal::MostBricks<Value>(Wavelet::kHaar)> largest{};
  TransformStrip(options_.basis.wavelet, memory->input, memory->work.get(), means,
                 memory->detail.get(), largest.data());
  const Int3 dims = options_.hierarchy.DimsAt(level + 1);
  const int64_t reach = 2 * options_.edge;
  for (int64_t i = 0; i < strip.bricks; ++i) {
    const Int3 at{strip.at.x + i, strip.at.y, strip.at.z};
    Value* const detail = memory->detail.get() + 7 * i * CubeOf();
    float most = largest[static_cast<size_t>(i)];
    if (memory->input.wanted_y < options_.edge || memory->input.wanted_z < options_.edge) {
      FillPast({options_.edge, memory->input.wanted_y, memory->input.wanted_z}, options_.edge,
               static_cast<Value>(options_.background - bias_), means + i * CubeOf());
    }
    if ((at.x + 1) * reach > dims.x || (at.y + 1) * reach > dims.y || (at.z + 1) * reach > dims.z) {
      most = ClearPastBorder(level, at, detail);
    }
    if (most != 0) {
      const std::span<const Value> values(detail, static_cast<size_t>(7 * CubeOf()));
      FOVEA_RETURN_IF_ERROR(sink_.Take({level, at, std::as_bytes(values), most}));
    }
  }
  return absl::OkStatus();
}

/// What there is no coefficient for becomes zero; returns the largest of those that remain.
template <typename Value>
float Stream<Value>::ClearPastBorder(int level, const Int3& at, Value* detail) const {
  const Int3 dims = options_.hierarchy.DimsAt(level + 1);
  const int64_t edge = options_.edge;
  const Int3 own = options_.hierarchy.DimsAt(level);
  const int64_t height = std::min(edge, own.y - at.y * edge);
  const int64_t depth = std::min(edge, own.z - at.z * edge);
  float largest = 0;
  for (int band = 1; band < 8; ++band) {
    Int3 counts;
    for (int axis = 0; axis < 3; ++axis) {
      const int64_t all = (dims[axis] + 1 - ((band >> axis) & 1)) / 2;
      counts[axis] = all - at[axis] * edge;
    }
    Value* const cells = detail + (band - 1) * CubeOf();
    FillPast(counts, edge, Value{0}, cells);
    for (int64_t z = 0; z < depth; ++z) {
      const std::span<const Value> rows(cells + z * edge * edge,
                                        static_cast<size_t>(height * edge));
      largest = Larger(largest, LargestOf(rows));
    }
  }
  return largest;
}

template <typename Value>
void Stream<Value>::PutCoarse(const Int3& at, const Value* means) {
  const int64_t edge = options_.edge;
  const Int3 corner{at.x * edge, at.y * edge, at.z * edge};
  const Int3 end =
      Intersect(coarse_.box, {corner, {corner.x + edge, corner.y + edge, corner.z + edge}}).hi;
  for (int64_t z = corner.z; z < end.z; ++z) {
    for (int64_t y = corner.y; y < end.y; ++y) {
      const Value* const row = means + ((z - corner.z) * edge + y - corner.y) * edge;
      float* const to = coarse_.Row(y, z) + corner.x;
      for (int64_t i = 0; i < end.x - corner.x; ++i) {
        to[i] = static_cast<float>(row[i]) + bias_;
      }
    }
  }
}

Status CheckOptions(const ForwardStreamOptions& options) {
  if (options.edge < 4 || options.edge % 2 != 0) {
    return InvalidArgument("bricks of edge {}: it must be an even number, 4 or more", options.edge);
  }
  if (options.basis.integer != (options.type != CoefficientType::kFloat32)) {
    return InvalidArgument("an integer basis has integer coefficients, and only that");
  }
  if (options.basis.integer && options.basis.wavelet == Wavelet::kCdf97) {
    return InvalidArgument("there is no reversible integer form of cdf97");
  }
  const float most = options.type == CoefficientType::kInt16 ? kMostShortVoxel : kMostVoxel;
  if (options.basis.integer && (!(std::fabs(options.background) <= most) ||
                                options.background != std::trunc(options.background))) {
    return InvalidArgument("background {}: it must be a whole number of at most {} in magnitude",
                           options.background, most);
  }
  return absl::OkStatus();
}

}  // namespace

StatusOr<std::unique_ptr<ForwardStream>> ForwardStream::Make(const ForwardStreamOptions& options,
                                                             DetailSink* sink) {
  FOVEA_RETURN_IF_ERROR(CheckOptions(options));
  std::unique_ptr<ForwardStream> stream;
  if (options.type == CoefficientType::kFloat32) {
    stream = std::make_unique<Stream<float>>(options, sink);
  } else if (options.type == CoefficientType::kInt16) {
    stream = std::make_unique<Stream<int16_t>>(options, sink);
  } else {
    stream = std::make_unique<Stream<int32_t>>(options, sink);
  }
  return stream;
}

}  // namespace fovea::wavelet
