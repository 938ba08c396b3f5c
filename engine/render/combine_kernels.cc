#include "engine/render/combine_kernels.h"

#include <algorithm>
#include <cstring>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/render/combine_kernels.cc"
#include <hwy/foreach_target.h>  // IWYU pragma: keep
// foreach_target.h must come first
#include <hwy/contrib/math/math-inl.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace fovea::render::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using Floats = hn::ScalableTag<float>;
using Vector = hn::Vec<Floats>;

/// `count` (1 to Lanes) elements from `from`, then zeros. Reads nothing beyond them.
Vector LoadSome(Floats d, const float* from, size_t count) {
  if (count == hn::Lanes(d)) {
    return hn::LoadU(d, from);
  }
#if HWY_MEM_OPS_MIGHT_FAULT
  HWY_ALIGN float buffer[hn::MaxLanes(Floats())] = {};
  std::memcpy(buffer, from, count * sizeof(float));
  return hn::Load(d, buffer);
#else
  return hn::MaskedLoad(hn::FirstN(d, count), d, from);
#endif
}

void StoreSome(Vector v, Floats d, float* to, size_t count) {
  if (count == hn::Lanes(d)) {
    hn::StoreU(v, d, to);
    return;
  }
#if HWY_MEM_OPS_MIGHT_FAULT
  HWY_ALIGN float buffer[hn::MaxLanes(Floats())];
  hn::Store(v, d, buffer);
  std::memcpy(to, buffer, count * sizeof(float));
#else
  hn::BlendedStore(v, hn::FirstN(d, count), d, to);
#endif
}

/// 1 or 0 for each of `count` bytes, then zeros.
Vector LoadFlags(Floats d, const uint8_t* from, size_t count) {
  HWY_ALIGN float buffer[hn::MaxLanes(Floats())] = {};
  for (size_t i = 0; i < count; ++i) {
    buffer[i] = from[i];
  }
  return hn::Load(d, buffer);
}

void FindDensities(const GatheredRun& from, const uint8_t* split, size_t count,
                   const DensityRun& to) {
  const Floats d;
  const size_t lanes = hn::Lanes(d);
  const auto zero = hn::Zero(d);
  const auto one = hn::Set(d, 1.0F);
  for (size_t i = 0; i < count; i += lanes) {
    const size_t some = std::min(lanes, count - i);
    const auto depth = LoadSome(d, from.depth + i, some);
    const auto transmittance = LoadSome(d, from.transmittance + i, some);
    const auto takes_part =
        hn::And(hn::Gt(depth, zero), hn::Gt(LoadFlags(d, split + i, some), zero));
    const auto has_met = hn::And(takes_part, hn::Lt(transmittance, one));
    const auto floored = hn::Max(transmittance, hn::Set(d, 1e-7F));
    const auto tau = hn::IfThenElseZero(has_met, hn::Div(hn::Neg(hn::Log(d, floored)), depth));
    const auto per_cover = hn::IfThenElseZero(has_met, hn::Div(tau, hn::Sub(one, transmittance)));
    // Whole vectors: the slack behind the run takes what is too much, all of it zeros.
    hn::StoreU(tau, d, to.tau + i);
    hn::StoreU(hn::Mul(per_cover, LoadSome(d, from.red + i, some)), d, to.red + i);
    hn::StoreU(hn::Mul(per_cover, LoadSome(d, from.green + i, some)), d, to.green + i);
    hn::StoreU(hn::Mul(per_cover, LoadSome(d, from.blue + i, some)), d, to.blue + i);
    hn::StoreU(hn::IfThenElseZero(takes_part, one), d, to.share + i);
  }
}

/// Weights 3/4 and 1/4 on either axis. Two children a parent: the even one lies towards the parent
/// before, the odd one towards the parent after.
struct Pair {
  Vector even, odd;
};

Pair Spread(Floats d, const float* near, const float* far) {
  const auto most = hn::Set(d, 0.75F);
  const auto rest = hn::Set(d, 0.25F);
  const auto mixed = [&](int at) {
    return hn::MulAdd(most, hn::LoadU(d, near + at), hn::Mul(rest, hn::LoadU(d, far + at)));
  };
  const auto own = hn::Mul(most, mixed(0));
  return {hn::MulAdd(rest, mixed(-1), own), hn::MulAdd(rest, mixed(1), own)};
}

/// Colour and transmittance over `depth` of a density, given as sums over shares.
struct Gathering {
  Vector red, green, blue, transmittance;
};

Gathering GatherOver(Floats d, Vector tau, Vector red, Vector green, Vector blue, Vector share,
                     Vector depth) {
  const auto zero = hn::Zero(d);
  const auto one = hn::Set(d, 1.0F);
  const auto scale = hn::Div(one, share);
  const auto mean = hn::Mul(tau, scale);
  const auto gathers =
      hn::And(hn::Gt(share, zero), hn::And(hn::Gt(tau, zero), hn::Gt(depth, zero)));
  const auto optical_depth = hn::IfThenElseZero(gathers, hn::Mul(mean, depth));
  const auto transmittance = hn::Exp(d, hn::Neg(optical_depth));
  const auto cover_per_tau =
      hn::IfThenElseZero(gathers, hn::Mul(scale, hn::Div(hn::Sub(one, transmittance), mean)));
  return {hn::Mul(red, cover_per_tau), hn::Mul(green, cover_per_tau), hn::Mul(blue, cover_per_tau),
          transmittance};
}

void InheritSmoothly(const DensityRun& near, const DensityRun& far, const float* parent_depth,
                     const uint8_t* split, size_t count, Inheritance* to) {
  const Floats d;
  const size_t lanes = hn::Lanes(d);
  for (size_t i = 0; i < count; i += lanes) {
    const size_t some = std::min(lanes, count - i);
    const auto flags = LoadFlags(d, split + i, some);
    const auto depth =
        hn::IfThenElseZero(hn::Gt(flags, hn::Zero(d)), LoadSome(d, parent_depth + i, some));
    const Pair tau = Spread(d, near.tau + i, far.tau + i);
    const Pair red = Spread(d, near.red + i, far.red + i);
    const Pair green = Spread(d, near.green + i, far.green + i);
    const Pair blue = Spread(d, near.blue + i, far.blue + i);
    const Pair share = Spread(d, near.share + i, far.share + i);
    const Gathering even =
        GatherOver(d, tau.even, red.even, green.even, blue.even, share.even, depth);
    const Gathering odd = GatherOver(d, tau.odd, red.odd, green.odd, blue.odd, share.odd, depth);
    hn::StoreInterleaved2(even.red, odd.red, d, to->red + 2 * i);
    hn::StoreInterleaved2(even.green, odd.green, d, to->green + 2 * i);
    hn::StoreInterleaved2(even.blue, odd.blue, d, to->blue + 2 * i);
    hn::StoreInterleaved2(even.transmittance, odd.transmittance, d, to->transmittance + 2 * i);
    hn::StoreInterleaved2(depth, depth, d, to->depth + 2 * i);
  }
}

void InheritCopies(const GatheredRun& parents, const uint8_t* split, size_t count,
                   Inheritance* to) {
  const Floats d;
  const size_t lanes = hn::Lanes(d);
  for (size_t i = 0; i < count; i += lanes) {
    const size_t some = std::min(lanes, count - i);
    const auto is_split = hn::Gt(LoadFlags(d, split + i, some), hn::Zero(d));
    const auto copy = [&](const float* from, float* children) {
      const auto v = hn::IfThenElseZero(is_split, LoadSome(d, from + i, some));
      hn::StoreInterleaved2(v, v, d, children + 2 * i);
    };
    copy(parents.red, to->red);
    copy(parents.green, to->green);
    copy(parents.blue, to->blue);
    copy(parents.depth, to->depth);
    const auto transmittance =
        hn::IfThenElse(is_split, LoadSome(d, parents.transmittance + i, some), hn::Set(d, 1.0F));
    hn::StoreInterleaved2(transmittance, transmittance, d, to->transmittance + 2 * i);
  }
}

template <bool kInheritedIsNear>
void Composite(const Inheritance& inherited, size_t count, const GatheredRun& own) {
  const Floats d;
  const size_t lanes = hn::Lanes(d);
  for (size_t i = 0; i < count; i += lanes) {
    const size_t some = std::min(lanes, count - i);
    const auto own_transmittance = LoadSome(d, own.transmittance + i, some);
    const auto inherited_transmittance = hn::Load(d, inherited.transmittance + i);
    const auto over = [&](const float* from, float* to) {
      const auto inherits = hn::Load(d, from + i);
      const auto owns = LoadSome(d, to + i, some);
      StoreSome(kInheritedIsNear ? hn::MulAdd(inherited_transmittance, owns, inherits)
                                 : hn::MulAdd(own_transmittance, inherits, owns),
                d, to + i, some);
    };
    over(inherited.red, own.red);
    over(inherited.green, own.green);
    over(inherited.blue, own.blue);
    StoreSome(hn::Mul(own_transmittance, inherited_transmittance), d, own.transmittance + i, some);
    const auto depth = hn::MulAdd(hn::Set(d, 2.0F), hn::Load(d, inherited.depth + i),
                                  LoadSome(d, own.depth + i, some));
    StoreSome(depth, d, own.depth + i, some);
  }
}

void CompositeBefore(const Inheritance& inherited, size_t count, const GatheredRun& own) {
  Composite<true>(inherited, count, own);
}

void CompositeBehind(const Inheritance& inherited, size_t count, const GatheredRun& own) {
  Composite<false>(inherited, count, own);
}

void ShowLeaves(const GatheredRun& front, const GatheredRun& back, const PixelKind* kinds,
                size_t count, Rgba* values) {
  const Floats d;
  const size_t lanes = hn::Lanes(d);
  for (size_t i = 0; i < count; i += lanes) {
    const size_t some = std::min(lanes, count - i);
    HWY_ALIGN float flags[hn::MaxLanes(Floats())] = {};
    for (size_t j = 0; j < some; ++j) {
      flags[j] = kinds[i + j] == PixelKind::kLeaf ? 1.0F : 0.0F;
    }
    const auto is_leaf = hn::Gt(hn::Load(d, flags), hn::Zero(d));
    const auto transmittance = LoadSome(d, front.transmittance + i, some);
    const auto over = [&](const float* near, const float* far) {
      return hn::IfThenElseZero(is_leaf, hn::MulAdd(transmittance, LoadSome(d, far + i, some),
                                                    LoadSome(d, near + i, some)));
    };
    const auto cover = hn::IfThenElseZero(
        is_leaf,
        hn::NegMulAdd(transmittance, LoadSome(d, back.transmittance + i, some), hn::Set(d, 1.0F)));
    HWY_ALIGN float interleaved[4 * hn::MaxLanes(Floats())];
    hn::StoreInterleaved4(over(front.red, back.red), over(front.green, back.green),
                          over(front.blue, back.blue), cover, d, interleaved);
    std::memcpy(static_cast<void*>(values + i), interleaved, some * sizeof(Rgba));
  }
}

}  // namespace fovea::render::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace fovea::render {

HWY_EXPORT(FindDensities);
HWY_EXPORT(InheritSmoothly);
HWY_EXPORT(InheritCopies);
HWY_EXPORT(CompositeBefore);
HWY_EXPORT(CompositeBehind);
HWY_EXPORT(ShowLeaves);

void FindDensities(const GatheredRun& from, const uint8_t* split, size_t count,
                   const DensityRun& to) {
  HWY_DYNAMIC_DISPATCH(FindDensities)(from, split, count, to);
}

void InheritSmoothly(const DensityRun& near, const DensityRun& far, const float* parent_depth,
                     const uint8_t* split, size_t count, Inheritance* to) {
  HWY_DYNAMIC_DISPATCH(InheritSmoothly)(near, far, parent_depth, split, count, to);
}

void InheritCopies(const GatheredRun& parents, const uint8_t* split, size_t count,
                   Inheritance* to) {
  HWY_DYNAMIC_DISPATCH(InheritCopies)(parents, split, count, to);
}

void CompositeBefore(const Inheritance& inherited, size_t count, const GatheredRun& own) {
  HWY_DYNAMIC_DISPATCH(CompositeBefore)(inherited, count, own);
}

void CompositeBehind(const Inheritance& inherited, size_t count, const GatheredRun& own) {
  HWY_DYNAMIC_DISPATCH(CompositeBehind)(inherited, count, own);
}

void ShowLeaves(const GatheredRun& front, const GatheredRun& back, const PixelKind* kinds,
                size_t count, Rgba* values) {
  HWY_DYNAMIC_DISPATCH(ShowLeaves)(front, back, kinds, count, values);
}

}  // namespace fovea::render
#endif  // HWY_ONCE
