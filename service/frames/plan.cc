#include "service/frames/plan.h"

#include <algorithm>
#include <functional>
#include <string>

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

Status CheckCountable(const FrameSpec& resolved) {
  if (resolved.color_field) {
    return InvalidArgument("color_field: a plan counts one field; leave it out");
  }
  if (resolved.view.perspective) {
    return InvalidArgument(
        "a plan counts orthographic views; leave out --eye, --target, --up and --fov");
  }
  return absl::OkStatus();
}

/// What follows from windows and view alone: nothing is read, and reading counts for nothing.
StatusOr<FramePlan> Count(const store::DatasetInfo& info, const FrameSpec& resolved, int threads) {
  FOVEA_ASSIGN_OR_RETURN(const RetainedSet retained,
                         RetainedSet::Make(info.hierarchy, FoveaOf(resolved)));
  FramePlan plan;
  plan.used = resolved;
  plan.threads = Threads(threads);
  plan.counts = CountFrame(info, retained, resolved);
  plan.coefficients = static_cast<uint64_t>(retained.CoefficientCount());
  plan.time = render::PredictTime(plan.counts, 0, 0, plan.threads);
  if (std::optional<Warning> warning = RetentionWarning(info, retained)) {
    plan.warnings.push_back(*std::move(warning));
  }
  return plan;
}

/// Adds what is read to a plan that Count made.
Status AddRead(store::Dataset& dataset, int64_t step, FramePlan* plan) {
  const FrameSpec& resolved = plan->used;
  FOVEA_ASSIGN_OR_RETURN(const RetainedSet retained,
                         RetainedSet::Make(dataset.info().hierarchy, FoveaOf(resolved)));
  FOVEA_ASSIGN_OR_RETURN(
      const store::ReadStats read,
      store::QuoteRead(dataset, step, *resolved.field,
                       resolved.strict ? store::OnDamage::kFail : store::OnDamage::kCount,
                       retained));
  plan->chunks_read = read.chunks_read;
  plan->chunks_total = read.chunks_total;
  plan->bytes_read = read.bytes_read;
  plan->time =
      render::PredictTime(plan->counts, plan->chunks_read, plan->bytes_read, plan->threads);
  return absl::OkStatus();
}

/// The largest of the rates `low` to `most` that `plan_at` says is within the budget; it is so of
/// `low`. Doubles first, so that nothing much larger than the answer is ever planned.
StatusOr<int64_t> LargestWithin(int64_t low, int64_t most, const FrameBudget& budget,
                                const std::function<StatusOr<FramePlan>(int64_t)>& plan_at) {
  // Invariant: `low` keeps within the budget, `high` does not (or is most + 1).
  int64_t high = most + 1;
  bool doubling = true;
  while (high - low > 1) {
    const int64_t middle = doubling ? std::min(2 * low, most) : low + (high - low) / 2;
    FOVEA_ASSIGN_OR_RETURN(const FramePlan plan, plan_at(middle));
    if (Excess(plan, budget).empty()) {
      low = middle;
    } else {
      high = middle;
      doubling = false;
    }
  }
  return low;
}

}  // namespace

StatusOr<FramePlan> PlanFrame(store::Dataset& dataset, int64_t step, const FrameSpec& resolved,
                              int threads) {
  FOVEA_RETURN_IF_ERROR(CheckCountable(resolved));
  FOVEA_ASSIGN_OR_RETURN(FramePlan plan, Count(dataset.info(), resolved, threads));
  FOVEA_RETURN_IF_ERROR(AddRead(dataset, step, &plan));
  return plan;
}

StatusOr<FramePlan> PlanWithin(store::Dataset& dataset, int64_t step, const FrameSpec& resolved,
                               const FrameBudget& budget, int threads) {
  const auto at = [&resolved](int64_t rate) {
    FrameSpec spec = resolved;
    spec.rate = static_cast<double>(rate);
    return spec;
  };
  const auto plan_at = [&](int64_t rate) { return PlanFrame(dataset, step, at(rate), threads); };
  FOVEA_ASSIGN_OR_RETURN(const FramePlan least, plan_at(1));
  if (const std::string excess = Excess(least, budget); !excess.empty()) {
    return ResourceExhausted(
        "a frame at rate 1 already takes {}; allow more, or ask for fewer pixels", excess);
  }
  // What costs nothing first: the time of a quote grows with the chunks, which may be billions.
  const store::DatasetInfo info = dataset.info();
  FOVEA_ASSIGN_OR_RETURN(
      int64_t rate, LargestWithin(1, info.hierarchy.dims().Max(), budget, [&](int64_t rate_tried) {
        return Count(info, at(rate_tried), threads);
      }));
  if (budget.bytes_read || budget.ms) {
    FOVEA_ASSIGN_OR_RETURN(rate, LargestWithin(1, rate, budget, plan_at));
  }
  return plan_at(rate);
}

}  // namespace fovea::frames
