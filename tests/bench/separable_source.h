#ifndef TESTS_BENCH_SEPARABLE_SOURCE_H_
#define TESTS_BENCH_SEPARABLE_SOURCE_H_

#include <span>
#include <vector>

#include "engine/fovea/coefficient_source.h"
#include "engine/render/renderer.h"

namespace fovea::bench {

/// The Haar coefficients of a sum of Gaussian blobs, worked out where they are asked for: a volume
/// of any size without n^3 anything. A voxel's value is the mean of the sum over the voxel, which
/// for a product of one-dimensional Gaussians is a product of differences of erf. Thread-safe.
class SeparableSource final : public CoefficientSource {
 public:
  struct Blob {
    Vec3 center;       // voxels
    double sigma = 1;  // voxels
    double height = 1;
  };
  SeparableSource(const Hierarchy& hierarchy, std::vector<Blob> blobs);

  [[nodiscard]] const Hierarchy& hierarchy() const override { return hierarchy_; }
  [[nodiscard]] Status ReadCoarse(std::span<float> out) override;
  [[nodiscard]] Status ReadDetail(int level, const Box3& window, std::span<float> out) override;

 private:
  /// The means over the super-voxels of `level` in `box`, x fastest.
  [[nodiscard]] Grid MeansOf(int level, const Box3& box) const;

  Hierarchy hierarchy_;
  std::vector<Blob> blobs_;
};

/// A cube of n voxels a side (a power of two from 32), with the same look at every scale around
/// `fovea`: blobs of sizes n/8 down to 2 voxels, each as far from the fovea as a few of its sizes,
/// in empty space. Values 0 to about 1.
[[nodiscard]] StatusOr<SeparableSource> MakeScaleFreeSource(int64_t n, const Vec3& fovea);

/// For it: SettingsFor with a semi-transparent transfer function, alike at every n.
[[nodiscard]] render::RenderSettings ScaleFreeSettings(int64_t n, double degrees, int threads);

}  // namespace fovea::bench

#endif  // TESTS_BENCH_SEPARABLE_SOURCE_H_
