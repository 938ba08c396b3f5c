#include "tests/bench/separable_source.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <utility>

#include "engine/volume/grid.h"
#include "tests/bench/scenes.h"

namespace fovea::bench {
namespace {

constexpr double kReach = 5;  // sigmas beyond which a blob is nothing

/// The means of exp(-((x - center) / sigma)^2 / 2) over cells of `width` that begin at `first`.
std::vector<float> CellMeans(double center, double sigma, double width, int64_t first,
                             int64_t count) {
  const double scale = 1 / (sigma * std::sqrt(2.0));
  const double factor = sigma * std::sqrt(std::acos(-1.0) / 2) / width;
  const auto integral = [&](int64_t cell) {
    return factor * std::erf((static_cast<double>(cell) * width - center) * scale);
  };
  std::vector<float> means;
  double below = integral(first);
  for (int64_t i = 0; i < count; ++i) {
    const double above = integral(first + i + 1);
    means.push_back(static_cast<float>(above - below));
    below = above;
  }
  return means;
}

/// The cells of `box` that a blob reaches.
Box3 Reached(const SeparableSource::Blob& blob, double width, const Box3& box) {
  Box3 reached;
  for (int axis = 0; axis < 3; ++axis) {
    const double reach = kReach * blob.sigma;
    reached.lo[axis] = static_cast<int64_t>(std::floor((blob.center[axis] - reach) / width));
    reached.hi[axis] = static_cast<int64_t>(std::ceil((blob.center[axis] + reach) / width));
  }
  return Intersect(reached, box);
}

void AddBlob(const SeparableSource::Blob& blob, double width, Grid* means) {
  const Box3 box = Reached(blob, width, means->box);
  if (box.IsEmpty()) {
    return;
  }
  std::array<std::vector<float>, 3> along;
  for (int axis = 0; axis < 3; ++axis) {
    along[axis] =
        CellMeans(blob.center[axis], blob.sigma, width, box.lo[axis], box.hi[axis] - box.lo[axis]);
  }
  for (int64_t z = box.lo.z; z < box.hi.z; ++z) {
    for (int64_t y = box.lo.y; y < box.hi.y; ++y) {
      const float of_row =
          static_cast<float>(blob.height) * along[1][y - box.lo.y] * along[2][z - box.lo.z];
      float* row = &means->At(box.lo.x, y, z);
      for (size_t x = 0; x < along[0].size(); ++x) {
        row[x] += of_row * along[0][x];
      }
    }
  }
}

}  // namespace

SeparableSource::SeparableSource(const Hierarchy& hierarchy, std::vector<Blob> blobs)
    : hierarchy_(hierarchy), blobs_(std::move(blobs)) {}

Grid SeparableSource::MeansOf(int level, const Box3& box) const {
  Grid means(box);
  for (const Blob& blob : blobs_) {
    AddBlob(blob, static_cast<double>(hierarchy_.WidthAt(level)), &means);
  }
  return means;
}

Status SeparableSource::ReadCoarse(std::span<float> out) {
  const Grid means = MeansOf(0, Box3::OfSize(hierarchy_.DimsAt(0)));
  std::copy(means.values.begin(), means.values.end(), out.begin());
  return absl::OkStatus();
}

Status SeparableSource::ReadDetail(int level, const Box3& window, std::span<float> out) {
  const Box3 children_box{{2 * window.lo.x, 2 * window.lo.y, 2 * window.lo.z},
                          {2 * window.hi.x, 2 * window.hi.y, 2 * window.hi.z}};
  const Grid children = MeansOf(level + 1, children_box);
  const auto count = static_cast<size_t>(window.Volume());
  size_t at = 0;
  for (int64_t z = window.lo.z; z < window.hi.z; ++z) {
    for (int64_t y = window.lo.y; y < window.hi.y; ++y) {
      for (int64_t x = window.lo.x; x < window.hi.x; ++x, ++at) {
        float child[8];
        for (int c = 0; c < 8; ++c) {
          child[c] = children.At(2 * x + (c & 1), 2 * y + (c >> 1 & 1), 2 * z + (c >> 2)) / 8;
        }
        // Haar along x, y, z: sums where a sub-band's bit is 0, differences where it is 1.
        for (int step = 1; step < 8; step *= 2) {
          for (int c = 0; c < 8; ++c) {
            if ((c & step) == 0) {
              const float sum = child[c] + child[c + step];
              child[c + step] = child[c] - child[c + step];
              child[c] = sum;
            }
          }
        }
        for (size_t band = 1; band < 8; ++band) {
          out[(band - 1) * count + at] = child[band];
        }
      }
    }
  }
  return absl::OkStatus();
}

StatusOr<SeparableSource> MakeScaleFreeSource(int64_t n, const Vec3& fovea) {
  FOVEA_ASSIGN_OR_RETURN(const Hierarchy hierarchy, Hierarchy::Make({n, n, n}));
  constexpr int kBlobsPerScale = 8;
  std::mt19937 random(1);
  const auto uniform = [&random] {  // the same on every machine, which std's distribution is not
    return static_cast<double>(random()) / 2147483648.0 - 1;
  };
  std::vector<SeparableSource::Blob> blobs;
  for (double sigma = static_cast<double>(n) / 16; sigma >= 2; sigma /= 2) {
    for (int i = 0; i < kBlobsPerScale; ++i) {
      SeparableSource::Blob blob{fovea, sigma, 0.7 + 0.3 * uniform()};
      for (int axis = 0; axis < 3; ++axis) {
        blob.center[axis] += 5 * sigma * uniform();
      }
      blobs.push_back(blob);
    }
  }
  return SeparableSource(hierarchy, std::move(blobs));
}

render::RenderSettings ScaleFreeSettings(int64_t n, double degrees, int threads) {
  // A ray through a blob passes about n/6 voxels: 30 / n a voxel lets most of them through.
  const auto most = static_cast<float>(30.0 / static_cast<double>(n));
  return SettingsFor({n, n, n}, degrees,
                     {{{0.05, {0.30F, 0.08F, 0.03F}, 0},
                       {0.4, {0.85F, 0.45F, 0.15F}, most / 2},
                       {1.0, {1.0F, 0.95F, 0.85F}, most}}},
                     threads);
}

}  // namespace fovea::bench
