// The ordering rule of thick rays in perspective, on the geometry alone.
#include <algorithm>
#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "engine/render/perspective_slices.h"
#include "engine/render/perspective_view.h"
#include "engine/volume/hierarchy.h"

namespace fovea::render {
namespace {

/// A part of the depth beyond the eye, away from it.
struct Span {
  double begin = 0, end = 0;
};

/// What a leaf pixel's ray meets, in the order in which Combine composites it.
struct Met {
  std::vector<Span> front, back;  // back: of this level and coarser, nearest first
};

Span SpanOf(const PerspectiveSlice& slice, const PerspectiveFace& face, double width) {
  const double at = std::abs(slice.z - face.eye[face.axis_k]);
  const double half = slice.thickness * width / 2;
  return {at - half, at + half};
}

Side SideAt(const PerspectiveSlice& slice, int64_t u, int64_t v) {
  for (const SideRun& run : RunsOfRow(slice, v)) {
    if (u >= run.begin && u < run.end) {
      return run.side;
    }
  }
  ADD_FAILURE() << "pixel " << u << "," << v << " of a slice has no side";
  return Side::kFront;
}

/// Follows the voxel-wide pixel (u, v) down the levels.
Met Follow(const std::vector<PerspectiveLevel>& levels, const PerspectiveFace& face, int finest,
           int64_t u, int64_t v) {
  Met met;
  for (const PerspectiveLevel& level : levels) {
    const int shift = finest - level.plan.level;
    const int64_t lu = u >> shift;
    const int64_t lv = v >> shift;
    std::vector<Span> back;
    bool split = false;
    for (const PerspectiveSlice& slice : level.slices) {
      if (!slice.owned.Contains(lu, lv)) {
        continue;
      }
      const Side side = SideAt(slice, lu, lv);
      split = split || side == Side::kChild;
      if (side != Side::kChild) {
        (side == Side::kFront ? met.front : back)
            .push_back(SpanOf(slice, face, static_cast<double>(level.plan.width)));
      }
    }
    met.back.insert(met.back.begin(), back.begin(), back.end());
    if (!split) {
      break;
    }
  }
  return met;
}

/// Whether the spans follow one another from the volume's near end to its far end.
bool MeetsAllInOrder(const Met& met, const PerspectiveFace& face) {
  std::vector<Span> spans = met.front;
  spans.insert(spans.end(), met.back.begin(), met.back.end());
  double at = face.near;
  for (const Span& span : spans) {
    if (std::abs(span.begin - at) > 1e-5) {
      return false;
    }
    at = span.end;
  }
  return std::abs(at - face.far) <= 1e-5;
}

struct Scene {
  Int3 dims;
  RetainedSet retained;
  Pinhole pinhole;
};

/// Where the eye is put: far out, in the volume, in the fovea's window, on a voxel boundary.
Vec3 RandomEye(std::mt19937* random, const Int3& dims, const Fovea& fovea, int kind) {
  Vec3 eye;
  for (int axis = 0; axis < 3; ++axis) {
    const auto size = static_cast<double>(dims[axis]);
    const auto between = [&](double lo, double hi) {
      return std::uniform_real_distribution<>(lo, hi)(*random);
    };
    switch (kind) {
      case 0:
        eye[axis] = between(-2 * size, 3 * size);
        break;
      case 1:
        eye[axis] = between(0, size);
        break;
      case 2:
        eye[axis] = std::clamp(fovea.at[axis] + between(-0.5, 0.5) * fovea.rate.x, 0.0, size);
        break;
      default:
        eye[axis] = std::floor(between(-0.5 * size, 1.5 * size));
        break;
    }
  }
  return eye;
}

Scene RandomScene(std::mt19937* random, int kind) {
  const auto between = [&](double lo, double hi) {
    return std::uniform_real_distribution<>(lo, hi)(*random);
  };
  Scene scene;
  Fovea fovea{{}, between(1, 30)};
  for (int axis = 0; axis < 3; ++axis) {
    scene.dims[axis] = static_cast<int64_t>(between(9, 150));
    fovea.at[axis] = between(0, static_cast<double>(scene.dims[axis]));
  }
  scene.retained = RetainedSet::Make(Hierarchy::Make(scene.dims).value(), fovea).value();
  PerspectiveView view;
  view.eye_voxels = RandomEye(random, scene.dims, fovea, kind);
  view.target_voxels = {between(0, 150), between(0, 150), between(0, 150)};
  view.fov_y_deg = between(20, 130);
  scene.pinhole = MakePinhole(view, Matrix4{}, 64, 48);
  return scene;
}

class PerspectiveOrderTest : public ::testing::TestWithParam<int> {};

TEST_P(PerspectiveOrderTest, EveryRayMeetsEverySliceOnceInOrder) {
  std::mt19937 random(100 + GetParam());
  int64_t rays = 0;
  int64_t split = 0;
  int64_t errors = 0;
  for (int trial = 0; trial < 1000; ++trial) {
    const Scene scene = RandomScene(&random, GetParam());
    const Fovea& fovea = scene.retained.fovea();
    for (const auto& face : MakeFaces(scene.pinhole, Matrix4{}, scene.dims, fovea.at)) {
      const auto levels =
          face ? PlanLevels(scene.retained, *face) : std::vector<PerspectiveLevel>{};
      if (levels.empty()) {
        continue;
      }
      const Rect rect = levels.front().plan.rect;
      const int64_t width = levels.front().plan.width;
      for (int i = 0; i < 12; ++i) {
        const auto pick = [&](int64_t lo, int64_t hi) {
          return std::uniform_int_distribution<int64_t>(lo * width, hi * width - 1)(random);
        };
        const int64_t u = pick(rect.u0, rect.u1);
        const int64_t v = pick(rect.v0, rect.v1);
        const int finest = scene.retained.hierarchy().finest();
        const Met met = Follow(levels, *face, finest, u, v);
        ++rays;
        split += met.back.empty() ? 0 : 1;
        errors += MeetsAllInOrder(met, *face) ? 0 : 1;
      }
    }
  }
  EXPECT_GT(rays, 10000);
  EXPECT_GT(split, 1000);
  EXPECT_EQ(errors, 0) << "of " << rays;
}

std::string NameOf(const ::testing::TestParamInfo<int>& eye) {
  const char* const names[] = {"Anywhere", "InsideTheVolume", "InsideTheWindow", "OnBoundaries"};
  return names[eye.param];
}
INSTANTIATE_TEST_SUITE_P(Eyes, PerspectiveOrderTest, ::testing::Range(0, 4), NameOf);

}  // namespace
}  // namespace fovea::render
