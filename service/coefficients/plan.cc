#include "service/coefficients/plan.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "engine/store/layout.h"

namespace fovea::coefficients {
namespace {

/// The smallest rate that is worth stopping at.
constexpr double kLeastStage = 4;
/// Boxes are cut at multiples of this where they can be: stored chunks are then read less often.
constexpr int64_t kCutAt = 16;
/// Boxes of one plan: about 20 MB.
constexpr size_t kMaxPlannedBoxes = size_t{1} << 18;

int64_t ValuesOf(int level, const Box3& box) {
  return (level == kCoarse ? 1 : store::kSubBands) * box.Volume();
}

/// Makes the blocks of one plan, field by field and level by level.
class Planner {
 public:
  Planner(const store::DatasetInfo& info, const PlanRequest& request)
      : info_(info), request_(request) {}

  [[nodiscard]] StatusOr<Plan> Make();

 private:
  [[nodiscard]] static StatusOr<std::vector<RetainedSet>> Sets(const Hierarchy& hierarchy,
                                                               const std::vector<Fovea>& foveas);
  /// All that one stage adds; `before` is the stage before it, or null.
  [[nodiscard]] Status AddStage(const RetainedSet& now, const RetainedSet* before);
  [[nodiscard]] Status AddLevel(int level, const RetainedSet& now, const RetainedSet* before);
  /// Cuts `box` until each part fits a block.
  [[nodiscard]] Status Add(int level, const Box3& box, bool difference);
  [[nodiscard]] Status Put(int level, const Box3& box, bool difference);
  void EndBlock() { open_ = false; }

  const store::DatasetInfo& info_;
  const PlanRequest& request_;
  std::vector<RetainedSet> held_, base_;
  Plan plan_;
  int field_ = 0;
  size_t boxes_ = 0;
  bool open_ = false;       // whether the last block takes more
  int64_t open_bytes_ = 0;  // of its numbers
  std::string open_type_;
};

StatusOr<std::vector<RetainedSet>> Planner::Sets(const Hierarchy& hierarchy,
                                                 const std::vector<Fovea>& foveas) {
  std::vector<RetainedSet> sets;
  for (const Fovea& fovea : foveas) {
    FOVEA_ASSIGN_OR_RETURN(sets.emplace_back(), RetainedSet::Make(hierarchy, fovea));
  }
  return sets;
}

StatusOr<Plan> Planner::Make() {
  FOVEA_ASSIGN_OR_RETURN(held_, Sets(info_.hierarchy, request_.held));
  FOVEA_ASSIGN_OR_RETURN(base_, Sets(info_.hierarchy, request_.base));
  std::optional<RetainedSet> before;
  for (const Rate& rate : StageRates(info_.hierarchy, request_.fovea.rate)) {
    FOVEA_ASSIGN_OR_RETURN(
        RetainedSet now,
        RetainedSet::Make(info_.hierarchy, {request_.fovea.at, rate, WindowShape::kCube}));
    for (field_ = 0; field_ < static_cast<int>(request_.fields.size()); ++field_) {
      FOVEA_RETURN_IF_ERROR(AddStage(now, before ? &*before : nullptr));
      EndBlock();
    }
    (plan_.blocks.empty() ? plan_.reached : plan_.blocks.back().reached) = rate;
    before = std::move(now);
  }
  return std::move(plan_);
}

Status Planner::AddStage(const RetainedSet& now, const RetainedSet* before) {
  if (before == nullptr && held_.empty()) {
    FOVEA_RETURN_IF_ERROR(Add(kCoarse, now.box(0), !base_.empty()));
  }
  for (int level = 0; level < info_.hierarchy.finest(); ++level) {
    FOVEA_RETURN_IF_ERROR(AddLevel(level, now, before));
  }
  return absl::OkStatus();
}

Status Planner::AddLevel(int level, const RetainedSet& now, const RetainedSet* before) {
  std::vector<Box3> missing{now.window(level)};
  if (before != nullptr) {
    missing = Subtract(std::move(missing), before->window(level));
  }
  for (const RetainedSet& held : held_) {
    missing = Subtract(std::move(missing), held.window(level));
  }
  for (const RetainedSet& base : base_) {
    for (const Box3& box : missing) {
      FOVEA_RETURN_IF_ERROR(Add(level, Intersect(box, base.window(level)), true));
    }
    missing = Subtract(std::move(missing), base.window(level));
  }
  for (const Box3& box : missing) {
    FOVEA_RETURN_IF_ERROR(Add(level, box, false));
  }
  return absl::OkStatus();
}

Status Planner::Add(int level, const Box3& box, bool difference) {
  if (box.IsEmpty()) {
    return absl::OkStatus();
  }
  const store::Coding coding = CodingOf(info_, request_.fields[static_cast<size_t>(field_)], level);
  if (ValuesOf(level, box) * store::BytesOfType(coding.type) <= kMaxNumberBytes) {
    return Put(level, box, difference);
  }
  int axis = 2;
  for (int other = 1; other >= 0; --other) {
    axis = box.Size()[other] > box.Size()[axis] ? other : axis;
  }
  const int64_t middle = box.lo[axis] + box.Size()[axis] / 2;
  const int64_t aligned = (middle + kCutAt / 2) / kCutAt * kCutAt;
  const int64_t cut = aligned > box.lo[axis] && aligned < box.hi[axis] ? aligned : middle;
  Box3 first = box;
  Box3 second = box;
  first.hi[axis] = second.lo[axis] = cut;
  FOVEA_RETURN_IF_ERROR(Add(level, first, difference));
  return Add(level, second, difference);
}

Status Planner::Put(int level, const Box3& box, bool difference) {
  if (++boxes_ > kMaxPlannedBoxes) {
    return ResourceExhausted(
        "what is held cuts the windows of the fovea into more than {} boxes; name fewer",
        kMaxPlannedBoxes);
  }
  const store::Coding coding = CodingOf(info_, request_.fields[static_cast<size_t>(field_)], level);
  const int64_t values = ValuesOf(level, box);
  const int64_t bytes = values * store::BytesOfType(coding.type);
  if (!open_ || open_type_ != coding.type || open_bytes_ + bytes > kMaxNumberBytes ||
      plan_.blocks.back().boxes.size() == kMaxBoxes) {
    const std::optional<Rate> reached =
        plan_.blocks.empty() ? plan_.reached : plan_.blocks.back().reached;
    plan_.blocks.push_back({field_, {}, reached});
    open_ = true;
    open_bytes_ = 0;
    open_type_ = coding.type;
  }
  plan_.blocks.back().boxes.push_back({level, box, difference});
  open_bytes_ += bytes;
  plan_.coefficients += values;
  return absl::OkStatus();
}

}  // namespace

std::vector<Box3> Subtract(std::vector<Box3> boxes, const Box3& what) {
  std::vector<Box3> left;
  for (Box3 box : boxes) {
    const Box3 common = Intersect(box, what);
    if (common.IsEmpty()) {
      left.push_back(box);
      continue;
    }
    for (int axis = 2; axis >= 0; --axis) {
      if (box.lo[axis] < common.lo[axis]) {
        Box3 part = box;
        part.hi[axis] = common.lo[axis];
        left.push_back(part);
        box.lo[axis] = common.lo[axis];
      }
      if (common.hi[axis] < box.hi[axis]) {
        Box3 part = box;
        part.lo[axis] = common.hi[axis];
        left.push_back(part);
        box.hi[axis] = common.hi[axis];
      }
    }
  }
  return left;
}

std::vector<Rate> StageRates(const Hierarchy& hierarchy, const Rate& rate) {
  const auto most = static_cast<double>(hierarchy.dims().Max());
  std::vector<Rate> rates{rate};
  constexpr double kRounding = 1 + 1e-9;  // a half is a half
  double shrunk = kRounding;
  while (true) {
    shrunk /= std::numbers::sqrt2;
    const auto smaller = [&](double r) {
      return std::max(1.0, std::floor(std::min(r, most) * shrunk));
    };
    const Rate stage(smaller(rate.x), smaller(rate.y), smaller(rate.z));
    if (std::max({stage.x, stage.y, stage.z}) < kLeastStage) {
      break;
    }
    if (stage != rates.back()) {
      rates.push_back(stage);
    }
  }
  std::reverse(rates.begin(), rates.end());
  return rates;
}

store::Coding CodingOf(const store::DatasetInfo& info, const std::string& field, int level) {
  const store::FieldInfo& of = info.FieldOf(field);
  return level == kCoarse ? store::CoarseCoding(info, of)
                          : store::LevelLayout::Make(info, of, level).coding;
}

int64_t PlannedBlock::Values() const {
  int64_t values = 0;
  for (const PlannedBox& box : boxes) {
    values += ValuesOf(box.level, box.box);
  }
  return values;
}

StatusOr<Plan> MakePlan(const store::DatasetInfo& info, const PlanRequest& request) {
  return Planner(info, request).Make();
}

}  // namespace fovea::coefficients
