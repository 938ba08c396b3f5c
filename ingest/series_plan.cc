#include "ingest/series_plan.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include <absl/strings/str_join.h>

#include "ingest/missing_files.h"
#include "ingest/registration.h"
#include "ingest/step_times.h"

namespace fovea::ingest {
namespace {

std::string Show(const Vec3& v) {
  return fmt::format("({:.9g}, {:.9g}, {:.9g})", v.x, v.y, v.z);
}

/// Corners as the files' users know them: both included.
std::string Show(const Box3& box) {
  return fmt::format("({}, {}, {}) to ({}, {}, {})", box.lo.x, box.lo.y, box.lo.z, box.hi.x - 1,
                     box.hi.y - 1, box.hi.z - 1);
}

/// A grid in the first file where it has voxels: only there does its transform mean anything.
struct Witness {
  const ScannedFile* file = nullptr;
  const GridInfo* grid = nullptr;
};

Witness FirstWithVoxels(const std::string& name, const std::vector<ScannedFile>& files) {
  for (const ScannedFile& file : files) {
    const GridInfo* grid = FindGrid(file, name);
    if (grid != nullptr && grid->problem.empty() && !grid->box.IsEmpty()) {
      return {&file, grid};
    }
  }
  return {};
}

/// The grid whose transform the others must share: density, else the first that has voxels.
Witness Reference(const GridChoice& choice, const std::vector<ScannedFile>& files) {
  Witness first;
  for (const ChosenGrid& chosen : choice.grids) {
    const Witness witness = FirstWithVoxels(chosen.grid, files);
    if (witness.grid != nullptr && chosen.field == "density") {
      return witness;
    }
    if (first.grid == nullptr) {
      first = witness;
    }
  }
  return first;
}

Status DiffersError(const ScannedFile& file, const GridInfo& grid, const Witness& reference,
                    const std::string& difference) {
  return InvalidArgument(
      "{}: grid '{}' does not lie as grid '{}' of '{}': {}; a dataset has one transform (choose "
      "grids that share it with --grid, or say --registration index to keep voxels as they are "
      "numbered, or --registration world to resample them)",
      file.file.path, Printable(grid.name), Printable(reference.grid->name),
      reference.file->file.path, difference);
}

class Planner {
 public:
  Planner(const IngestOptions& options, const std::vector<ScannedFile>& files,
          const std::optional<ExistingStore>& existing)
      : options_(options), files_(files), existing_(existing) {}

  StatusOr<SeriesPlan> Run() {
    FOVEA_RETURN_IF_ERROR(CheckKinds());
    FOVEA_RETURN_IF_ERROR(Choose());
    FOVEA_RETURN_IF_ERROR(Align());
    FOVEA_RETURN_IF_ERROR(FindExtent());
    FOVEA_RETURN_IF_ERROR(Place());
    FOVEA_RETURN_IF_ERROR(MakeSteps());
    NoteMissingFiles(options_.on_missing, files_, &plan_);
    FOVEA_RETURN_IF_ERROR(SetStepTimes(options_, files_, existing_, &plan_));
    for (const ChosenGrid& chosen : choice_.grids) {
      plan_.fields.push_back(chosen.field);
      DescribeValues(chosen);
    }
    for (const ScannedFile& file : files_) {
      plan_.file_sets.push_back(file.file.Paths());
    }
    plan_.warnings.insert(plan_.warnings.begin(), choice_.warnings.begin(), choice_.warnings.end());
    return std::move(plan_);
  }

 private:
  Status CheckKinds();
  Status Choose();
  Status ChooseForAppend();
  Status Align();
  Status LeaveOutWhatLiesOtherwise();
  Status Register(const ScannedFile& file, const GridInfo& grid);
  [[nodiscard]] Box3 BoxOf(const GridInfo& grid) const;
  Status FindExtent();
  Status CheckExtentSize(const Box3& extent) const;
  Status UseAskedExtent();
  Status Place();
  Status SetSpacing(const Vec3& spacing);
  Status MakeSteps();
  Status MakeStep(size_t file_set, int64_t step_in_file);
  void DescribeValues(const ChosenGrid& chosen);
  void WarnOfEmptySteps();

  const IngestOptions& options_;
  const std::vector<ScannedFile>& files_;
  const std::optional<ExistingStore>& existing_;
  GridChoice choice_;
  bool is_dense_ = false;
  Witness reference_;
  Matrix4 lattice_;  // where the voxels of all grids are to lie, from a voxel's centre
  int64_t moved_grids_ = 0;
  std::string first_move_;
  SeriesPlan plan_;
  std::vector<int64_t> empty_steps_;  // by field
};

/// Dense files have one grid without a name, and are all of one size.
Status Planner::CheckKinds() {
  is_dense_ = !files_.empty() && files_.front().info.is_dense;
  for (const ScannedFile& file : files_) {
    const ScannedFile& first = files_.front();
    if (file.info.is_dense != is_dense_) {
      return InvalidArgument("'{}' and '{}' are of different kinds: a series is of one",
                             first.file.path, file.file.path);
    }
    if (is_dense_ && (file.grids.size() != 1 || !file.grids[0].name.empty())) {
      return Internal("{}: malformed message: {} grids of a dense file", file.file.path,
                      file.grids.size());
    }
    if (is_dense_ && file.grids[0].box != first.grids[0].box) {
      const Int3 a = first.grids[0].box.Size();
      const Int3 b = file.grids[0].box.Size();
      return InvalidArgument(
          "{}: has {} x {} x {} voxels, but '{}' has {} x {} x {}: the steps of a series are of "
          "one size",
          file.file.path, b.x, b.y, b.z, first.file.path, a.x, a.y, a.z);
    }
    for (const std::string& warning : file.info.warnings) {
      plan_.warnings.push_back(warning);
    }
  }
  return absl::OkStatus();
}

/// What the files say of a field's values.
void Planner::DescribeValues(const ChosenGrid& chosen) {
  std::string type;
  std::string unit;
  for (const ScannedFile& file : files_) {
    const GridInfo* grid = FindGrid(file, chosen.grid);
    if (grid == nullptr || !grid->problem.empty()) {
      continue;
    }
    type = type.empty() || type == grid->type ? grid->type : "mixed";
    unit = unit.empty() ? grid->value_unit : unit;
  }
  plan_.source_types.push_back(type);
  plan_.value_units.push_back(unit);
}

Status Planner::Choose() {
  if (is_dense_) {
    choice_.grids = {{"", options_.field}};
    if (FieldNameOf(options_.field) != options_.field) {
      return InvalidArgument("field name '{}': use letters, digits, '_', '.' and '-'",
                             Printable(options_.field));
    }
  } else if (!existing_ || !options_.grids.empty()) {
    FOVEA_ASSIGN_OR_RETURN(choice_, ChooseGrids(options_.grids, files_));
  } else {
    std::vector<std::string> wanted;
    for (const store::FieldInfo& field : existing_->info.fields) {
      wanted.push_back(field.name);
    }
    FOVEA_ASSIGN_OR_RETURN(choice_, ChooseGrids(wanted, files_));
  }
  if (existing_) {
    FOVEA_RETURN_IF_ERROR(ChooseForAppend());
  }
  return absl::OkStatus();
}

/// The same fields as the store has, in its order.
Status Planner::ChooseForAppend() {
  std::vector<ChosenGrid> ordered;
  std::vector<std::string> names;
  for (const store::FieldInfo& field : existing_->info.fields) {
    names.push_back(field.name);
    for (const ChosenGrid& chosen : choice_.grids) {
      if (chosen.field == field.name) {
        ordered.push_back(chosen);
      }
    }
  }
  if (ordered.size() != names.size() || ordered.size() != choice_.grids.size()) {
    return InvalidArgument("'{}' has the fields {}: a step that is added needs just these",
                           options_.output, absl::StrJoin(names, ", "));
  }
  choice_.grids = std::move(ordered);
  return absl::OkStatus();
}

/// All grids of all steps come to share one transform: that of the store, or of the reference.
Status Planner::Align() {
  reference_ = Reference(choice_, files_);
  if (reference_.grid == nullptr) {
    if (existing_) {
      return absl::OkStatus();  // steps of pure background
    }
    return InvalidArgument("no step of the series has a voxel in any grid that was chosen");
  }
  lattice_ = reference_.grid->index_to_world;
  if (existing_ && options_.registration != Registration::kSame) {
    const Int3& origin = existing_->info.origin;
    lattice_ = Moved(existing_->info.index_to_world,
                     {0.5 - static_cast<double>(origin.x), 0.5 - static_cast<double>(origin.y),
                      0.5 - static_cast<double>(origin.z)});
  }
  if (options_.registration == Registration::kWorld) {
    if (is_dense_) {
      return InvalidArgument(
          "--registration world resamples VDB grids only; resample these files, or say "
          "--registration index");
    }
    plan_.lattice = lattice_;
  }
  FOVEA_RETURN_IF_ERROR(LeaveOutWhatLiesOtherwise());
  for (const ScannedFile& file : files_) {
    for (const ChosenGrid& chosen : choice_.grids) {
      const GridInfo* grid = FindGrid(file, chosen.grid);
      if (grid != nullptr && grid->problem.empty() && !grid->box.IsEmpty()) {
        FOVEA_RETURN_IF_ERROR(Register(file, *grid));
      }
    }
  }
  if (moved_grids_ > 0) {
    choice_.warnings.push_back(fmt::format(
        "{} grids do not lie as the first, and {}: {}", moved_grids_,
        plan_.lattice ? "were brought to its voxels" : "keep their voxels as they are numbered",
        first_move_));
  }
  return absl::OkStatus();
}

/// Where nothing was asked for, grids that lie otherwise from the start (such as those of a coarser
/// simulation) are left out with a warning.
Status Planner::LeaveOutWhatLiesOtherwise() {
  if (!options_.grids.empty() || is_dense_ || existing_ ||
      options_.registration != Registration::kSame) {
    return absl::OkStatus();
  }
  std::vector<ChosenGrid> kept;
  for (const ChosenGrid& chosen : choice_.grids) {
    const Witness first = FirstWithVoxels(chosen.grid, files_);
    const std::string difference =
        first.grid == nullptr ? std::string() : Difference(lattice_, first.grid->index_to_world);
    if (difference.empty()) {
      kept.push_back(chosen);
    } else {
      choice_.warnings.push_back(
          fmt::format("grid '{}' is left out: it does not lie as '{}' ({}); --registration index "
                      "or world would take it",
                      Printable(chosen.grid), Printable(reference_.grid->name), difference));
    }
  }
  choice_.grids = std::move(kept);
  return absl::OkStatus();
}

/// What to do about a grid that may lie otherwise.
Status Planner::Register(const ScannedFile& file, const GridInfo& grid) {
  const std::string difference = Difference(lattice_, grid.index_to_world);
  if (difference.empty()) {
    return absl::OkStatus();
  }
  if (options_.registration == Registration::kSame) {
    return DiffersError(file, grid, reference_, difference);
  }
  if (moved_grids_++ == 0) {
    first_move_ = fmt::format("{} (first in '{}')", difference, file.file.path);
  }
  return absl::OkStatus();
}

/// The box of a grid's voxels where they are going to lie.
Box3 Planner::BoxOf(const GridInfo& grid) const {
  return plan_.lattice ? BoxOnLattice(grid.box, grid.index_to_world, *plan_.lattice) : grid.box;
}

Status Planner::FindExtent() {
  Box3 extent;
  if (existing_) {
    const Int3& origin = existing_->info.origin;
    const Int3& dims = existing_->info.hierarchy.dims();
    extent = {origin, {origin.x + dims.x, origin.y + dims.y, origin.z + dims.z}};
    const Box3 box = is_dense_ ? files_.front().grids[0].box : extent;
    if (extent != box) {
      return InvalidArgument("{}: '{}' covers {}, not the {} x {} x {} voxels of this file",
                             files_.front().file.path, options_.output, Show(extent), box.hi.x,
                             box.hi.y, box.hi.z);
    }
  }
  for (const ScannedFile& file : files_) {
    for (const ChosenGrid& chosen : choice_.grids) {
      const GridInfo* grid = FindGrid(file, chosen.grid);
      if (grid == nullptr || !grid->problem.empty()) {
        continue;
      }
      plan_.declared_bytes = std::max(plan_.declared_bytes, grid->declared_bytes);
      if (existing_) {
        if (!extent.Contains(BoxOf(*grid))) {
          return InvalidArgument(
              "{}: grid '{}' reaches from {}, outside the box of '{}', {}: a dataset keeps the "
              "extent that it began with; ingest the whole series anew, or begin with --extent",
              file.file.path, Printable(grid->name), Show(BoxOf(*grid)), options_.output,
              Show(extent));
        }
      } else {
        extent = Union(extent, BoxOf(*grid));
        FOVEA_RETURN_IF_ERROR(
            Annotate(CheckExtentSize(extent),
                     fmt::format("{}: grid '{}'", file.file.path, Printable(grid->name))));
      }
    }
    if (plan_.world_unit.empty()) {
      plan_.world_unit = file.info.world_unit;
    }
  }
  plan_.extent = extent;
  return existing_ || !options_.extent ? absl::OkStatus() : UseAskedExtent();
}

Status Planner::UseAskedExtent() {
  const Box3& asked = *options_.extent;
  constexpr int64_t kFarthest = int64_t{1} << 31;
  for (int axis = 0; axis < 3; ++axis) {
    if (asked.lo[axis] < -kFarthest || asked.hi[axis] > kFarthest ||
        asked.lo[axis] >= asked.hi[axis]) {
      return InvalidArgument("--extent {}: nothing is in it, or it reaches past 2^31", Show(asked));
    }
  }
  if (is_dense_ && asked != plan_.extent) {
    return InvalidArgument("--extent {}: the files hold {}, all of it", Show(asked),
                           Show(plan_.extent));
  }
  for (const ScannedFile& file : files_) {
    for (const ChosenGrid& chosen : choice_.grids) {
      const GridInfo* grid = FindGrid(file, chosen.grid);
      if (grid != nullptr && grid->problem.empty() && !asked.Contains(BoxOf(*grid))) {
        return InvalidArgument("{}: grid '{}' reaches from {}, outside --extent, {}",
                               file.file.path, Printable(grid->name), Show(BoxOf(*grid)),
                               Show(asked));
      }
    }
  }
  plan_.extent = asked;
  return Annotate(CheckExtentSize(asked), "--extent");
}

Status Planner::CheckExtentSize(const Box3& extent) const {
  if (extent.Size().Max() > kMaxDimension) {
    return OutOfRange(
        "with it the active voxels of the series reach from {}: over {} voxels on an axis; clip or "
        "resample the grid",
        Show(extent), kMaxDimension);
  }
  return absl::OkStatus();
}

/// Voxels of that size, whatever the files say; where the first begins and how the axes lie stays.
Status Planner::SetSpacing(const Vec3& spacing) {
  const Vec3 said = plan_.index_to_world.Spacing();
  for (int axis = 0; axis < 3; ++axis) {
    if (!std::isfinite(spacing[axis]) || spacing[axis] <= 0) {
      return InvalidArgument("spacing {}: voxel sizes must be positive", Show(spacing));
    }
    for (int row = 0; row < 3; ++row) {
      plan_.index_to_world.m[static_cast<size_t>(4 * row + axis)] *= spacing[axis] / said[axis];
    }
  }
  return absl::OkStatus();
}

/// The matrix from our voxel coordinates. A file's index is the centre of a voxel.
Status Planner::Place() {
  if (existing_ && reference_.grid == nullptr) {
    plan_.index_to_world = existing_->info.index_to_world;
    return absl::OkStatus();
  }
  const Int3& lo = plan_.extent.lo;
  plan_.index_to_world =
      Moved(lattice_, {static_cast<double>(lo.x) - 0.5, static_cast<double>(lo.y) - 0.5,
                       static_cast<double>(lo.z) - 0.5});
  if (options_.spacing && is_dense_) {
    FOVEA_RETURN_IF_ERROR(SetSpacing(*options_.spacing));
  }
  if (existing_) {
    const std::string difference = Difference(existing_->info.index_to_world, plan_.index_to_world);
    if (!difference.empty()) {
      return InvalidArgument(
          "the new steps do not lie as those of '{}': {} (--registration index or world would take "
          "them)",
          options_.output, difference);
    }
  }
  return absl::OkStatus();
}

Status Planner::MakeSteps() {
  empty_steps_.assign(choice_.grids.size(), 0);
  constexpr size_t kMaxSteps = 1'000'000;
  for (size_t set = 0; set < files_.size(); ++set) {
    for (int64_t i = 0; i < files_[set].info.steps; ++i) {
      FOVEA_RETURN_IF_ERROR(MakeStep(set, i));
    }
    if (plan_.steps.size() > kMaxSteps) {
      return InvalidArgument("{}: with it the series has over {} steps", files_[set].file.path,
                             kMaxSteps);
    }
  }
  if (plan_.steps.empty()) {
    return InvalidArgument("no file of the series has all of the wanted grids");
  }
  WarnOfEmptySteps();
  return absl::OkStatus();
}

Status Planner::MakeStep(size_t file_set, int64_t step_in_file) {
  const ScannedFile& file = files_[file_set];
  PlannedStep step;
  step.frame_number = file.info.steps == 1 ? file.file.frame_number : std::nullopt;
  std::vector<bool> is_empty;
  bool is_held = file.file.held;
  for (size_t i = 0; i < choice_.grids.size(); ++i) {
    const std::string& name = choice_.grids[i].grid;
    const GridInfo* grid = FindGrid(file, name);
    if (grid != nullptr && !grid->problem.empty()) {
      return InvalidArgument("{}: grid '{}' cannot be read in this step: {}", file.file.path,
                             Printable(name), grid->problem);
    }
    is_empty.push_back(grid != nullptr && grid->box.IsEmpty());
    if (grid != nullptr) {
      step.sources.push_back({file.file.path, grid->name, step_in_file, file_set});
    } else if (options_.on_missing == OnMissing::kSkip) {
      ++plan_.skipped_steps;
      plan_.warnings.push_back(
          fmt::format("'{}' is left out: it has no grid '{}'", file.file.path, Printable(name)));
      return absl::OkStatus();
    } else if (options_.on_missing == OnMissing::kHold && !plan_.steps.empty()) {
      plan_.warnings.push_back(
          fmt::format("'{}' has no grid '{}': that of the step before stands in", file.file.path,
                      Printable(name)));
      step.sources.push_back(plan_.steps.back().sources[i]);
      is_held = true;
    } else {
      return NotFound(
          "{}: there is no grid '{}'{} (choose grids with --grid, or leave the step out with "
          "--on-missing skip)",
          file.file.path, Printable(name),
          options_.on_missing == OnMissing::kHold ? ", and no step before it to hold" : "");
    }
  }
  for (size_t i = 0; i < is_empty.size(); ++i) {
    empty_steps_[i] += is_empty[i] ? 1 : 0;
  }
  plan_.held_steps += is_held ? 1 : 0;
  plan_.steps.push_back(std::move(step));
  return absl::OkStatus();
}

void Planner::WarnOfEmptySteps() {
  for (size_t i = 0; i < choice_.grids.size(); ++i) {
    if (empty_steps_[i] > 0) {
      plan_.warnings.push_back(fmt::format("grid '{}' is empty (all background) in {} of {} steps",
                                           Printable(choice_.grids[i].grid), empty_steps_[i],
                                           plan_.steps.size()));
    }
  }
}

}  // namespace

StatusOr<SeriesPlan> PlanSeries(const IngestOptions& options, const std::vector<ScannedFile>& files,
                                const std::optional<ExistingStore>& existing) {
  return Planner(options, files, existing).Run();
}

}  // namespace fovea::ingest
