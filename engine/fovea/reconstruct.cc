#include "engine/fovea/reconstruct.h"

#include <algorithm>

#include "engine/base/parallel.h"
#include "engine/base/stopwatch.h"
#include "engine/wavelet/transform.h"

namespace fovea {
namespace {

/// What an exact level keeps around its box: the apron, and the samples beyond it that resampling
/// reads. This is also as far as the next level's inverse reaches, whatever the rate.
constexpr int64_t kReach = kApron + 1;

Grid CopyPart(const Grid& whole, const Box3& box) {
  Grid part(box);
  for (int64_t z = box.lo.z; z < box.hi.z; ++z) {
    for (int64_t y = box.lo.y; y < box.hi.y; ++y) {
      std::copy_n(whole.Row(y, z) + (box.lo.x - whole.box.lo.x), box.hi.x - box.lo.x,
                  part.Row(y, z));
    }
  }
  return part;
}

/// Linear interpolation of four rows of samples at the same place between them on all three axes.
void ResampleRow(const float* const (&rows)[4], float f, int64_t last, int64_t count, float* out) {
  const auto mixed = [&](int64_t x) {
    const float a = rows[0][x] + f * (rows[1][x] - rows[0][x]);
    const float b = rows[2][x] + f * (rows[3][x] - rows[2][x]);
    return a + f * (b - a);
  };
  for (int64_t x = 0; x < count; ++x) {
    out[x] = mixed(x);
  }
  const float after = mixed(std::min(count, last));
  for (int64_t x = 0; x < count; ++x) {
    const float next = x + 1 < count ? out[x + 1] : after;
    out[x] += f * (next - out[x]);
  }
}

/// Puts into `level`, where `samples` has any, the values at the centres of cells `width` voxels
/// wide: sample p stands at voxel p * width.
void ResampleAtCentres(const Grid& samples, int64_t width, int threads, Grid* level) {
  const Box3 part = Intersect(level->box, samples.box);
  const auto w = static_cast<float>(width);
  const float f = (w - 1) / (2 * w);
  const Box3& box = samples.box;
  const int64_t skip = part.lo.x - box.lo.x;
  ParallelFor(part.lo.z, part.hi.z, 4, threads, [&](int64_t first, int64_t last) {
    for (int64_t z = first; z < last; ++z) {
      const int64_t next_z = std::min(z + 1, box.hi.z - 1);
      for (int64_t y = part.lo.y; y < part.hi.y; ++y) {
        const int64_t next_y = std::min(y + 1, box.hi.y - 1);
        const float* const rows[4] = {samples.Row(y, z) + skip, samples.Row(next_y, z) + skip,
                                      samples.Row(y, next_z) + skip,
                                      samples.Row(next_y, next_z) + skip};
        float* const out = level->Row(y, z) + (part.lo.x - level->box.lo.x);
        const int64_t count = part.hi.x - part.lo.x;
        if (f == 0) {
          std::copy_n(rows[0], count, out);
        } else {
          ResampleRow(rows, f, box.hi.x - 1 - part.lo.x, count, out);
        }
      }
    }
  });
}

/// Every position inside the volume becomes a copy of its parent.
void CopyParents(const Grid& parent, const Int3& dims, Grid* child) {
  const Box3 inside = Intersect(child->box, Box3::OfSize(dims));
  for (int64_t z = inside.lo.z; z < inside.hi.z; ++z) {
    for (int64_t y = inside.lo.y; y < inside.hi.y; ++y) {
      const float* const from = parent.Row(y >> 1, z >> 1) - parent.box.lo.x;
      float* const to = child->Row(y, z) - child->box.lo.x;
      for (int64_t x = inside.lo.x; x < inside.hi.x; ++x) {
        to[x] = from[x >> 1];
      }
    }
  }
}

/// Makes the levels of one volume, coarsest first, in the memory of those that are there.
class LevelMaker {
 public:
  LevelMaker(const Basis& basis, Reconstruction how, const RetainedSet& retained, int threads,
             std::vector<Grid>* levels)
      : basis_(basis), how_(how), retained_(retained), threads_(threads), levels_(*levels) {
    levels_.resize(static_cast<size_t>(retained.hierarchy().finest()) + 1);
  }

  void Coarsest(Grid samples) {
    Grid& grid = levels_.front();
    Reset(samples.box.Grown(kApron), &grid);
    ResampleAtCentres(samples, CellWidth(0), threads_, &grid);
    RepeatBorder(samples.box, &grid);
    samples_ = std::move(samples);
  }

  /// Level `level` + 1, which may be empty.
  void Next(int level, std::span<const float> detail) {
    const Box3& window = retained_.window(level);
    const Int3 dims = retained_.hierarchy().DimsAt(level + 1);
    const Box3& box = retained_.box(level + 1);
    const Grid& parent = levels_[static_cast<size_t>(level)];
    Grid& grid = levels_[static_cast<size_t>(level) + 1];
    Reset(window.IsEmpty() ? Box3{} : box.Grown(kApron), &grid);
    if (window.IsEmpty()) {
      return;
    }
    if (basis_.wavelet == Wavelet::kHaar) {
      wavelet::InverseLevel(basis_, level, parent, window, detail, dims, threads_, &grid);
      return;
    }
    const bool fast = how_ == Reconstruction::kFast;
    if (fast) {
      samples_ = CopyPart(samples_, window);  // beyond its edge InverseLevel mirrors it
      CopyParents(parent, dims, &grid);
    }
    Reset(fast ? box : Intersect(box.Grown(kReach), Box3::OfSize(dims)), &finer_samples_);
    wavelet::InverseLevel(basis_, level, samples_, window, detail, dims, threads_, &finer_samples_);
    std::swap(samples_, finer_samples_);
    ResampleAtCentres(samples_, CellWidth(level + 1), threads_, &grid);
    RepeatBorder(Intersect(grid.box, Box3::OfSize(dims)), &grid);
  }

 private:
  static void Reset(const Box3& box, Grid* grid) {
    grid->box = box;
    grid->values.resize(static_cast<size_t>(box.Volume()));
  }

  /// The width of the cells in whose middle values belong; 1 where they stand there already.
  [[nodiscard]] int64_t CellWidth(int level) const {
    return basis_.wavelet == Wavelet::kHaar ? 1 : retained_.hierarchy().WidthAt(level);
  }

  const Basis basis_;
  const Reconstruction how_;
  const RetainedSet& retained_;
  const int threads_;
  std::vector<Grid>& levels_;
  Grid samples_;        // the last level's, where they stand
  Grid finer_samples_;  // memory for the next one's
};

}  // namespace

Status ReconstructInto(CoefficientSource& source, const RetainedSet& retained, int threads,
                       Reconstruction how, SuperVoxels* volume, ReconstructStats* stats) {
  ReconstructStats times;
  Stopwatch watch;
  const Hierarchy& hierarchy = retained.hierarchy();
  volume->retained = retained;
  LevelMaker maker(source.basis(), how, volume->retained, threads, &volume->levels);
  Grid coarse(Box3::OfSize(hierarchy.DimsAt(0)));
  FOVEA_RETURN_IF_ERROR(source.ReadCoarse(coarse.values));
  times.read_ms += watch.RestartMs();
  maker.Coarsest(std::move(coarse));
  times.reconstruct_ms += watch.RestartMs();
  std::vector<float> detail;
  for (int level = 0; level < hierarchy.finest(); ++level) {
    const Box3& window = retained.window(level);
    detail.resize(static_cast<size_t>(7 * window.Volume()));
    watch.RestartMs();
    if (!window.IsEmpty()) {
      FOVEA_RETURN_IF_ERROR(source.ReadDetail(level, window, detail));
      times.read_ms += watch.RestartMs();
      retained.Weigh(level, window, detail);
    }
    maker.Next(level, detail);
    times.reconstruct_ms += watch.RestartMs();
  }
  volume->blocks.clear();
  for (const Grid& level : volume->levels) {
    volume->blocks.push_back(MakeValueBlocks(level, threads));
  }
  times.reconstruct_ms += watch.RestartMs();
  if (stats != nullptr) {
    *stats = times;
  }
  return absl::OkStatus();
}

StatusOr<SuperVoxels> Reconstruct(CoefficientSource& source, const RetainedSet& retained,
                                  int threads, ReconstructStats* stats, Reconstruction how) {
  SuperVoxels volume;
  FOVEA_RETURN_IF_ERROR(ReconstructInto(source, retained, threads, how, &volume, stats));
  return volume;
}

SuperVoxels WholeVolume(const Grid& voxels, const Vec3& fovea, int threads) {
  SuperVoxels whole;
  whole.retained = RetainedSet::Whole(voxels.box.Size(), fovea);
  Grid grid(voxels.box.Grown(kApron));
  ResampleAtCentres(voxels, /*width=*/1, threads, &grid);
  RepeatBorder(voxels.box, &grid);
  whole.levels.push_back(std::move(grid));
  whole.blocks.push_back(MakeValueBlocks(whole.levels.front(), threads));
  return whole;
}

StatusOr<Grid> ExtractVoxels(CoefficientSource& source, const Box3& box,
                             const RetainedSet* retained) {
  const Hierarchy& hierarchy = source.hierarchy();
  const Basis basis = source.basis();
  std::vector<Box3> boxes(static_cast<size_t>(hierarchy.finest()) + 1);
  boxes.back() = Intersect(box, Box3::OfSize(hierarchy.dims()));
  if (boxes.back() != box || box.IsEmpty()) {
    return InvalidArgument(
        "box {},{},{} to {},{},{} is not within the volume of {} x {} x {} voxels", box.lo.x,
        box.lo.y, box.lo.z, box.hi.x, box.hi.y, box.hi.z, hierarchy.dims().x, hierarchy.dims().y,
        hierarchy.dims().z);
  }
  for (int level = hierarchy.finest() - 1; level >= 0; --level) {
    boxes[level] = wavelet::ParentsOf(basis.wavelet, boxes[level + 1], hierarchy.DimsAt(level + 1));
  }
  Grid grid(Box3::OfSize(hierarchy.DimsAt(0)));
  FOVEA_RETURN_IF_ERROR(source.ReadCoarse(grid.values));
  std::vector<float> detail;
  for (int level = 0; level < hierarchy.finest(); ++level) {
    const Box3 window =
        retained != nullptr ? Intersect(boxes[level], retained->window(level)) : boxes[level];
    detail.resize(static_cast<size_t>(7 * window.Volume()));
    if (!window.IsEmpty()) {
      FOVEA_RETURN_IF_ERROR(source.ReadDetail(level, window, detail));
    }
    if (retained != nullptr) {
      retained->Weigh(level, window, detail);
    }
    Grid child(boxes[level + 1]);
    wavelet::InverseLevel(basis, level, grid, window, detail, hierarchy.DimsAt(level + 1), 0,
                          &child);
    grid = std::move(child);
  }
  return hierarchy.finest() == 0 ? CopyPart(grid, box) : grid;
}

}  // namespace fovea
