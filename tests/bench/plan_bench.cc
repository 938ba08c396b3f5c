// The constants of render::CostModel, measured:
//   plan_bench DS.zarr [--rounds R]
// Renders step 0 of a store at several rates, foveas, views and sizes on one thread, with a
// transfer function under which nothing is skipped; fits each phase to its counts by least squares,
// without negative constants; prints them, and how far predictions are from what was measured.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

#include "engine/base/stopwatch.h"
#include "engine/fovea/reconstruct.h"
#include "engine/render/plan.h"
#include "engine/render/renderer.h"
#include "engine/store/dataset.h"

namespace fovea {
namespace {

struct Measured {
  double chunks = 0, bytes = 0;
  render::FrameCounts counts;
  double read_ms = 0, reconstruct_ms = 0, render_ms = 0, smooth_warp_ms = 0;
};

template <typename T>
T ValueOf(StatusOr<T> value) {
  if (!value.ok()) {
    std::fprintf(stderr, "plan_bench: %s\n", std::string(MessageOf(value.status())).c_str());
    std::exit(1);
  }
  return std::move(value).value();
}

double Median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

double Least(const std::vector<double>& values) {
  return *std::min_element(values.begin(), values.end());
}

/// One frame, `rounds` times, each from a step opened anew; the fastest of each phase, for the
/// machine may be shared.
Measured Measure(store::Dataset& dataset, const Fovea& fovea,
                 const render::RenderSettings& settings, int rounds) {
  const store::DatasetInfo info = dataset.info();
  const RetainedSet retained = ValueOf(RetainedSet::Make(info.hierarchy, fovea));
  Measured result;
  std::array<std::vector<double>, 4> times;
  for (int round = 0; round < rounds; ++round) {
    const auto source = ValueOf(dataset.OpenStep(0, info.default_field, store::OnDamage::kFail));
    ReconstructStats reconstructed;
    const SuperVoxels volume = ValueOf(Reconstruct(*source, retained, 1, &reconstructed));
    render::RenderStats rendered;
    ValueOf(render::RenderFoveated(volume, info.index_to_world, settings, &rendered));
    const store::ReadStats read = source->read_stats();
    result.chunks = static_cast<double>(read.chunks_read);
    result.bytes = static_cast<double>(read.bytes_read);
    times[0].push_back(reconstructed.read_ms);
    times[1].push_back(reconstructed.reconstruct_ms);
    times[2].push_back(rendered.render_ms);
    times[3].push_back(rendered.smooth_warp_ms);
  }
  const render::ShearView view =
      render::FactorView(settings.view, info.hierarchy.dims(), info.index_to_world,
                         settings.width_px, settings.height_px);
  result.counts = render::CountFrame(retained, view, settings.width_px, settings.height_px);
  result.read_ms = Least(times[0]);
  result.reconstruct_ms = Least(times[1]);
  result.render_ms = Least(times[2]);
  result.smooth_warp_ms = Least(times[3]);
  return result;
}

/// a, b >= 0 that bring a x + b y closest to ms, relative to ms; in nanoseconds.
std::array<double, 2> Fit(const std::vector<std::array<double, 3>>& rows) {
  double xx = 0, xy = 0, yy = 0, x1 = 0, y1 = 0;
  for (const auto& [x, y, ms] : rows) {
    const double u = x / ms;
    const double v = y / ms;
    xx += u * u;
    xy += u * v;
    yy += v * v;
    x1 += u;
    y1 += v;
  }
  const double determinant = xx * yy - xy * xy;
  double a = determinant > 0 ? (x1 * yy - y1 * xy) / determinant : -1;
  double b = determinant > 0 ? (y1 * xx - x1 * xy) / determinant : -1;
  if (a < 0 && yy > 0) {
    a = 0;
    b = y1 / yy;
  } else if (b < 0) {
    a = x1 / xx;
    b = 0;
  }
  return {1e6 * a, 1e6 * b};
}

std::vector<Measured> MeasureAll(store::Dataset& dataset, int rounds) {
  const store::DatasetInfo info = dataset.info();
  const Int3& dims = info.hierarchy.dims();
  const FieldStats stats = ValueOf(dataset.Stats(0, info.default_field));
  render::RenderSettings settings;
  settings.transfer = {
      {{stats.minimum, {0.2F, 0.4F, 0.6F}, 1e-4F}, {stats.maximum + 1, {1, 1, 1}, 2e-4F}}};
  settings.threads = 1;
  std::vector<Measured> all;
  for (const double rate : {16.0, 25.0, 40.0, 64.0}) {
    for (const double place : {0.5, 0.25}) {
      const Fovea fovea{{place * static_cast<double>(dims.x), place * static_cast<double>(dims.y),
                         place * static_cast<double>(dims.z)},
                        rate};
      for (const auto& [azimuth, elevation] : {std::pair(0.0, 60.0), {60.0, 20.0}, {20.0, 10.0}}) {
        settings.view.azimuth_deg = azimuth;
        settings.view.elevation_deg = elevation;
        settings.width_px = settings.height_px = place == 0.5 ? 256 : 768;
        all.push_back(Measure(dataset, fovea, settings, rounds));
      }
    }
  }
  return all;
}

render::CostModel FitModel(const std::vector<Measured>& all) {
  std::vector<std::array<double, 3>> read, reconstruct, render, warp;
  for (const Measured& one : all) {
    const auto number = [](int64_t count) { return static_cast<double>(count); };
    read.push_back({one.chunks, one.bytes, one.read_ms});
    reconstruct.push_back({number(one.counts.super_voxels), 0, one.reconstruct_ms});
    render.push_back(
        {number(one.counts.samples), number(one.counts.accumulator_pixels), one.render_ms});
    warp.push_back({number(one.counts.picture_pixels), number(one.counts.accumulator_pixels),
                    one.smooth_warp_ms});
  }
  render::CostModel model;
  const auto per_read = Fit(read);
  const auto per_ray = Fit(render);
  const auto per_pixel = Fit(warp);
  model.us_per_chunk = per_read[0] / 1e3;
  model.ns_per_byte = per_read[1];
  model.ns_per_super_voxel = Fit(reconstruct)[0];
  model.ns_per_sample = per_ray[0];
  model.ns_per_accumulator_pixel = per_ray[1];
  model.ns_per_picture_pixel = per_pixel[0];
  model.ns_per_smoothed_pixel = per_pixel[1];
  return model;
}

void Run(const std::string& path, int rounds) {
  const auto dataset = ValueOf(store::Dataset::Open(path));
  const std::vector<Measured> all = MeasureAll(*dataset, rounds);
  const render::CostModel model = FitModel(all);
  std::printf(
      "us_per_chunk %.3g, ns_per_byte %.3g, ns_per_super_voxel %.3g, ns_per_sample %.3g,\n"
      "ns_per_accumulator_pixel %.3g, ns_per_picture_pixel %.3g, ns_per_smoothed_pixel %.3g\n",
      model.us_per_chunk, model.ns_per_byte, model.ns_per_super_voxel, model.ns_per_sample,
      model.ns_per_accumulator_pixel, model.ns_per_picture_pixel, model.ns_per_smoothed_pixel);
  std::vector<double> fitted, standing;
  for (const Measured& one : all) {
    const double ms = one.read_ms + one.reconstruct_ms + one.render_ms + one.smooth_warp_ms;
    const auto off = [&](const render::CostModel& with) {
      const double predicted = render::PredictTime(one.counts, static_cast<uint64_t>(one.chunks),
                                                   static_cast<uint64_t>(one.bytes), 1, with)
                                   .Total();
      return std::max(predicted / ms, ms / predicted);
    };
    fitted.push_back(off(model));
    standing.push_back(off({}));
  }
  std::printf(
      "predicted and measured milliseconds differ by a factor of (median, most): %.2f, %.2f "
      "with these; %.2f, %.2f with those in plan.h\n",
      Median(fitted), *std::max_element(fitted.begin(), fitted.end()), Median(standing),
      *std::max_element(standing.begin(), standing.end()));
}

}  // namespace
}  // namespace fovea

int main(int argc, char** argv) {
  int rounds = 5;
  if (argc >= 4 && std::strcmp(argv[2], "--rounds") == 0) {
    rounds = std::atoi(argv[3]);
  }
  if (argc < 2 || rounds < 1) {
    std::fprintf(stderr, "usage: plan_bench DS.zarr [--rounds R]\n");
    return 2;
  }
  fovea::Run(argv[1], rounds);
  return 0;
}
