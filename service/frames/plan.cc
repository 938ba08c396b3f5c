#include "service/frames/plan.h"

#include <algorithm>

#include "engine/base/parallel.h"
#include "engine/store/read_quote.h"
#include "service/frames/frames.h"

namespace fovea::frames {
namespace {

int Threads(int wanted) {
  return wanted > 0 ? wanted : HardwareThreads();
}

/// What of the plan breaks the budget first; empty if nothing does.
std::string Excess(const FramePlan& plan, const FrameBudget& budget) {
  if (budget.coefficients && plan.coefficients > *budget.coefficients) {
    return fmt::format("{} coefficients, above {}", plan.coefficients, *budget.coefficients);
  }
  const auto memory = static_cast<uint64_t>(plan.counts.memory_bytes);
  if (budget.memory_bytes && memory > *budget.memory_bytes) {
    return fmt::format("{} bytes of memory, above {}", memory, *budget.memory_bytes);
  }
  if (budget.bytes_read && plan.bytes_read > *budget.bytes_read) {
    return fmt::format("{} bytes to read, above {}", plan.bytes_read, *budget.bytes_read);
  }
  if (budget.ms && plan.time.Total() > *budget.ms) {
    return fmt::format("{:.3g} ms, above {:.3g}", plan.time.Total(), *budget.ms);
  }
  return "";
}

}  // namespace

StatusOr<FramePlan> PlanFrame(store::Dataset& dataset, int64_t step, const FrameSpec& resolved,
                              int threads) {
  if (resolved.color_field) {
    return InvalidArgument("color_field: a plan counts one field; leave it out");
  }
  if (resolved.view.perspective) {
    return InvalidArgument(
        "a plan counts orthographic views; leave out --eye, --target, --up and --fov");
  }
  const store::DatasetInfo info = dataset.info();
  FOVEA_ASSIGN_OR_RETURN(const RetainedSet retained,
                         RetainedSet::Make(info.hierarchy, FoveaOf(resolved)));
  FramePlan plan;
  plan.used = resolved;
  plan.threads = Threads(threads);
  plan.counts = CountFrame(info, retained, resolved);
  plan.coefficients = static_cast<uint64_t>(retained.CoefficientCount());
  FOVEA_ASSIGN_OR_RETURN(
      const store::ReadStats read,
      store::QuoteRead(dataset, step, *resolved.field,
                       resolved.strict ? store::OnDamage::kFail : store::OnDamage::kCount,
                       retained));
  plan.chunks_read = read.chunks_read;
  plan.chunks_total = read.chunks_total;
  plan.bytes_read = read.bytes_read;
  plan.time = render::PredictTime(plan.counts, plan.chunks_read, plan.bytes_read, plan.threads);
  return plan;
}

StatusOr<FramePlan> PlanWithin(store::Dataset& dataset, int64_t step, const FrameSpec& resolved,
                               const FrameBudget& budget, int threads) {
  const int64_t n = dataset.info().hierarchy.dims().Max();
  const auto at = [&](int64_t rate) {
    FrameSpec spec = resolved;
    spec.rate = static_cast<double>(rate);
    return PlanFrame(dataset, step, spec, threads);
  };
  FOVEA_ASSIGN_OR_RETURN(FramePlan best, at(1));
  if (const std::string excess = Excess(best, budget); !excess.empty()) {
    return ResourceExhausted(
        "a frame at rate 1 already takes {}; allow more, or ask for fewer pixels", excess);
  }
  // Invariant: `low` keeps within the budget, `high` does not (or is n + 1). Doubling first, so
  // that nothing much larger than the answer is ever planned.
  int64_t low = 1;
  int64_t high = n + 1;
  bool doubling = true;
  while (high - low > 1) {
    const int64_t middle = doubling ? std::min(2 * low, n) : low + (high - low) / 2;
    FOVEA_ASSIGN_OR_RETURN(FramePlan plan, at(middle));
    if (Excess(plan, budget).empty()) {
      low = middle;
      best = std::move(plan);
    } else {
      high = middle;
      doubling = false;
    }
  }
  return best;
}

}  // namespace fovea::frames
