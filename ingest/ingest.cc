#include "ingest/ingest.h"

#include <algorithm>
#include <filesystem>
#include <memory>
#include <optional>
#include <system_error>
#include <thread>
#include <utility>

#include "engine/base/parallel.h"
#include "engine/base/stopwatch.h"
#include "engine/store/dataset_writer.h"
#include "engine/store/file.h"
#include "engine/store/merge.h"
#include "engine/store/metadata.h"
#include "engine/store/removal.h"
#include "engine/store/retention.h"
#include "ingest/field_stream.h"
#include "ingest/given.h"
#include "ingest/ingest_checks.h"
#include "ingest/odd_values.h"
#include "ingest/quantised_step.h"
#include "ingest/sequence.h"
#include "ingest/series_plan.h"
#include "ingest/sparse_fields.h"
#include "ingest/step_reader.h"

namespace fovea::ingest {
namespace {

namespace fs = std::filesystem;
/// Steps that are done within this are committed together.
constexpr double kPublishMs = 100;

using ProgressCallback = std::function<bool(const IngestProgress&)>;

/// One attempt at a whole series.
class Run {
 public:
  Run(const IngestOptions& options, const Given& given, const ProgressCallback& progress)
      : options_(options), given_(given), progress_(progress) {}

  /// Scans, plans, and carries the plan out.
  [[nodiscard]] Status Execute(bool from_voxels);

  /// Execute failed because a file's metadata announced too small a box: worth another run with
  /// from_voxels, after Discard.
  [[nodiscard]] bool metadata_was_wrong() const { return metadata_was_wrong_; }
  /// Removes the store that this run made, if it made one.
  void Discard();
  [[nodiscard]] IngestReport TakeReport();

  /// The first pass alone.
  [[nodiscard]] StatusOr<PlannedSeries> PlanOnly();

 private:
  Status ChooseBasis();
  Status OpenExisting(std::optional<ExistingStore>* existing);
  Status Plan(bool from_voxels);
  Status FindFiles();
  /// Leaves of the plan what is to be made now: of the part that was asked for what an earlier run
  /// has not made.
  Status TakeUp(bool from_voxels);
  Status GoOnWithStore(bool from_voxels);
  [[nodiscard]] store::DatasetInfo NewInfo() const;
  Status ScanAndPlan(const std::optional<ExistingStore>& existing, bool from_voxels);
  Status WriteSteps(bool from_voxels);
  Status WriteStep(const PlannedStep& step, StepReader* reader);
  StatusOr<std::unique_ptr<FieldStream>> StartField(size_t field);
  Status TakeSparse(const PlannedStep& step, SparseField sparse, SparseFields* fields,
                    QuantisedStep* quantised);
  Status WriteSparse(SparseFields* waiting);
  Status WriteQuantised(QuantisedStep* step);
  Status NeedStore();
  Status PublishSteps();
  [[nodiscard]] bool GoOn(int64_t done, int64_t total, const std::string& now) const {
    return progress_ == nullptr || progress_({done, total, now});
  }

  [[nodiscard]] bool is_quantised() const {
    const auto has_scales = [](const store::FieldInfo& field) { return !field.scales.empty(); };
    return options_.tolerance || std::any_of(codings_.begin(), codings_.end(), has_scales);
  }

  const IngestOptions& options_;
  const Given& given_;
  const ProgressCallback& progress_;
  std::vector<SequenceFile> files_;
  std::vector<ScannedFile> scanned_;
  Workers workers_;
  std::optional<store::SourceInfo> source_;
  SeriesPlan plan_;
  Hierarchy hierarchy_;
  Basis basis_;
  std::string stored_type_ = "float32";
  /// How each field is stored; with a tolerance, from its first step on.
  std::vector<store::FieldInfo> codings_;
  std::unique_ptr<store::DatasetWriter> writer_;
  bool made_store_ = false;
  Stopwatch since_published_;
  int64_t published_steps_ = 0;
  bool metadata_was_wrong_ = false;
  IngestReport report_;
  OddValues odd_;
};

Status Run::Execute(bool from_voxels) {
  FOVEA_RETURN_IF_ERROR(Plan(from_voxels));
  FOVEA_RETURN_IF_ERROR(TakeUp(from_voxels));
  report_.input_bytes = InputBytes(scanned_, plan_);
  Status status = WriteSteps(from_voxels);
  if (writer_ != nullptr && !metadata_was_wrong_) {  // what is done stays, whatever happened
    const Status published = PublishSteps();
    status = status.ok() ? published : status;
  }
  if (status.ok() || metadata_was_wrong_) {
    return status;
  }
  if (report_.steps == 0) {
    Discard();
    return status;
  }
  return MakeStatus(
      status.code(),
      fmt::format("{} (what was done before stays: {} {} in '{}')", MessageOf(status),
                  report_.steps, report_.steps == 1 ? "step" : "steps", options_.output));
}

/// What coefficients to make: as asked, or as the store that is appended to has them.
Status Run::ChooseBasis() {
  basis_ = {options_.wavelet.value_or(Wavelet::kHaar), options_.lossless};
  if (writer_ != nullptr) {
    const store::DatasetInfo& info = writer_->info();
    FOVEA_ASSIGN_OR_RETURN(basis_.wavelet, ParseWavelet(info.wavelet));
    if (options_.wavelet.value_or(basis_.wavelet) != basis_.wavelet) {
      return InvalidArgument("'{}' holds coefficients of the wavelet {}: {} cannot be added to it",
                             options_.output, info.wavelet, WaveletName(*options_.wavelet));
    }
    stored_type_ = info.fields.front().type;
    codings_ = info.fields;
    basis_.integer = stored_type_ != "float32" && !is_quantised();
    if (options_.lossless && !basis_.integer) {
      return InvalidArgument("'{}' holds {} coefficients: lossless ones cannot be added to it",
                             options_.output, is_quantised() ? "quantised" : "float32");
    }
  }
  if (!basis_.integer) {
    return absl::OkStatus();
  }
  FOVEA_ASSIGN_OR_RETURN(const std::string needed, LosslessType(plan_.source_types));
  if (writer_ == nullptr) {
    stored_type_ = needed;
  } else if (stored_type_ == "int16" && needed != "int16") {
    return InvalidArgument("'{}' holds int16 coefficients: voxels of 16 bits do not fit",
                           options_.output);
  }
  return absl::OkStatus();
}

Status Run::OpenExisting(std::optional<ExistingStore>* existing) {
  FOVEA_ASSIGN_OR_RETURN(writer_, store::DatasetWriter::Append(options_.output));
  existing->emplace();
  (*existing)->info = writer_->info();
  const int64_t steps = writer_->info().committed_steps;
  if (steps > 0) {
    FOVEA_ASSIGN_OR_RETURN(const auto dataset, store::Dataset::Open(options_.output));
    FOVEA_ASSIGN_OR_RETURN((*existing)->last_time_ns, dataset->TimeNs(steps - 1));
  }
  return absl::OkStatus();
}

Status Run::FindFiles() {
  files_ = given_.files;
  if (files_.empty() && given_.scanned.empty()) {
    FOVEA_ASSIGN_OR_RETURN(files_, ResolveInputs(options_.inputs, options_.on_missing));
  }
  return absl::OkStatus();
}

Status Run::ScanAndPlan(const std::optional<ExistingStore>& existing, bool from_voxels) {
  const auto total = static_cast<int64_t>(files_.size());
  scanned_ = given_.scanned;
  if (scanned_.empty()) {
    FOVEA_ASSIGN_OR_RETURN(
        scanned_, ScanFiles(
                      options_, files_, from_voxels,
                      [&](const std::string& path) { return GoOn(0, total, path); }, &workers_));
  }
  FOVEA_ASSIGN_OR_RETURN(plan_, PlanSeries(options_, scanned_, existing));
  return absl::OkStatus();
}

Status Run::Plan(bool from_voxels) {
  std::optional<ExistingStore> existing;
  if (options_.append) {
    FOVEA_RETURN_IF_ERROR(OpenExisting(&existing));
  }
  FOVEA_RETURN_IF_ERROR(FindFiles());
  Status status = ScanAndPlan(existing, from_voxels);
  if (absl::IsOutOfRange(status) && !from_voxels && !options_.raw && given_.scanned.empty()) {
    // Too large a box may be the metadata's fault.
    const std::string reason(MessageOf(status));
    status = ScanAndPlan(existing, /*from_voxels=*/true);
    plan_.warnings.push_back(
        fmt::format("{}, says the metadata; not so the voxels, which were believed", reason));
  }
  FOVEA_RETURN_IF_ERROR(status);
  FOVEA_RETURN_IF_ERROR(ChooseBasis());
  FOVEA_ASSIGN_OR_RETURN(hierarchy_, Hierarchy::Make(plan_.extent.Size()));
  report_.dims = plan_.extent.Size();
  report_.origin = plan_.extent.lo;
  report_.fields = plan_.fields;
  report_.warnings = plan_.warnings;
  report_.steps_held = plan_.held_steps;
  report_.steps_skipped = plan_.skipped_steps;
  odd_ = OddValues(plan_.fields);
  return absl::OkStatus();
}

StatusOr<PlannedSeries> Run::PlanOnly() {
  FOVEA_RETURN_IF_ERROR(Plan(/*from_voxels=*/false));
  std::string series = SeriesIdentity(scanned_, plan_);
  return PlannedSeries{std::move(scanned_), std::move(plan_), std::move(series)};
}

Status Run::TakeUp(bool from_voxels) {
  if (options_.append) {
    return absl::OkStatus();
  }
  const auto steps = static_cast<int64_t>(plan_.steps.size());
  std::string series = SeriesIdentity(scanned_, plan_);
  if (options_.tolerance) {  // the store says what came of it, not what was asked for
    series = IdentityOf(
        fmt::format("{} {} {}", series, options_.tolerance->value, options_.tolerance->relative));
  }
  source_ = given_.open_series.empty() ? store::SourceInfo{series, steps, given_.part, given_.parts}
                                       : store::SourceInfo{given_.open_series, 0, 0, 1};
  if (given_.open_series.empty()) {
    plan_.steps.erase(plan_.steps.begin() + source_->LastStep(), plan_.steps.end());
    plan_.steps.erase(plan_.steps.begin(), plan_.steps.begin() + source_->FirstStep());
  }
  std::error_code error;
  return fs::exists(fs::path(options_.output) / store::kMetadataName, error)
             ? GoOnWithStore(from_voxels)
             : absl::OkStatus();
}

Status Run::GoOnWithStore(bool from_voxels) {
  FOVEA_ASSIGN_OR_RETURN(auto writer, store::DatasetWriter::Append(options_.output));
  const store::DatasetInfo& there = writer->info();
  if (!(there.source == source_)) {
    return IsThere(options_, SeriesDifference(options_, there, *source_, plan_));
  }
  if (options_.tolerance) {
    codings_ = there.fields;  // whose scales its first step chose
  }
  store::DatasetInfo wanted = NewInfo();
  wanted.format_version = there.format_version;  // an older one is gone on with as it is
  std::string difference = store::DifferenceInMaking(there, wanted);
  if (difference == "extent" && !from_voxels && given_.scanned.empty() && !options_.raw) {
    // It may have been begun again then with the boxes found from the voxels.
    writer.reset();
    FOVEA_RETURN_IF_ERROR(Plan(/*from_voxels=*/true));
    return TakeUp(/*from_voxels=*/true);
  }
  if (!difference.empty()) {
    return IsThere(options_, MakingDifference(difference, there, wanted));
  }
  report_.steps_before = std::min(there.committed_steps, std::ssize(plan_.steps));
  plan_.steps.erase(plan_.steps.begin(), plan_.steps.begin() + report_.steps_before);
  writer_ = std::move(writer);
  return absl::OkStatus();
}

Status Run::WriteSteps(bool from_voxels) {
  const auto total = static_cast<int64_t>(plan_.steps.size());
  StepReader reader(options_, plan_, std::move(workers_));
  for (const PlannedStep& step : plan_.steps) {
    if (!GoOn(report_.steps, total, step.sources.front().path)) {
      return Cancelled("stopped as asked, after {} of {} steps", report_.steps, total);
    }
    Status status = WriteStep(step, &reader);
    if (metadata_was_wrong_) {
      metadata_was_wrong_ = !from_voxels && !options_.append;
    }
    FOVEA_RETURN_IF_ERROR(status);
  }
  static_cast<void>(GoOn(report_.steps, total, ""));
  return NeedStore();  // a part without steps
}

Status Run::WriteStep(const PlannedStep& step, StepReader* reader) {
  std::unique_ptr<FieldStream> stream;  // of the field in hand
  SparseFields waiting(basis_, options_.threads);
  QuantisedStep quantised(plan_.fields, hierarchy_, basis_,
                          writer_ != nullptr ? writer_->info().chunk_edge : options_.chunk_edge,
                          options_.threads);
  for (bool has_ended = false; !has_ended;) {
    FOVEA_ASSIGN_OR_RETURN(StepPart part, reader->Next());
    const Stopwatch watch;
    if (auto* sparse = std::get_if<SparseField>(&part)) {
      FOVEA_RETURN_IF_ERROR(
          TakeSparse(step, std::move(*sparse), &waiting, is_quantised() ? &quantised : nullptr));
    } else if (auto* piece = std::get_if<DensePiece>(&part)) {
      if (is_quantised()) {
        quantised.Add(*piece);
        continue;
      }
      if (stream == nullptr) {
        FOVEA_ASSIGN_OR_RETURN(stream, StartField(piece->field));
      }
      FOVEA_RETURN_IF_ERROR(
          Annotate(stream->Push(std::move(piece->slices)), step.sources[piece->field].path));
    } else if (const auto* end = std::get_if<DenseEnd>(&part)) {
      odd_.Count(end->field, step.sources[end->field].path, end->nonfinite, end->rounded);
      if (stream != nullptr) {
        FOVEA_RETURN_IF_ERROR(stream->Finish(end->stats));
        stream.reset();
      }
    } else {
      report_.read_ms += std::get<StepEnd>(part).read_ms;
      FOVEA_RETURN_IF_ERROR(WriteSparse(&waiting));
      has_ended = true;
    }
    report_.transform_ms += watch.ElapsedMs();
  }
  const Stopwatch watch;
  if (is_quantised()) {
    FOVEA_RETURN_IF_ERROR(WriteQuantised(&quantised));
  }
  FOVEA_RETURN_IF_ERROR(writer_->EndStep(step.time_ns, step.frame_number));
  ++report_.steps;
  report_.write_ms += watch.ElapsedMs();
  return since_published_.ElapsedMs() < kPublishMs ? absl::OkStatus() : PublishSteps();
}

/// A commit costs much the same for one step as for many: fast ones go together.
Status Run::PublishSteps() {
  const Stopwatch watch;
  const int64_t before = writer_->info().committed_steps;
  const Status status = writer_->Publish();
  published_steps_ += writer_->info().committed_steps - before;
  report_.steps = published_steps_;
  report_.write_ms += watch.ElapsedMs();
  since_published_.RestartMs();
  return status;
}

StatusOr<std::unique_ptr<FieldStream>> Run::StartField(size_t field) {
  FOVEA_RETURN_IF_ERROR(NeedStore());
  return FieldStream::Start(writer_.get(), plan_.fields[field], basis_, 0, options_.threads);
}

/// The fields of a step; the first one says how all are stored.
Status Run::WriteQuantised(QuantisedStep* step) {
  if (writer_ == nullptr) {
    FOVEA_ASSIGN_OR_RETURN(codings_, step->ChooseCodings(*options_.tolerance));
    WarnOfExact(codings_, &report_.warnings);
    FOVEA_RETURN_IF_ERROR(NeedStore());
  }
  return step->Write(writer_.get());
}

/// To `waiting`, and into the store once much waits; or to `quantised`.
Status Run::TakeSparse(const PlannedStep& step, SparseField sparse, SparseFields* waiting,
                       QuantisedStep* quantised) {
  if (!sparse.outside.empty()) {
    metadata_was_wrong_ = true;
    return DataLoss(
        "{} has active voxels outside the box that its metadata (file_bbox_min, file_bbox_max) "
        "announces; write the file again with OpenVDB",
        sparse.outside);
  }
  odd_.Count(sparse.field, step.sources[sparse.field].path, sparse.voxels.nonfinite,
             sparse.voxels.rounded);
  if (quantised != nullptr) {
    quantised->Add(sparse.field, std::move(sparse.voxels.voxels));
    return absl::OkStatus();
  }
  waiting->Add(plan_.fields[sparse.field], std::move(sparse.voxels.voxels));
  return waiting->IsFull() ? WriteSparse(waiting) : absl::OkStatus();
}

Status Run::WriteSparse(SparseFields* waiting) {
  FOVEA_RETURN_IF_ERROR(waiting->empty() ? absl::OkStatus() : NeedStore());
  return waiting->Write(writer_.get());
}

store::DatasetInfo Run::NewInfo() const {
  store::DatasetInfo info;
  info.source = source_;
  info.retention = store::InVoxels(options_.retain, plan_.index_to_world);
  info.hierarchy = hierarchy_;
  info.wavelet = WaveletName(basis_.wavelet);
  info.origin = plan_.extent.lo;
  info.index_to_world = plan_.index_to_world;
  info.world_unit = plan_.world_unit;
  info.chunk_edge = options_.chunk_edge;
  info.default_field = plan_.fields.front();
  for (size_t i = 0; i < plan_.fields.size(); ++i) {
    store::FieldInfo field;
    field.name = plan_.fields[i];
    field.type = stored_type_;
    for (const store::FieldInfo& coding : codings_) {
      field = coding.name == field.name ? coding : field;
    }
    field.value_unit = plan_.value_units[i];
    info.fields.push_back(field);
    if (field.name == "density") {
      info.default_field = field.name;
    }
  }
  std::sort(info.fields.begin(), info.fields.end(),  // as a store lists them
            [](const store::FieldInfo& a, const store::FieldInfo& b) { return a.name < b.name; });
  return info;
}

/// Late, when the first step is ready to be written: a series that fails at once leaves nothing.
Status Run::NeedStore() {
  if (writer_ != nullptr) {
    return absl::OkStatus();
  }
  FOVEA_ASSIGN_OR_RETURN(writer_, store::DatasetWriter::Create(options_.output, NewInfo()));
  made_store_ = true;
  return absl::OkStatus();
}

void Run::Discard() {
  if (made_store_) {
    [[maybe_unused]] const Status removed = store::RemoveHeldStore(options_.output);
    made_store_ = false;
  }
  writer_.reset();
}

IngestReport Run::TakeReport() {
  if (is_quantised() && writer_ != nullptr) {
    for (const std::string& name : plan_.fields) {
      report_.max_errors.push_back(writer_->info().FieldOf(name).max_error);
    }
  }
  report_.nonfinite_values += odd_.NonfiniteValues();
  const std::vector<std::string> warnings = odd_.Warnings();
  report_.warnings.insert(report_.warnings.end(), warnings.begin(), warnings.end());
  return std::move(report_);
}

}  // namespace

StatusOr<IngestReport> Ingest(const IngestOptions& options, const ProgressCallback& progress) {
  return IngestGiven(options, {}, progress);
}

StatusOr<PlannedSeries> PlanIngest(const IngestOptions& options, const ProgressCallback& progress) {
  FOVEA_RETURN_IF_ERROR(CheckCoding(options));
  const Given nothing;
  return Run(options, nothing, progress).PlanOnly();
}

StatusOr<IngestReport> IngestGiven(const IngestOptions& options, const Given& given,
                                   const ProgressCallback& progress) {
  FOVEA_RETURN_IF_ERROR(CheckIngestOptions(options));
  const std::jthread scheduler = StartScheduler();  // while the files are looked through
  Run run(options, given, progress);
  const Status status = run.Execute(/*from_voxels=*/false);
  if (status.ok()) {
    return run.TakeReport();
  }
  if (!run.metadata_was_wrong()) {
    return status;
  }
  if (!given.scanned.empty() || !given.open_series.empty()) {
    return Annotate(status, "the extent was fixed before; choose one that holds it (--extent)");
  }
  // Steps may have been committed with too small an extent; they are made anew with the right one.
  run.Discard();
  Run again(options, given, progress);
  FOVEA_RETURN_IF_ERROR(again.Execute(/*from_voxels=*/true));
  IngestReport report = again.TakeReport();
  report.warnings.push_back(fmt::format(
      "{}; the series was begun again with the boxes found from the voxels", MessageOf(status)));
  return report;
}

}  // namespace fovea::ingest
