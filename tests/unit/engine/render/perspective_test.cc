// The identities of the method in perspective: full resolution when everything is kept, a uniform
// volume that stays uniform, brute force where rays can be followed, and orthographic views far
// off.
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <random>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "engine/fovea/coefficient_source.h"
#include "engine/fovea/reconstruct.h"
#include "engine/render/renderer.h"
#include "tests/support/pictures.h"
#include "tests/support/status_matchers.h"
#include "tests/support/volumes.h"

namespace fovea::render {
namespace {

using testing::Colorful;
using testing::FailsWith;
using testing::LargestDifference;
using testing::LargestValue;
using testing::MakeCoefficients;
using testing::MakeGrid;
using testing::MakeSuperVoxels;
using testing::MakeWavyGrid;
using testing::Oblique;
constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

double Psnr(const Image& a, const Image& b) {
  double sum = 0;
  for (size_t i = 0; i < a.rgba.size(); ++i) {
    sum += (a.rgba[i] - b.rgba[i]) * (a.rgba[i] - b.rgba[i]);
  }
  return -10 * std::log10(sum / static_cast<double>(a.rgba.size()));
}

Vec3 RandomPoint(std::mt19937* random, const Int3& dims, double lo, double hi) {
  Vec3 point;
  for (int axis = 0; axis < 3; ++axis) {
    point[axis] =
        std::uniform_real_distribution<>(lo, hi)(*random) * static_cast<double>(dims[axis]);
  }
  return point;
}

TEST(PerspectiveTest, EverythingKeptEqualsFullResolutionFromOutsideAndInside) {
  const Int3 dims{45, 37, 51};
  const Grid volume = MakeWavyGrid(dims);
  const CoefficientSet set = MakeCoefficients(volume);
  const Vec3 fovea{20, 20, 20};
  const SuperVoxels everything = MakeSuperVoxels(set, {fovea, 51});
  std::mt19937 random(11);
  for (int trial = 0; trial < 24; ++trial) {
    RenderSettings settings;
    PerspectiveView& view = settings.perspective.emplace();
    view.eye_voxels =
        trial % 2 == 0 ? RandomPoint(&random, dims, 0, 1) : RandomPoint(&random, dims, -2, 3);
    view.target_voxels = RandomPoint(&random, dims, 0.3, 0.7);
    view.fov_y_deg = std::uniform_real_distribution<>(10, 140)(random);
    settings.transfer = Colorful();
    settings.width_px = 90;
    settings.height_px = 70;
    settings.weighting.kind = static_cast<Weighting::Kind>(trial % 3);
    settings.weighting.falloff_per_voxel = 0.1;
    const Matrix4 matrix = trial % 4 < 2 ? Matrix4{} : Oblique();
    ASSERT_OK_AND_ASSIGN(const Image expected, RenderReference(volume, matrix, fovea, settings));
    EXPECT_GT(LargestValue(expected), 0.3);
    for (const Smoothing smoothing : {Smoothing::kNone, Smoothing::kImage, Smoothing::kFull}) {
      settings.smoothing = smoothing;
      ASSERT_OK_AND_ASSIGN(const Image image, RenderFoveated(everything, matrix, settings));
      EXPECT_LT(LargestDifference(image, expected), 1e-5)
          << "trial " << trial << " smoothing " << static_cast<int>(smoothing);
    }
  }
}

/// Where a ray is inside the box [0, dims], in lengths of `ray` from the eye; and whether it keeps
/// `margin` voxels from every edge of the faces it passes.
struct Crossing {
  double enter = 0, leave = 0;
  bool well_inside = false;
};

std::optional<Crossing> Cross(const Vec3& eye, const Vec3& ray, const Int3& dims, double margin) {
  Crossing crossing{0, 1e30, true};
  for (int axis = 0; axis < 3; ++axis) {
    const double a = -eye[axis] / ray[axis];
    const double b = (static_cast<double>(dims[axis]) - eye[axis]) / ray[axis];
    crossing.enter = std::max(crossing.enter, std::min(a, b));
    crossing.leave = std::min(crossing.leave, std::max(a, b));
  }
  if (!(crossing.enter < crossing.leave)) {
    return std::nullopt;
  }
  // It must enter and leave through the faces across its main axis, far from their edges.
  int main = 0;
  for (int axis = 1; axis < 3; ++axis) {
    main = std::abs(ray[axis]) > std::abs(ray[main]) ? axis : main;
  }
  for (const double t : {crossing.enter, crossing.leave}) {
    for (int axis = 0; axis < 3; ++axis) {
      const double place = eye[axis] + t * ray[axis];
      const auto size = static_cast<double>(dims[axis]);
      crossing.well_inside =
          crossing.well_inside && (axis == main || (place > margin && place < size - margin));
    }
  }
  return crossing;
}

TEST(PerspectiveTest, UniformVolumeStaysUniform) {
  constexpr double kOpacity = 0.02;
  const Int3 dims{150, 141, 133};
  const CoefficientSet set = MakeCoefficients(Grid(Box3::OfSize(dims), 0.5F));
  const auto coarsest = static_cast<double>(set.hierarchy.WidthAt(0));
  std::mt19937 random(5);
  for (int trial = 0; trial < 10; ++trial) {
    const bool inside = trial % 2 == 0;
    const Matrix4 matrix = trial % 4 < 2 ? Matrix4{} : Oblique();
    RenderSettings settings;
    PerspectiveView& view = settings.perspective.emplace();
    view.eye_voxels = RandomPoint(&random, dims, 0.3, 0.7);
    view.target_voxels = RandomPoint(&random, dims, 0.4, 0.6);
    if (!inside) {
      view.eye_voxels[trial % 3] = trial % 4 == 1 ? -150 : 320;
    }
    view.fov_y_deg = inside ? 110 : 34;
    settings.width_px = settings.height_px = 90;
    settings.transfer = {{{0.5, {0.2F, 0.6F, 1.0F}, static_cast<float>(kOpacity)}}};
    const Pinhole pinhole = MakePinhole(view, matrix, 90, 90);
    const double spacing = matrix.SmallestSpacing();
    std::vector<std::pair<size_t, double>> expected;  // pixel, alpha
    for (int p = 0; p < 90 * 90; ++p) {
      const Vec3 ray = pinhole.Ray(p % 90, p / 90);
      const auto crossing = Cross(pinhole.eye, ray, dims, 2.5 * coarsest);
      if (crossing && crossing->well_inside) {
        const double path =
            (crossing->leave - crossing->enter) * Length(matrix.TransformDirection(ray)) / spacing;
        expected.emplace_back(p, 1 - std::pow(1 - kOpacity, path));
      }
    }
    ASSERT_GE(expected.size(), 500U) << "trial " << trial;
    for (const double rate : {2.0, 9.0, 24.0}) {
      const SuperVoxels volume = MakeSuperVoxels(set, {RandomPoint(&random, dims, 0, 1), rate});
      for (const Smoothing smoothing : {Smoothing::kNone, Smoothing::kImage, Smoothing::kFull}) {
        settings.smoothing = smoothing;
        ASSERT_OK_AND_ASSIGN(const Image image, RenderFoveated(volume, matrix, settings));
        double worst = 0;
        for (const auto& [pixel, alpha] : expected) {
          const float* p = &image.rgba[4 * pixel];
          worst = std::max({worst, std::abs(p[3] - alpha), std::abs(p[0] - 0.2 * alpha),
                            std::abs(p[2] - alpha)});
        }
        EXPECT_LT(worst, 1e-4) << "trial " << trial << " rate " << rate << " smoothing "
                               << static_cast<int>(smoothing);
      }
    }
  }
}

/// The value of voxel slice k at (u, v) in voxel coordinates, bilinear, the border repeated.
double SliceValue(const Grid& volume, int axis_k, double u, double v, int64_t k) {
  const int axis_u = axis_k == 0 ? 1 : 0;
  const int axis_v = axis_k == 2 ? 1 : 2;
  const double floor_u = std::floor(u - 0.5);
  const double floor_v = std::floor(v - 0.5);
  double sum = 0;
  for (int tap = 0; tap < 4; ++tap) {
    Int3 at;
    at[axis_k] = k;
    at[axis_u] = static_cast<int64_t>(floor_u) + (tap & 1);
    at[axis_v] = static_cast<int64_t>(floor_v) + (tap >> 1);
    const Int3 size = volume.box.Size();
    for (int axis = 0; axis < 3; ++axis) {
      at[axis] = std::clamp<int64_t>(at[axis], 0, size[axis] - 1);
    }
    const double share_u = (tap & 1) != 0 ? u - 0.5 - floor_u : 1 - (u - 0.5 - floor_u);
    const double share_v = (tap >> 1) != 0 ? v - 0.5 - floor_v : 1 - (v - 0.5 - floor_v);
    sum += share_u * share_v * volume.At(at.x, at.y, at.z);
  }
  return sum;
}

/// Equation (3) for one ray from its definition, in double: every voxel slab beyond the eye,
/// sampled in the middle of its part beyond. `weight(position, ray, length)` gives D's share of the
/// slab's path (chop) and its factor on opacity (falloff). Returns red and the cover.
template <typename Weight>
std::array<double, 2> BruteForceRay(const Grid& volume, const TransferFunction& transfer,
                                    const Vec3& eye, const Vec3& ray, const Weight& weight) {
  const Int3 dims = volume.box.Size();
  const int axis = FaceOf(ray) / 2;
  const bool up = FaceOf(ray) % 2 == 0;
  const int axis_u = axis == 0 ? 1 : 0;
  const int axis_v = axis == 2 ? 1 : 2;
  double red = 0;
  double left = 1;
  for (int64_t n = 0; n < dims[axis]; ++n) {
    const int64_t k = up ? n : dims[axis] - 1 - n;
    const double lo = up ? std::max<double>(k, eye[axis]) : static_cast<double>(k);
    const double hi = up ? static_cast<double>(k + 1) : std::min<double>(k + 1, eye[axis]);
    if (hi <= lo) {
      continue;
    }
    const double along = ((lo + hi) / 2 - eye[axis]) / ray[axis];
    const Vec3 at = eye + along * ray;
    if (at[axis_u] < 0 || at[axis_u] >= static_cast<double>(dims[axis_u]) || at[axis_v] < 0 ||
        at[axis_v] >= static_cast<double>(dims[axis_v])) {
      continue;
    }
    const double value = SliceValue(volume, axis, at[axis_u], at[axis_v], k);
    size_t i = 0;
    while (i + 2 < transfer.points.size() && value > transfer.points[i + 1].value) {
      ++i;
    }
    const auto& p = transfer.points[i];
    const auto& q = transfer.points[i + 1];
    const double f = std::clamp((value - p.value) / (q.value - p.value), 0.0, 1.0);
    const double length = (hi - lo) * Length(ray) / std::abs(ray[axis]);
    const auto [kept, factor] = weight(at, ray, length);
    const double alpha = 1 - std::pow(1 - factor * (p.opacity + f * (q.opacity - p.opacity)), kept);
    red += left * alpha * (p.color.red + f * (q.color.red - p.color.red));
    left *= 1 - alpha;
  }
  return {red, 1 - left};
}

/// A picture of which every pixel is the ray of one voxel-wide pixel of the face across x: it looks
/// along x with pixels as wide as the reference plane's.
RenderSettings AlongX(const Vec3& eye, const Vec3& fovea, const Int3& dims) {
  const double sign = eye.x < 30 ? 1 : -1;
  const double far = sign > 0 ? static_cast<double>(dims.x) - eye.x : eye.x;
  const double reach = std::max(std::abs(fovea.x - eye.x), far / 2);
  const int size = 2 * static_cast<int>(reach / 2);
  RenderSettings settings;
  settings.perspective = PerspectiveView{
      eye, eye + Vec3{sign, 0, 0}, {}, 2 * std::atan(size / 2.0 / reach) * 180 / std::numbers::pi};
  settings.width_px = settings.height_px = size;
  settings.smoothing = Smoothing::kNone;
  settings.transfer = Colorful();
  return settings;
}

/// The largest difference of red and cover from the definition.
template <typename Weight>
double WorstAgainstDefinition(const Image& image, const Grid& volume,
                              const RenderSettings& settings, const Weight& weight) {
  const int size = settings.width_px;
  const Pinhole pinhole = MakePinhole(*settings.perspective, Matrix4{}, size, size);
  double worst = 0;
  double most = 0;
  for (int p = 0; p < size * size; ++p) {
    const auto expected = BruteForceRay(volume, settings.transfer, pinhole.eye,
                                        pinhole.Ray(p % size, p / size), weight);
    worst = std::max({worst, std::abs(expected[0] - image.rgba[4 * p]),
                      std::abs(expected[1] - image.rgba[4 * p + 3])});
    most = std::max(most, expected[1]);
  }
  EXPECT_GT(most, 0.3);
  return worst;
}

constexpr std::array<Vec3, 3> kEyes = {Vec3{-20, 21, 18}, Vec3{61.5, 15, 20}, Vec3{3.3, 22, 10}};

TEST(PerspectiveTest, EveryRayIsTheDefinitionsFromOutsideAndInside) {
  const Int3 dims{40, 44, 36};
  const Grid volume = MakeWavyGrid(dims);
  const Vec3 fovea{22, 20.5, 17};
  const SuperVoxels everything = MakeSuperVoxels(MakeCoefficients(volume), {fovea, 44});
  for (const Vec3& eye : kEyes) {
    for (int kind = 0; kind < 3; ++kind) {
      RenderSettings settings = AlongX(eye, fovea, dims);
      settings.weighting.kind = static_cast<Weighting::Kind>(kind);
      settings.weighting.falloff_per_voxel = 0.1;
      const auto weight = [&](const Vec3& at, const Vec3& ray, double length) {
        const double beyond = Dot(at - fovea, ray) / Length(ray);
        return std::pair(kind == 1 ? std::clamp(beyond + length / 2, 0.0, length) : length,
                         kind == 2 ? 1 / (1 + 0.1 * Length(at - fovea)) : 1.0);
      };
      ASSERT_OK_AND_ASSIGN(const Image image, RenderFoveated(everything, Matrix4{}, settings));
      EXPECT_LT(WorstAgainstDefinition(image, volume, settings, weight), 1e-5)
          << "eye x " << eye.x << " weighting " << kind;
    }
  }
}

TEST(PerspectiveTest, ABoxAndAPlaneCutEachRayWhereItMeetsThem) {
  const Int3 dims{40, 44, 36};
  const Grid volume = MakeWavyGrid(dims);
  const Vec3 fovea{22, 20.5, 17};
  const SuperVoxels everything = MakeSuperVoxels(MakeCoefficients(volume), {fovea, 44});
  const Vec3 low{5.3, 6, 4.7};
  const Vec3 high{33.5, 40, 30.2};
  const Vec3 normal{1, 0.8, -0.3};
  for (const Vec3& eye : kEyes) {
    RenderSettings settings = AlongX(eye, fovea, dims);
    settings.clip.box = {low, high};
    settings.clip.planes = {{normal, 25}};
    const auto weight = [&](const Vec3& at, const Vec3& ray, double length) {
      const Vec3 sight = (1 / Length(ray)) * ray;
      double near = -length / 2;
      double far = length / 2;
      const auto keep = [&](const Vec3& n, double offset) {
        const double here = Dot(n, at) - offset;
        const double along = Dot(n, sight);
        near = along > 0 ? std::max(near, -here / along) : near;
        far = along < 0 ? std::min(far, -here / along) : far;
        far = along == 0 && here < 0 ? near : far;
      };
      for (int axis = 0; axis < 3; ++axis) {
        Vec3 n;
        n[axis] = 1;
        keep(n, low[axis]);
        keep(-1 * n, -high[axis]);
      }
      keep(normal, 25);
      return std::pair(std::max(far - near, 0.0), 1.0);
    };
    ASSERT_OK_AND_ASSIGN(const Image image, RenderFoveated(everything, Matrix4{}, settings));
    EXPECT_LT(WorstAgainstDefinition(image, volume, settings, weight), 1e-5) << "eye x " << eye.x;
  }
}

TEST(PerspectiveTest, ASecondFieldGivesTheColour) {
  const Int3 dims{40, 44, 36};
  const Grid volume = MakeWavyGrid(dims);
  const Grid paint = MakeGrid(dims, [](double x, double y, double) { return x + y; });
  const Fovea fovea{{22, 20.5, 17}, 44};
  const SuperVoxels everything = MakeSuperVoxels(MakeCoefficients(volume), fovea);
  const SuperVoxels colors = MakeSuperVoxels(MakeCoefficients(paint), fovea);
  RenderSettings settings;
  settings.perspective = PerspectiveView{{-10, 15, 60}, {20, 22, 18}, {}, 60};
  settings.width_px = settings.height_px = 60;
  settings.transfer = Colorful();
  settings.color_transfer = {{{0, {1, 0, 0}, 0}, {84, {0, 0, 1}, 0}}};
  ASSERT_OK_AND_ASSIGN(const Image image,
                       RenderFoveated(everything, Matrix4{}, settings, nullptr, &colors));
  ASSERT_OK_AND_ASSIGN(const Image full,
                       RenderReference(volume, Matrix4{}, fovea.at, settings, nullptr, &paint));
  EXPECT_LT(LargestDifference(image, full), 1e-5);
  ASSERT_OK_AND_ASSIGN(const Image own, RenderFoveated(everything, Matrix4{}, settings));
  double cover = 0;
  double green = 0;
  for (size_t i = 0; i < image.rgba.size(); i += 4) {
    cover = std::max(cover, static_cast<double>(std::abs(image.rgba[i + 3] - own.rgba[i + 3])));
    green = std::max(green, static_cast<double>(image.rgba[i + 1]));
  }
  EXPECT_EQ(cover, 0);
  EXPECT_EQ(green, 0);
  settings.lighting.enabled = true;
  EXPECT_THAT(RenderFoveated(everything, Matrix4{}, settings),
              FailsWith(kInvalid, "lighting is for orthographic views only"));
}

TEST(PerspectiveTest, AHigherRateComesCloserToFullResolution) {
  const Int3 dims{90, 80, 100};
  const Grid volume = MakeWavyGrid(dims);
  const CoefficientSet set = MakeCoefficients(volume);
  const Vec3 fovea{40, 35, 60};
  for (const Vec3& eye : {Vec3{-60, 100, 130}, Vec3{50, 45, 50}}) {
    RenderSettings settings;
    settings.perspective = PerspectiveView{eye, fovea, {}, 80};
    settings.width_px = settings.height_px = 120;
    settings.transfer = Colorful();
    ASSERT_OK_AND_ASSIGN(const Image full, RenderReference(volume, Matrix4{}, fovea, settings));
    double last = 20;
    for (const double rate : {3.0, 6.0, 12.0, 100.0}) {
      ASSERT_OK_AND_ASSIGN(const Image image, RenderFoveated(MakeSuperVoxels(set, {fovea, rate}),
                                                             Matrix4{}, settings));
      const double psnr = Psnr(image, full);
      EXPECT_GT(psnr, last) << "rate " << rate << " eye x " << eye.x;
      last = psnr;
    }
    EXPECT_GT(last, 100);
  }
}

TEST(PerspectiveTest, ThePictureDoesNotDependOnThreads) {
  const CoefficientSet set = MakeCoefficients(MakeWavyGrid({70, 61, 80}));
  const SuperVoxels volume = MakeSuperVoxels(set, {{30, 30, 40}, 12});
  RenderSettings settings;
  settings.perspective = PerspectiveView{{20, 30, 35}, {50, 40, 30}, {}, 130};
  settings.transfer = Colorful();
  settings.width_px = settings.height_px = 200;
  settings.threads = 1;
  ASSERT_OK_AND_ASSIGN(const Image one, RenderFoveated(volume, Matrix4{}, settings));
  for (const int threads : {2, 8}) {
    settings.threads = threads;
    ASSERT_OK_AND_ASSIGN(const Image many, RenderFoveated(volume, Matrix4{}, settings));
    EXPECT_EQ(one.rgba, many.rgba) << threads << " threads";
  }
}

TEST(PerspectiveTest, ThinVolumesAndEyesThatSeeNothing) {
  const Grid thin = MakeWavyGrid({1, 40, 30});
  RenderSettings settings;
  settings.perspective = PerspectiveView{{-20, 21, 18}, {0, 20, 15}, {}, 60};
  settings.transfer = Colorful();
  settings.width_px = settings.height_px = 40;
  const Vec3 fovea{0.5, 20, 15};
  ASSERT_OK_AND_ASSIGN(const Image full, RenderReference(thin, Matrix4{}, fovea, settings));
  const SuperVoxels volume = MakeSuperVoxels(MakeCoefficients(thin), {fovea, 40});
  ASSERT_OK_AND_ASSIGN(const Image image, RenderFoveated(volume, Matrix4{}, settings));
  EXPECT_GT(LargestValue(image), 0.01);
  EXPECT_LT(LargestDifference(image, full), 1e-5);
  settings.perspective->target_voxels = {-40, 20, 15};  // the other way
  ASSERT_OK_AND_ASSIGN(const Image nothing, RenderFoveated(volume, Matrix4{}, settings));
  EXPECT_EQ(LargestValue(nothing), 0);
}

TEST(PerspectiveViewTest, ProjectionFindsThePixelsRay) {
  const Matrix4 matrix = Oblique();
  const PerspectiveView view{{-30, 12, 80}, {20, 20, 20}, Vec3{0.1, 0.9, -0.3}, 50};
  const Pinhole pinhole = MakePinhole(view, matrix, 64, 48);
  for (const auto& [i, j] : {std::pair(0, 0), std::pair(13, 40), std::pair(63, 47)}) {
    const auto pixel = ProjectToPixel(view, matrix, 64, 48, pinhole.eye + 3.7 * pinhole.Ray(i, j));
    ASSERT_TRUE(pixel);
    EXPECT_NEAR((*pixel)[0], i + 0.5, 1e-9);
    EXPECT_NEAR((*pixel)[1], j + 0.5, 1e-9);
  }
  const auto middle = ProjectToPixel(view, matrix, 64, 48, view.target_voxels);
  EXPECT_NEAR((*middle)[0], 32, 1e-9);
  EXPECT_FALSE(ProjectToPixel(view, matrix, 64, 48, pinhole.eye - pinhole.Ray(5, 5)));
  // Up is up, and the vertical field of view is the one asked for.
  const PerspectiveView plain{{0, 0, 0}, {1, 0, 0}, {}, 90};
  const auto top = ProjectToPixel(plain, Matrix4{}, 10, 10, {1, 0, 1});
  EXPECT_NEAR((*top)[1], 0, 1e-9);
  const auto left = ProjectToPixel(plain, Matrix4{}, 10, 10, {1, 1, 0});
  EXPECT_NEAR((*left)[0], 0, 1e-9);
  const PerspectiveView down{{0, 0, 9}, {0, 0, 0}, {}, 45};
  EXPECT_OK(Validate(down, Matrix4{}));
}

TEST(PerspectiveViewTest, RefusesWhatIsOutOfRange) {
  const PerspectiveView good{{0, 0, 0}, {1, 0, 0}, {}, 45};
  const auto fails = [&](auto change, const char* message) {
    PerspectiveView view = good;
    change(&view);
    EXPECT_THAT(Validate(view, Matrix4{}), FailsWith(kInvalid, message));
  };
  EXPECT_OK(Validate(good, Matrix4{}));
  fails([](auto* v) { v->eye_voxels.y = NAN; }, "its y is outside its range");
  fails([](auto* v) { v->eye_voxels.x = 2e9; }, "eye 2000000000");
  fails([](auto* v) { v->target_voxels.z = INFINITY; }, "target 1, 0, inf: its z");
  fails([](auto* v) { v->target_voxels = v->eye_voxels; }, "target 0, 0, 0 is the eye itself");
  fails([](auto* v) { v->fov_y_deg = 0; }, "fov_y_deg 0 is outside its range, 0.01 to 170");
  fails([](auto* v) { v->fov_y_deg = 180; }, "fov_y_deg 180");
  fails([](auto* v) { v->fov_y_deg = NAN; }, "fov_y_deg nan");
  fails([](auto* v) { v->up = Vec3{2, 0, 0}; }, "up 2, 0, 0 is parallel to the direction of sight");
  fails([](auto* v) { v->up = Vec3{0, 0, 0}; }, "up 0, 0, 0");
  fails([](auto* v) { v->up = Vec3{0, NAN, 0}; }, "up 0, nan, 0");
}

/// From far away, through a narrow field, perspective is the orthographic picture. The slopes are
/// such that both sheared images have their pixels in the same places.
TEST(PerspectiveTest, AFarEyeSeesTheOrthographicPicture) {
  const Int3 dims{70, 64, 76};
  const CoefficientSet set = MakeCoefficients(MakeWavyGrid(dims));
  const SuperVoxels volume = MakeSuperVoxels(set, {{32, 32, 32}, 20});
  for (const Vec3& sight : {Vec3{1, 0, 0}, Vec3{-1, 0.25, 0.5}, Vec3{0.5, 1, -0.75},
                            Vec3{-0.25, 0.5, -1}, Vec3{0, -1, 0.25}}) {
    const double length = Length(sight);
    RenderSettings settings;
    settings.transfer = Colorful();
    settings.width_px = settings.height_px = 100;
    settings.view.azimuth_deg = std::atan2(sight.y, sight.x) * 180 / std::numbers::pi;
    settings.view.elevation_deg = std::asin(sight.z / length) * 180 / std::numbers::pi;
    settings.view.center_voxels = {35, 32, 38};
    settings.view.span_voxels = 110;
    constexpr double kFar = 2e5;
    PerspectiveView view;
    view.target_voxels = *settings.view.center_voxels;
    view.eye_voxels = view.target_voxels - (kFar / length) * sight;
    view.fov_y_deg = 2 * std::atan(55 / kFar) * 180 / std::numbers::pi;
    for (const Smoothing smoothing : {Smoothing::kNone, Smoothing::kFull}) {
      settings.smoothing = smoothing;
      settings.perspective.reset();
      ASSERT_OK_AND_ASSIGN(const Image flat, RenderFoveated(volume, Matrix4{}, settings));
      settings.perspective = view;
      ASSERT_OK_AND_ASSIGN(const Image far, RenderFoveated(volume, Matrix4{}, settings));
      EXPECT_GT(LargestValue(far), 0.5);
      EXPECT_GT(Psnr(far, flat), 45) << "sight " << sight.x << "," << sight.y << "," << sight.z
                                     << " smoothing " << static_cast<int>(smoothing);
    }
  }
}

}  // namespace
}  // namespace fovea::render
