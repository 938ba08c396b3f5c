#ifndef TESTS_SUPPORT_PICTURES_H_
#define TESTS_SUPPORT_PICTURES_H_

#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "engine/fovea/coefficient_source.h"
#include "engine/fovea/reconstruct.h"
#include "engine/render/image.h"
#include "engine/render/transfer_function.h"
#include "tests/support/volumes.h"

/// What tests of pictures share: a transfer function, a matrix, super-voxels, comparisons.
namespace fovea::testing {

/// For values 0 to 1. Points on entries of the table (4095 = 3 x 1365 steps), so that brute force
/// in double may evaluate the function itself.
inline render::TransferFunction Colorful(float opacity = 0.04F) {
  return {{{0.1, {0.1F, 0.2F, 0.9F}, 0.0F},
           {0.4, {0.9F, 0.5F, 0.1F}, opacity},
           {0.7, {0.2F, 0.9F, 0.3F}, 0.1F},
           {1.0, {1.0F, 1.0F, 1.0F}, 0.3F}}};
}

/// A rotation, an anisotropic spacing and a shift, as CT and VDB files have them.
inline Matrix4 Oblique() {
  Matrix4 matrix;
  matrix.m = {0.8, -0.45, 0.1, 3, 0.6, 0.6, 0.2, -7, 0.05, 0.1, 1.3, 11, 0, 0, 0, 1};
  return matrix;
}

inline SuperVoxels MakeSuperVoxels(const CoefficientSet& set, const Fovea& fovea) {
  MemorySource source(set);
  return Reconstruct(source, RetainedSet::Make(set.hierarchy, fovea).value(), 1).value();
}

inline double LargestDifference(const render::Image& a, const render::Image& b) {
  EXPECT_EQ(a.rgba.size(), b.rgba.size());
  double largest = 0;
  for (size_t i = 0; i < std::min(a.rgba.size(), b.rgba.size()); ++i) {
    largest = std::max(largest, static_cast<double>(std::abs(a.rgba[i] - b.rgba[i])));
  }
  return largest;
}

inline double LargestValue(const render::Image& image) {
  return *std::max_element(image.rgba.begin(), image.rgba.end());
}

}  // namespace fovea::testing

#endif  // TESTS_SUPPORT_PICTURES_H_
