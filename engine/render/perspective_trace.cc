#include "engine/render/perspective_trace.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <optional>
#include <utility>

#include "engine/base/parallel.h"
#include "engine/render/slice_view.h"

namespace fovea::render {
namespace {

/// Where a pixel samples on one axis of a slice: between cell `cell` and the next.
struct Tap {
  int64_t cell = 0;
  float fraction = 0;
};

/// Pixel i of a slice stands at (i + 1/2) scale + e (1 - scale), e the eye's place, cell 0's centre
/// at 1/2. Reads outside [lo, hi) cells repeat the border.
class TapLine {
 public:
  TapLine(double eye, double scale, int64_t lo, int64_t hi)
      : first_(0.5 * scale + eye * (1 - scale) - 0.5), scale_(scale), lo_(lo), hi_(hi) {}

  [[nodiscard]] Tap At(int64_t i) const {
    const double place = std::clamp(first_ + static_cast<double>(i) * scale_,
                                    static_cast<double>(lo_), static_cast<double>(hi_ - 1));
    const int64_t last = std::max(lo_, hi_ - 2);
    const int64_t cell = std::min(static_cast<int64_t>(std::floor(place)), last);
    return {cell, static_cast<float>(place - static_cast<double>(cell))};
  }

 private:
  double first_, scale_;
  int64_t lo_, hi_;
};

/// The weighting D and what is clipped away along a row of a slice, whose rays all look another
/// way. Positions and ways in world axes, in smallest spacings; all is linear along the row.
struct FannedRow {
  /// A half-space that is kept: a step s along the ray from pixel i's sample, -1 and 1 being the
  /// slab's ends, is inside where first + i * step + s * (along + i * along_step) >= 0.
  struct Side {
    double first = 0, step = 0, along = 0, along_step = 0;
  };

  bool chops = false;
  Vec3 first, step;          // the samples of pixels 0, 1, ... from the fovea
  Vec3 way_first, way_step;  // WayAt of pixels 0, 1, ...
  double depth = 0;          // of the slab along axis k, in voxels
  std::array<Side, 6 + kMostClipPlanes> sides;
  size_t side_count = 0;

  [[nodiscard]] Vec3 PlaceAt(int64_t i) const { return first + static_cast<double>(i) * step; }
  /// The part of the slab's path that nothing cuts away. Chop cuts by a plane through the fovea
  /// across each ray: Yu et al., section 4.
  [[nodiscard]] float KeptLength(int64_t i) const {
    const auto column = static_cast<double>(i);
    const Vec3 way = way_first + column * way_step;
    const double half = depth / 2 * Length(way);
    double near = -1;
    double far = 1;
    if (chops) {
      near = std::max(near, -Dot(PlaceAt(i), way) / (Length(way) * half));
    }
    for (size_t n = 0; n < side_count; ++n) {
      const double here = sides[n].first + column * sides[n].step;
      const double along = sides[n].along + column * sides[n].along_step;
      if (along > 0) {
        near = std::max(near, -here / along);
      } else if (along < 0) {
        far = std::min(far, -here / along);
      } else if (here < 0) {
        return 0;
      }
    }
    return static_cast<float>(std::max(far - near, 0.0) * half);
  }
};

/// What a thread needs for a row at a time, by column of the image.
struct Scratch {
  explicit Scratch(int64_t columns)
      : taps(static_cast<size_t>(columns)),
        values(static_cast<size_t>(columns) + 1),  // the kernel looks at the next one too
        colors(static_cast<size_t>(columns) + 1),
        opacity_scales(static_cast<size_t>(columns)),
        length_scales(static_cast<size_t>(columns)) {}
  std::vector<Tap> taps;
  std::vector<float> values, colors, opacity_scales, length_scales;
  std::vector<SlabRun> runs;
};

class FaceTracer {
 public:
  FaceTracer(const PerspectiveInputs& frame, const Grid& grid, const Grid* color,
             const ValueBlocks* blocks, const PerspectiveLevel& level, const PerspectiveFace& face,
             Layer* layer)
      : frame_(frame),
        box_(grid.box),
        live_(LiveOf(frame, blocks, grid.box, face)),
        slices_(grid, AxesOf(face), frame.settings.threads, &turned_, live_ ? &*live_ : nullptr),
        level_(level),
        face_(face),
        layer_(*layer),
        width_(static_cast<double>(layer->plan.width)) {
    if (color != nullptr) {
      color_slices_.emplace(*color, AxesOf(face), frame.settings.threads, &color_turned_,
                            live_ ? &*live_ : nullptr);
    }
  }

  /// All slices for the rows [v0, v1) of the image; returns the samples met.
  uint64_t TraceRows(int64_t v0, int64_t v1) {
    FillPaths(v0, v1);
    Scratch scratch(layer_.plan.rect.Width());
    uint64_t samples = 0;
    for (const PerspectiveSlice& slice : level_.slices) {
      const int64_t first = std::max(v0, slice.owned.v0);
      const int64_t last = std::min(v1, slice.owned.v1);
      if (first < last) {
        FillTaps(slice, &scratch.taps);
      }
      for (int64_t v = first; v < last; ++v) {
        samples += TraceRow(slice, v, &scratch);
      }
    }
    return samples;
  }

 private:
  static ShearView AxesOf(const PerspectiveFace& face) {
    ShearView view;
    view.axis_k = face.axis_k;
    view.axis_u = face.axis_u;
    view.axis_v = face.axis_v;
    return view;
  }

  static std::optional<LiveBlocks> LiveOf(const PerspectiveInputs& frame, const ValueBlocks* blocks,
                                          const Box3& box, const PerspectiveFace& face) {
    if (blocks == nullptr) {
      return std::nullopt;
    }
    return LiveBlocks(*blocks, box, frame.transparent, AxesOf(face));
  }

  void FillPaths(int64_t v0, int64_t v1) {
    const Rect& rect = layer_.plan.rect;
    for (int64_t v = v0; v < v1; ++v) {
      for (int64_t u = rect.u0; u < rect.u1; ++u) {
        layer_.path[layer_.Index(u, v)] =
            static_cast<float>(Length(WayOf(u, v)) / face_.common_path);
      }
    }
  }

  [[nodiscard]] Vec3 WayOf(int64_t u, int64_t v) const {
    return face_.WayAt((static_cast<double>(u) + 0.5) * width_,
                       (static_cast<double>(v) + 0.5) * width_);
  }

  [[nodiscard]] TapLine Line(const PerspectiveSlice& slice, int axis) const {
    return {face_.eye[axis] / width_, slice.scale, box_.lo[axis], box_.hi[axis]};
  }

  /// The columns of a slice that sample; taps[0] is the image's first column.
  void FillTaps(const PerspectiveSlice& slice, std::vector<Tap>* taps) const {
    const TapLine line = Line(slice, face_.axis_u);
    const int64_t u0 = layer_.plan.rect.u0;
    const int64_t end = std::min(slice.owned.u1, slice.in_volume.u1);
    for (int64_t u = std::max(slice.owned.u0, slice.in_volume.u0); u < end; ++u) {
      (*taps)[u - u0] = line.At(u);
    }
  }

  uint64_t TraceRow(const PerspectiveSlice& slice, int64_t v, Scratch* scratch) {
    uint64_t samples = 0;
    for (const SideRun& run : RunsOfRow(slice, v)) {
      if (run.begin >= run.end) {
        continue;
      }
      if (run.side == Side::kChild) {
        std::fill_n(&layer_.split[layer_.Index(run.begin, v)], run.end - run.begin, uint8_t{1});
      } else {
        samples += CompositeRun(slice, v, run, scratch);
      }
    }
    return samples;
  }

  uint64_t CompositeRun(const PerspectiveSlice& slice, int64_t v, const SideRun& run,
                        Scratch* scratch) {
    const int64_t u0 = layer_.plan.rect.u0;
    const int64_t begin = std::max(run.begin, slice.in_volume.u0) - u0;
    const int64_t end = std::min(run.end, slice.in_volume.u1) - u0;
    if (begin >= end || v < slice.in_volume.v0 || v >= slice.in_volume.v1) {
      return 0;
    }
    const auto row_at = static_cast<int64_t>(layer_.Index(u0, v));
    Gathered& into = run.side == Side::kBack ? layer_.back : layer_.front;
    Slab slab;
    slab.taps = scratch->values.data();
    slab.color_taps = color_slices_ ? scratch->colors.data() : nullptr;
    slab.length = static_cast<float>(width_ * slice.thickness * face_.common_path);
    slab.length_scale = layer_.path.data();
    slab.red = into.red.data();
    slab.green = into.green.data();
    slab.blue = into.blue.data();
    slab.transmittance = into.transmittance.data();
    Weigh(slice, v, begin, end, &slab, scratch, into.depth.data() + row_at);
    Gather(slice, v, begin, end, row_at, scratch);
    CompositeSlab(frame_.function, frame_.color, nullptr, slab, scratch->runs);
    return static_cast<uint64_t>(end - begin);
  }

  /// The weighting D of columns [begin, end) of a row, and the depth they gather.
  void Weigh(const PerspectiveSlice& slice, int64_t v, int64_t begin, int64_t end, Slab* slab,
             Scratch* scratch, float* depth) const {
    const Weighting& weighting = frame_.settings.weighting;
    const bool falls = weighting.kind == Weighting::Kind::kFalloff;
    const bool cuts = weighting.kind == Weighting::Kind::kChop || !frame_.settings.clip.IsEmpty();
    const auto thickness = static_cast<float>(slice.thickness);
    const auto row_at = static_cast<int64_t>(layer_.Index(layer_.plan.rect.u0, v));
    const FannedRow row = falls || cuts ? MakeFannedRow(slice, v) : FannedRow{};
    if (cuts) {
      for (int64_t i = begin; i < end; ++i) {
        scratch->length_scales[i] = row.KeptLength(i) / slab->length;
      }
      slab->length_scale = scratch->length_scales.data() - row_at;
    }
    for (int64_t i = begin; i < end; ++i) {
      depth[i] += thickness * slab->length_scale[row_at + i];
    }
    if (falls) {
      for (int64_t i = begin; i < end; ++i) {
        const double distance = Length(row.PlaceAt(i));
        scratch->opacity_scales[i] =
            static_cast<float>(1 / (1 + weighting.falloff_per_voxel * distance));
      }
      slab->opacity_scale = scratch->opacity_scales.data() - row_at;
    }
  }

  /// Pixel 0 of the row is the image's first column.
  [[nodiscard]] FannedRow MakeFannedRow(const PerspectiveSlice& slice, int64_t v) const {
    const int64_t u0 = layer_.plan.rect.u0;
    FannedRow row;
    row.chops = frame_.settings.weighting.kind == Weighting::Kind::kChop;
    row.way_first = WayOf(u0, v);
    row.way_step = WayOf(u0 + 1, v) - row.way_first;
    row.depth = width_ * slice.thickness;
    // Of pixel 0 in voxel coordinates, what is between pixels, and half the way through the slab.
    Vec3 at;
    Vec3 step;
    Vec3 half;
    const double reach = face_.reference_z - face_.eye[face_.axis_k];
    const double sign = face_.ascending ? 1 : -1;
    for (const auto& [axis, i] : {std::pair(face_.axis_u, u0), std::pair(face_.axis_v, v)}) {
      const double offset = (static_cast<double>(i) + 0.5) * width_ - face_.eye[axis];
      at[axis] = face_.eye[axis] + offset * slice.scale;
      half[axis] = sign * row.depth / 2 * offset / reach;
    }
    at[face_.axis_k] = slice.z;
    half[face_.axis_k] = sign * row.depth / 2;
    step[face_.axis_u] = width_ * slice.scale;
    Vec3 half_step;
    half_step[face_.axis_u] = sign * row.depth / 2 * width_ / reach;
    const auto to_world = [this](const Vec3& p) {
      return p[face_.axis_u] * face_.world_u + p[face_.axis_v] * face_.world_v +
             p[face_.axis_k] * face_.world_k;
    };
    row.first = to_world(at - frame_.fovea);
    row.step = to_world(step);
    const auto keep = [&](const Vec3& normal, double offset) {
      row.sides[row.side_count++] = {Dot(normal, at) - offset, Dot(normal, step), Dot(normal, half),
                                     Dot(normal, half_step)};
    };
    const Clip& clip = frame_.settings.clip;
    for (int axis = 0; clip.box && axis < 3; ++axis) {
      Vec3 normal;
      normal[axis] = 1;
      keep(normal, (*clip.box)[0][axis]);
      keep(-1 * normal, -(*clip.box)[1][axis]);
    }
    for (const ClipPlane& plane : clip.planes) {
      keep(plane.normal, plane.offset);
    }
    return row;
  }

  /// The values at columns [begin, end) of a row, and the runs of them that show anything.
  void Gather(const PerspectiveSlice& slice, int64_t v, int64_t begin, int64_t end, int64_t row_at,
              Scratch* scratch) const {
    const Tap across = Line(slice, face_.axis_v).At(v);
    // A volume one voxel thin has no next cell.
    const Int3 size = box_.Size();
    const int64_t next_u = size[face_.axis_u] > 1 ? 1 : 0;
    const int64_t next_v = size[face_.axis_v] > 1 ? 1 : 0;
    const Tap* taps = scratch->taps.data();
    const auto interpolate = [&](const SliceView& slices, int64_t first, int64_t last,
                                 float* values) {
      const float* row0 = slices.Row(across.cell, slice.k);
      const float* row1 = slices.Row(across.cell + next_v, slice.k);
      for (int64_t i = first; i < last; ++i) {
        const float* near = row0 + taps[i].cell;
        const float* far = row1 + taps[i].cell;
        const float at_near = near[0] + taps[i].fraction * (near[next_u] - near[0]);
        const float at_far = far[0] + taps[i].fraction * (far[next_u] - far[0]);
        values[i] = at_near + across.fraction * (at_far - at_near);
      }
    };
    const auto gather = [&](int64_t first, int64_t last) {
      interpolate(slices_, first, last, scratch->values.data());
      if (color_slices_) {
        interpolate(*color_slices_, first, last, scratch->colors.data());
      }
      scratch->runs.push_back({first, row_at + first, last - first});
    };
    scratch->runs.clear();
    if (!live_) {
      gather(begin, end);
      return;
    }
    const uint8_t* live = live_->Row(across.cell, slice.k);
    for (int64_t i = begin; i < end;) {
      const int64_t first = i;
      const bool shows = live[live_->BlockOf(taps[i].cell)] != 0;
      while (i < end && (live[live_->BlockOf(taps[i].cell)] != 0) == shows) {
        ++i;
      }
      if (shows) {
        gather(first, i);
      }
    }
  }

  const PerspectiveInputs& frame_;
  Box3 box_;
  std::optional<LiveBlocks> live_;
  std::vector<float> turned_, color_turned_;
  SliceView slices_;
  std::optional<SliceView> color_slices_;
  const PerspectiveLevel& level_;
  const PerspectiveFace& face_;
  Layer& layer_;
  double width_;
};

}  // namespace

Layer TraceLevel(const PerspectiveInputs& frame, const Grid& grid, const Grid* color,
                 const ValueBlocks* blocks, const PerspectiveLevel& level,
                 const PerspectiveFace& face, uint64_t* samples) {
  constexpr int64_t kRowsInBand = 16;
  Layer layer;
  layer.plan = level.plan;
  const Rect& rect = layer.plan.rect;
  const auto pixels = static_cast<size_t>(rect.Width() * rect.Height());
  layer.front.Clear(pixels);
  layer.back.Clear(pixels);
  layer.split.resize(pixels);
  layer.path.resize(pixels);
  std::atomic<uint64_t> total{0};
  FaceTracer tracer(frame, grid, color, blocks, level, face, &layer);
  ParallelFor(rect.v0, rect.v1, kRowsInBand, frame.settings.threads,
              [&](int64_t v0, int64_t v1) { total += tracer.TraceRows(v0, v1); });
  *samples += total;
  return layer;
}

std::vector<Layer> TraceThickRays(const PerspectiveInputs& frame, const SuperVoxels& volume,
                                  const SuperVoxels* color, const PerspectiveFace& face,
                                  uint64_t* samples) {
  std::vector<Layer> layers;
  for (const PerspectiveLevel& level : PlanLevels(volume.retained, face)) {
    const int l = level.plan.level;
    layers.push_back(TraceLevel(frame, volume.levels[l],
                                color != nullptr ? &color->levels[l] : nullptr, &volume.blocks[l],
                                level, face, samples));
  }
  return layers;
}

}  // namespace fovea::render
