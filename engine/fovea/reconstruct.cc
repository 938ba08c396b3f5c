#include "engine/fovea/reconstruct.h"

#include <algorithm>

#include "engine/base/parallel.h"
#include "engine/base/stopwatch.h"
#include "engine/wavelet/haar.h"

namespace fovea {
namespace {

/// A whole level grown by the apron, whose values repeat the border.
Grid WithApron(const Grid& inner, int threads) {
  const Int3 dims = inner.box.Size();
  Grid grid(inner.box.Grown(kApron));
  ParallelFor(grid.box.lo.z, grid.box.hi.z, 4, threads, [&](int64_t first, int64_t last) {
    for (int64_t z = first; z < last; ++z) {
      for (int64_t y = grid.box.lo.y; y < grid.box.hi.y; ++y) {
        const float* from =
            inner.Row(std::clamp<int64_t>(y, 0, dims.y - 1), std::clamp<int64_t>(z, 0, dims.z - 1));
        float* to = std::fill_n(grid.Row(y, z), kApron, from[0]);
        std::fill_n(std::copy_n(from, dims.x, to), kApron, from[dims.x - 1]);
      }
    }
  });
  return grid;
}

StatusOr<Grid> CoarsestGrid(CoefficientSource& source) {
  Grid inner(Box3::OfSize(source.hierarchy().DimsAt(0)));
  FOVEA_RETURN_IF_ERROR(source.ReadCoarse(inner.values));
  return WithApron(inner, 1);
}

Box3 ParentsOf(const Box3& box) {
  return {{box.lo.x >> 1, box.lo.y >> 1, box.lo.z >> 1},
          {(box.hi.x + 1) >> 1, (box.hi.y + 1) >> 1, (box.hi.z + 1) >> 1}};
}

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

}  // namespace

StatusOr<SuperVoxels> Reconstruct(CoefficientSource& source, const RetainedSet& retained,
                                  int threads, ReconstructStats* stats) {
  ReconstructStats times;
  Stopwatch watch;
  const Hierarchy& hierarchy = retained.hierarchy();
  SuperVoxels result;
  result.retained = retained;
  FOVEA_ASSIGN_OR_RETURN(Grid coarsest, CoarsestGrid(source));
  times.read_ms += watch.RestartMs();
  result.levels.push_back(std::move(coarsest));
  std::vector<float> detail;
  for (int level = 0; level < hierarchy.finest(); ++level) {
    const Box3& window = retained.window(level);
    if (window.IsEmpty()) {
      result.levels.emplace_back();
      continue;
    }
    detail.resize(static_cast<size_t>(7 * window.Volume()));
    watch.RestartMs();
    FOVEA_RETURN_IF_ERROR(source.ReadDetail(level, window, detail));
    times.read_ms += watch.RestartMs();
    retained.Weigh(level, window, detail);
    Grid child(retained.box(level + 1).Grown(kApron));
    wavelet::InverseHaarLevel(result.levels[level], window, detail, hierarchy.DimsAt(level + 1),
                              threads, &child);
    result.levels.push_back(std::move(child));
    times.reconstruct_ms += watch.RestartMs();
  }
  for (const Grid& level : result.levels) {
    result.blocks.push_back(MakeValueBlocks(level, threads));
  }
  times.reconstruct_ms += watch.RestartMs();
  if (stats != nullptr) {
    *stats = times;
  }
  return result;
}

SuperVoxels WholeVolume(const Grid& voxels, const Vec3& fovea, int threads) {
  SuperVoxels whole;
  whole.retained = RetainedSet::Whole(voxels.box.Size(), fovea);
  whole.levels.push_back(WithApron(voxels, threads));
  whole.blocks.push_back(MakeValueBlocks(whole.levels.front(), threads));
  return whole;
}

StatusOr<Grid> ExtractVoxels(CoefficientSource& source, const Box3& box,
                             const RetainedSet* retained) {
  const Hierarchy& hierarchy = source.hierarchy();
  std::vector<Box3> boxes(static_cast<size_t>(hierarchy.finest()) + 1);
  boxes.back() = Intersect(box, Box3::OfSize(hierarchy.dims()));
  if (boxes.back() != box || box.IsEmpty()) {
    return InvalidArgument(
        "box {},{},{} to {},{},{} is not within the volume of {} x {} x {} voxels", box.lo.x,
        box.lo.y, box.lo.z, box.hi.x, box.hi.y, box.hi.z, hierarchy.dims().x, hierarchy.dims().y,
        hierarchy.dims().z);
  }
  for (int level = hierarchy.finest() - 1; level >= 0; --level) {
    boxes[level] = ParentsOf(boxes[level + 1]);
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
    wavelet::InverseHaarLevel(grid, window, detail, hierarchy.DimsAt(level + 1), 0, &child);
    grid = std::move(child);
  }
  return hierarchy.finest() == 0 ? CopyPart(grid, box) : grid;
}

}  // namespace fovea
