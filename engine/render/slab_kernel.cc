#include "engine/render/slab_kernel.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/render/slab_kernel.cc"
#include <hwy/foreach_target.h>  // IWYU pragma: keep
// foreach_target.h must come first
#include <cmath>

#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace fovea::render::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using D = hn::ScalableTag<float>;
using V = hn::Vec<D>;

/// ln(1 - opacity) for opacity 0 to 1, within 2 ulp. 1 is taken as 1 - 2^-24.
HWY_INLINE V LogTransparency(V opacity) {
  const D d;
  const hn::RebindToSigned<D> di;
  constexpr float kMost = 1.0F - 1.0F / (1 << 24);
  const V one = hn::Set(d, 1.0F);
  const V a = hn::Min(opacity, hn::Set(d, kMost));
  const V u = hn::Sub(one, a);
  // u was rounded: ln(1 - a) = ln(u - lost) = ln(u) - lost / u, and where anything was lost u >
  // 1/2.
  const V lost = hn::Sub(a, hn::Sub(one, u));
  const V correction = hn::Mul(lost, hn::Sub(hn::Set(d, 2.0F), u));
  // u = 2^k m, m in [sqrt(1/2), sqrt(2)).
  const auto bits = hn::BitCast(di, u);
  const auto k = hn::ShiftRight<23>(hn::Sub(bits, hn::Set(di, 0x3F3504F3)));
  const V f = hn::Sub(hn::BitCast(d, hn::Sub(bits, hn::ShiftLeft<23>(k))), one);
  V p = hn::Set(d, 0.0870035995F);
  p = hn::MulAdd(p, f, hn::Set(d, -0.142674763F));
  p = hn::MulAdd(p, f, hn::Set(d, 0.14914787F));
  p = hn::MulAdd(p, f, hn::Set(d, -0.16577586F));
  p = hn::MulAdd(p, f, hn::Set(d, 0.199630623F));
  p = hn::MulAdd(p, f, hn::Set(d, -0.25001337F));
  p = hn::MulAdd(p, f, hn::Set(d, 0.333339108F));
  const V square = hn::Mul(f, f);
  // f - f^2/2 + f^3 p(f) + k ln 2
  V log = hn::MulAdd(hn::Mul(square, f), p, hn::NegMulAdd(hn::Set(d, 0.5F), square, f));
  log = hn::MulAdd(hn::ConvertTo(d, k), hn::Set(d, 0.693147181F), log);
  return hn::Sub(log, correction);
}

/// exp(x) for x <= 0, within 2 ulp; 0 below -87.
HWY_INLINE V ExpNegative(V x) {
  const D d;
  const hn::RebindToSigned<D> di;
  const V t = hn::Max(hn::Mul(x, hn::Set(d, 1.44269504F)), hn::Set(d, -126.0F));
  const auto whole = hn::NearestInt(t);
  const V f = hn::Sub(t, hn::ConvertTo(d, whole));
  V p = hn::Set(d, 0.00132647239F);
  p = hn::MulAdd(p, f, hn::Set(d, 0.00967151287F));
  p = hn::MulAdd(p, f, hn::Set(d, 0.0555073375F));
  p = hn::MulAdd(p, f, hn::Set(d, 0.240222421F));
  p = hn::MulAdd(p, f, hn::Set(d, 0.693146978F));
  p = hn::MulAdd(p, f, hn::Set(d, 1.0F));
  return hn::BitCast(d, hn::Add(hn::BitCast(di, p), hn::ShiftLeft<23>(whole)));
}

/// The first lanes of a vector. Highway's own masked access needs alignment before AVX2.
class Lanes {
 public:
  explicit Lanes(int64_t count) : count_(static_cast<size_t>(count)) {}
#if HWY_TARGET <= HWY_AVX2
  HWY_INLINE V Load(const float* from) const {
    return hn::MaskedLoad(hn::FirstN(D(), count_), D(), from);
  }
  HWY_INLINE void Store(V value, float* to) const {
    hn::BlendedStore(value, hn::FirstN(D(), count_), D(), to);
  }
#else
  HWY_INLINE V Load(const float* from) const {
    HWY_ALIGN float lanes[hn::MaxLanes(D())] = {};
    for (size_t i = 0; i < count_; ++i) {
      lanes[i] = from[i];
    }
    return hn::Load(D(), lanes);
  }
  HWY_INLINE void Store(V value, float* to) const {
    HWY_ALIGN float lanes[hn::MaxLanes(D())];
    hn::Store(value, D(), lanes);
    for (size_t i = 0; i < count_; ++i) {
      to[i] = lanes[i];
    }
  }
#endif

 private:
  size_t count_;
};

/// A row of taps, all lanes or the first few.
struct Row {
  const float* at;
  HWY_INLINE V Load(int64_t offset) const { return hn::LoadU(D(), at + offset); }
};
struct PartialRow {
  const float* at;
  Lanes lanes;
  HWY_INLINE V Load(int64_t offset) const { return lanes.Load(at + offset); }
};

struct Weights {
  explicit Weights(const Slab& slab)
      : w00(hn::Set(D(), (1 - slab.fu) * (1 - slab.fv))),
        w01(hn::Set(D(), slab.fu * (1 - slab.fv))),
        w10(hn::Set(D(), (1 - slab.fu) * slab.fv)),
        w11(hn::Set(D(), slab.fu * slab.fv)),
        row(slab.row_stride) {}
  V w00, w01, w10, w11;
  int64_t row;

  /// Bilinear at `offset` from the pixel's first tap.
  template <typename Taps>
  HWY_INLINE V At(const Taps& taps, int64_t offset) const {
    V value = hn::Mul(w00, taps.Load(offset));
    value = hn::MulAdd(w01, taps.Load(offset + 1), value);
    value = hn::MulAdd(w10, taps.Load(offset + row), value);
    return hn::MulAdd(w11, taps.Load(offset + row + 1), value);
  }
};

/// Colour of a value, and its opacity (by ramps) or the logarithm of its transparency (by table).
struct Classified {
  V red, green, blue, opacity;
};

HWY_INLINE Classified ByRamps(const KernelFunction& function, V value) {
  const D d;
  const V zero = hn::Zero(d);
  Classified c{hn::Set(d, function.base[0]), hn::Set(d, function.base[1]),
               hn::Set(d, function.base[2]), hn::Set(d, function.base[3])};
  for (const KernelFunction::Ramp& ramp : function.ramps) {
    // Max takes its second operand where the first is NaN.
    const V past =
        hn::Min(hn::Max(hn::Sub(value, hn::Set(d, ramp.start)), zero), hn::Set(d, ramp.length));
    c.red = hn::MulAdd(past, hn::Set(d, ramp.slope[0]), c.red);
    c.green = hn::MulAdd(past, hn::Set(d, ramp.slope[1]), c.green);
    c.blue = hn::MulAdd(past, hn::Set(d, ramp.slope[2]), c.blue);
    c.opacity = hn::MulAdd(past, hn::Set(d, ramp.slope[3]), c.opacity);
  }
  return c;
}

HWY_INLINE Classified ByTable(const TransferTable& table, V value) {
  const D d;
  const hn::RebindToSigned<D> di;
  static_assert(sizeof(TransferTable::Entry) == 8 * sizeof(float));
  V x = hn::Mul(hn::Sub(value, hn::Set(d, table.offset())), hn::Set(d, table.scale()));
  x = hn::Min(hn::Max(x, hn::Zero(d)), hn::Set(d, static_cast<float>(TransferTable::kEntries - 1)));
  const auto entry = hn::ConvertTo(di, x);
  const V f = hn::Sub(x, hn::ConvertTo(d, entry));
  const auto at = hn::ShiftLeft<3>(entry);
  const float* first = &table.entries()->red;
  const auto channel = [&](int c) HWY_ATTR {
    return hn::MulAdd(f, hn::GatherIndex(d, first + c + 4, at), hn::GatherIndex(d, first + c, at));
  };
  return {channel(0), channel(1), channel(2), hn::Neg(channel(3))};
}

/// x to the power 2^n.
HWY_INLINE V PowerOfPower(V x, int n) {
  for (int i = 0; i < n; ++i) {
    x = hn::Mul(x, x);
  }
  return x;
}

/// Ambient, diffuse and specular light (Blinn and Phong) on the isosurface through each sample;
/// both sides are lit. Where the gradient is weak there is no surface and only its colour is dimmed
/// less.
template <typename Taps>
HWY_INLINE void Shade(const KernelLight& light, const Weights& weights, const Taps& taps,
                      int64_t slice_stride, Classified* c) {
  const D d;
  const V half = hn::Set(d, 0.5F);
  const V gu = hn::Mul(half, hn::Sub(weights.At(taps, 1), weights.At(taps, -1)));
  const V gv =
      hn::Mul(half, hn::Sub(weights.At(taps, weights.row), weights.At(taps, -weights.row)));
  const V gk =
      hn::Mul(half, hn::Sub(weights.At(taps, slice_stride), weights.At(taps, -slice_stride)));
  const float* m = light.gradient_to_world;
  const auto row = [&](int r) HWY_ATTR {
    return hn::MulAdd(
        hn::Set(d, m[3 * r]), gu,
        hn::MulAdd(hn::Set(d, m[3 * r + 1]), gv, hn::Mul(hn::Set(d, m[3 * r + 2]), gk)));
  };
  const V gx = row(0);
  const V gy = row(1);
  const V gz = row(2);
  const V square = hn::MulAdd(gx, gx, hn::MulAdd(gy, gy, hn::Mul(gz, gz)));
  const V total = hn::Add(square, hn::Set(d, light.weak_gradient));
  const V strength = hn::Div(square, total);
  const V inverse = hn::Div(hn::Set(d, 1.0F), hn::Sqrt(hn::Add(square, hn::Set(d, 1e-30F))));
  const auto facing = [&](const float* to) HWY_ATTR {
    const V dot = hn::MulAdd(gx, hn::Set(d, to[0]),
                             hn::MulAdd(gy, hn::Set(d, to[1]), hn::Mul(gz, hn::Set(d, to[2]))));
    return hn::Min(hn::Abs(hn::Mul(dot, inverse)), hn::Set(d, 1.0F));
  };
  const V one = hn::Set(d, 1.0F);
  // Without a surface the diffuse part is full: a haze is as bright as unshaded.
  const V lambert = hn::MulAdd(strength, hn::Sub(facing(light.to_light), one), one);
  const V lit = hn::MulAdd(hn::Set(d, light.diffuse), lambert, hn::Set(d, light.ambient));
  const V gloss = hn::Mul(hn::Mul(hn::Set(d, light.specular), strength),
                          PowerOfPower(facing(light.halfway), light.shininess_log2));
  c->red = hn::Min(hn::MulAdd(c->red, lit, gloss), one);
  c->green = hn::Min(hn::MulAdd(c->green, lit, gloss), one);
  c->blue = hn::Min(hn::MulAdd(c->blue, lit, gloss), one);
}

template <bool kTable, bool kTwoFields, bool kShaded, bool kPolynomial>
class Compositor {
 public:
  Compositor(const KernelFunction& function, const KernelFunction& color, const KernelLight* light,
             const Slab& slab)
      : function_(function), color_(color), light_(light), slab_(slab), weights_(slab) {
    cover_count_ = kPolynomial ? slab.cover->count : 0;
  }

  HWY_INLINE void Run(const SlabRun& run) const {
    const D d;
    const auto lanes = static_cast<int64_t>(hn::Lanes(d));
    int64_t i = 0;
    for (; i + lanes <= run.count; i += lanes) {
      Step(
          run.tap + i, run.pixel + i, [](const float* at) HWY_ATTR { return Row{at}; },
          [](V value, float* to) HWY_ATTR { hn::StoreU(value, D(), to); });
    }
    if (i < run.count) {
      const Lanes some(run.count - i);
      Step(
          run.tap + i, run.pixel + i,
          [some](const float* at) HWY_ATTR {
            return PartialRow{at, some};
          },
          [some](V value, float* to) HWY_ATTR { some.Store(value, to); });
    }
  }

 private:
  template <typename RowOf, typename Store>
  HWY_INLINE void Step(int64_t tap, int64_t pixel, const RowOf& row_of, const Store& store) const {
    const D d;
    const auto taps = row_of(slab_.taps + tap);
    const V value = weights_.At(taps, 0);
    Classified c = kTable ? ByTable(*function_.table, value) : ByRamps(function_, value);
    if (hn::AllTrue(d, hn::Eq(c.opacity, hn::Zero(d)))) {
      return;
    }
    if constexpr (kTwoFields) {
      const V other = weights_.At(row_of(slab_.color_taps + tap), 0);
      const Classified paint = kTable ? ByTable(*color_.table, other) : ByRamps(color_, other);
      c = {paint.red, paint.green, paint.blue, c.opacity};
    }
    if constexpr (kShaded) {
      Shade(*light_, weights_, taps, slab_.slice_stride, &c);
    }
    const V before = row_of(slab_.transmittance + pixel).Load(0);
    const V weight = hn::Mul(
        before, kPolynomial ? CoverByPolynomial(c.opacity) : Cover(c.opacity, pixel, row_of));
    const auto add = [&](float* plane, V color) HWY_ATTR {
      store(hn::MulAdd(weight, color, row_of(plane + pixel).Load(0)), plane + pixel);
    };
    add(slab_.red, c.red);
    add(slab_.green, c.green);
    add(slab_.blue, c.blue);
    store(hn::Sub(before, weight), slab_.transmittance + pixel);
  }

  HWY_INLINE V CoverByPolynomial(V opacity) const {
    const D d;
    V sum = hn::Set(d, slab_.cover->coefficients[0]);
    for (int i = 1; i < cover_count_; ++i) {
      sum = hn::MulAdd(sum, opacity, hn::Set(d, slab_.cover->coefficients[static_cast<size_t>(i)]));
    }
    return hn::Mul(sum, opacity);
  }

  /// What a slab covers, 1 - (1 - D alpha)^length, from the opacity or the logarithm of what it
  /// lets through.
  template <typename RowOf>
  HWY_INLINE V Cover(V opacity, int64_t pixel, const RowOf& row_of) const {
    const D d;
    V log = opacity;
    if (slab_.opacity_scale != nullptr) {
      const V alpha = kTable ? hn::Sub(hn::Set(d, 1.0F), ExpNegative(opacity)) : opacity;
      log = LogTransparency(hn::Mul(alpha, row_of(slab_.opacity_scale + pixel).Load(0)));
    } else if constexpr (!kTable) {
      log = LogTransparency(opacity);
    }
    V length = hn::Set(d, slab_.length);
    if (slab_.length_scale != nullptr) {
      length = hn::Mul(length, row_of(slab_.length_scale + pixel).Load(0));
    }
    return hn::Sub(hn::Set(d, 1.0F), ExpNegative(hn::Mul(log, length)));
  }

  const KernelFunction& function_;
  const KernelFunction& color_;
  const KernelLight* light_;
  const Slab slab_;  // a copy: nothing that is stored can change it
  Weights weights_;
  int cover_count_ = 0;
};

template <bool kTable, bool kTwoFields, bool kShaded, bool kPolynomial>
HWY_INLINE void CompositeAll(const KernelFunction& function, const KernelFunction& color,
                             const KernelLight* light, const Slab& slab,
                             std::span<const SlabRun> runs) {
  const Compositor<kTable, kTwoFields, kShaded, kPolynomial> compositor(function, color, light,
                                                                        slab);
  for (const SlabRun& run : runs) {
    compositor.Run(run);
  }
}

template <bool kTable, bool kTwoFields>
void CompositeFields(const KernelFunction& function, const KernelFunction& color,
                     const KernelLight* light, const Slab& slab, std::span<const SlabRun> runs) {
  // Polynomials pay where nothing else is done; the rest takes the general way.
  if (light != nullptr) {
    CompositeAll<kTable, kTwoFields, true, false>(function, color, light, slab, runs);
  } else if (!kTable && slab.cover != nullptr && slab.cover->count > 0 &&
             slab.opacity_scale == nullptr && slab.length_scale == nullptr) {
    CompositeAll<kTable, kTwoFields, false, !kTable>(function, color, light, slab, runs);
  } else {
    CompositeAll<kTable, kTwoFields, false, false>(function, color, light, slab, runs);
  }
}

void Composite(const KernelFunction& function, const KernelFunction& color,
               const KernelLight* light, const Slab& slab, std::span<const SlabRun> runs) {
  const bool by_table = function.table.has_value();
  if (slab.color_taps != nullptr) {
    by_table ? CompositeFields<true, true>(function, color, light, slab, runs)
             : CompositeFields<false, true>(function, color, light, slab, runs);
  } else {
    by_table ? CompositeFields<true, false>(function, color, light, slab, runs)
             : CompositeFields<false, false>(function, color, light, slab, runs);
  }
}

void Maximum(const Slab& slab, std::span<const SlabRun> runs) {
  const D d;
  const Weights weights(slab);
  const auto lanes = static_cast<int64_t>(hn::Lanes(d));
  // Where nothing of the path counts the value is as good as what was there.
  const auto larger = [&slab](V value, V before, V scale) HWY_ATTR {
    if (slab.length_scale != nullptr) {
      value = hn::IfThenElse(hn::Gt(scale, hn::Zero(D())), value, before);
    }
    return hn::Max(value, before);
  };
  for (const SlabRun& run : runs) {
    const float* taps = slab.taps + run.tap;
    const float* scales = slab.length_scale != nullptr ? slab.length_scale + run.pixel : taps;
    float* most = slab.red + run.pixel;
    int64_t i = 0;
    for (; i + lanes <= run.count; i += lanes) {
      const V value = weights.At(Row{taps + i}, 0);
      hn::StoreU(larger(value, hn::LoadU(d, most + i), hn::LoadU(d, scales + i)), d, most + i);
    }
    if (i < run.count) {
      const Lanes some(run.count - i);
      const V value = weights.At(PartialRow{taps + i, some}, 0);
      some.Store(larger(value, some.Load(most + i), some.Load(scales + i)), most + i);
    }
  }
}

std::string TargetName() {
  return hwy::TargetName(HWY_TARGET);
}

}  // namespace fovea::render::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace fovea::render {

KernelFunction::KernelFunction(const TransferFunction& transfer, bool by_table) {
  const auto& points = transfer.points;
  const auto channels = [](const TransferFunction::Point& p) {
    return std::array<double, 4>{p.color.red, p.color.green, p.color.blue, p.opacity};
  };
  const std::array<double, 4> first = channels(points.front());
  for (int c = 0; c < 4; ++c) {
    base[c] = static_cast<float>(first[c]);
  }
  if (by_table || NeedsTable(transfer)) {
    table.emplace(transfer);
    return;
  }
  const double range = points.back().value - points.front().value;
  for (size_t i = 0; i + 1 < points.size(); ++i) {
    const std::array<double, 4> from = channels(points[i]);
    const std::array<double, 4> to = channels(points[i + 1]);
    if (from == to) {
      continue;
    }
    Ramp ramp;
    ramp.start = static_cast<float>(points[i].value);
    // Two points at one value make a step: a ramp as steep as floats around there can tell.
    const double steepest = 2e-7 * std::max(std::abs(points[i].value), range) + 1e-30;
    ramp.length = static_cast<float>(
        std::max(points[i + 1].value - static_cast<double>(ramp.start), steepest));
    for (int c = 0; c < 4; ++c) {
      ramp.slope[c] = static_cast<float>((to[c] - from[c]) / static_cast<double>(ramp.length));
    }
    ramps.push_back(ramp);
  }
}

HWY_EXPORT(Composite);
HWY_EXPORT(Maximum);
HWY_EXPORT(TargetName);

void CompositeSlab(const KernelFunction& function, const KernelFunction& color,
                   const KernelLight* light, const Slab& slab, std::span<const SlabRun> runs) {
  HWY_DYNAMIC_DISPATCH(Composite)(function, color, light, slab, runs);
}

void MaximumSlab(const Slab& slab, std::span<const SlabRun> runs) {
  HWY_DYNAMIC_DISPATCH(Maximum)(slab, runs);
}

std::string KernelTarget() {
  return HWY_DYNAMIC_DISPATCH(TargetName)();
}

}  // namespace fovea::render
#endif  // HWY_ONCE
