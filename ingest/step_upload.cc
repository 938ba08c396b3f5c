#include "ingest/step_upload.h"

#include <algorithm>
#include <filesystem>
#include <system_error>
#include <utility>

#include <absl/strings/str_join.h>

#include "engine/store/metadata.h"
#include "engine/store/removal.h"
#include "engine/store/stored_type.h"
#include "ingest/ingest_checks.h"

namespace fovea::ingest {
namespace {

constexpr int64_t kChunkEdge = 16;

std::string_view NameOf(DenseType type) {
  switch (type) {
    case DenseType::kUint8:
      return "uint8";
    case DenseType::kInt8:
      return "int8";
    case DenseType::kUint16:
      return "uint16";
    case DenseType::kInt16:
      return "int16";
    case DenseType::kFloat32:
      break;
  }
  return "float32";
}

int64_t EdgeOf(const UploadPlan& plan) {
  return plan.chunk_edge.value_or(kChunkEdge);
}

Status Differs(const std::string& path, std::string_view what, const std::string& there,
               const std::string& asked) {
  return FailedPrecondition("{} is there, and its {} is {}, not {}", path, what, there, asked);
}

std::string Show(const Int3& dims) {
  return fmt::format("{} x {} x {}", dims.x, dims.y, dims.z);
}

}  // namespace

int64_t BytesOf(const UploadPlan& plan, size_t field) {
  return plan.dims.Product() * BytesOf(plan.fields[field].type);
}

int64_t StepUpload::WorkingBytes(const UploadPlan& plan) {
  constexpr int64_t kOther = int64_t{4} << 20;  // encoders, tables
  int64_t value_bytes = 1;
  for (const UploadField& field : plan.fields) {
    value_bytes = std::max(value_bytes, BytesOf(field.type));
  }
  // Voxels: the piece that is being filled and those that the transform still reads. Coefficients:
  // the layers of each level that wait for their neighbours, a quarter as many a level as of the
  // one before.
  const int64_t slice = plan.dims.x * plan.dims.y;
  const int64_t slices = std::min(2 * EdgeOf(plan), plan.dims.z);
  return slice * slices * (3 * value_bytes + 4) + kOther;
}

StatusOr<std::unique_ptr<StepUpload>> StepUpload::Open(const std::string& path,
                                                       const UploadPlan& plan, int threads) {
  FOVEA_RETURN_IF_ERROR(Hierarchy::Make(plan.dims).status());
  auto upload = std::unique_ptr<StepUpload>(new StepUpload(path, plan, threads));
  FOVEA_RETURN_IF_ERROR(upload->OpenStore());
  FOVEA_RETURN_IF_ERROR(upload->CheckStep());
  if (!upload->committed()) {
    FOVEA_RETURN_IF_ERROR(upload->StartField());
  }
  return upload;
}

StepUpload::~StepUpload() {
  stream_.reset();
  if (made_store_ && committed_steps() == 0) {
    // What cannot be removed has no step, and harms nobody.
    [[maybe_unused]] const Status removed = store::RemoveHeldStore(path_);
  }
}

Status StepUpload::OpenStore() {
  std::error_code error;
  if (!std::filesystem::exists(std::filesystem::path(path_) / store::kMetadataName, error)) {
    const Status created = Create();
    if (!absl::IsAlreadyExists(created)) {
      return created;
    }
    // Another made it just now: go on with that.
  }
  FOVEA_ASSIGN_OR_RETURN(writer_, store::DatasetWriter::Append(path_));
  return CheckStore();
}

/// As ingest makes it of files (Run::NewInfo).
Status StepUpload::Create() {
  basis_ = {plan_.wavelet.value_or(Wavelet::kHaar), plan_.lossless};
  store::DatasetInfo info;
  FOVEA_ASSIGN_OR_RETURN(info.hierarchy, Hierarchy::Make(plan_.dims));
  info.source = plan_.source;
  info.wavelet = WaveletName(basis_.wavelet);
  info.index_to_world = plan_.index_to_world.value_or(Matrix4());
  info.world_unit = plan_.world_unit;
  info.chunk_edge = EdgeOf(plan_);
  info.default_field = plan_.fields.front().name;
  FOVEA_ASSIGN_OR_RETURN(const std::string type, StoredType());
  for (const UploadField& field : plan_.fields) {
    store::FieldInfo stored;
    stored.name = field.name;
    stored.type = type;
    stored.value_unit = field.value_unit;
    info.fields.push_back(stored);
    info.default_field = field.name == "density" ? field.name : info.default_field;
  }
  std::sort(info.fields.begin(), info.fields.end(),  // as a store lists them
            [](const store::FieldInfo& a, const store::FieldInfo& b) { return a.name < b.name; });
  FOVEA_ASSIGN_OR_RETURN(writer_, store::DatasetWriter::Create(path_, info));
  made_store_ = true;
  return absl::OkStatus();
}

StatusOr<std::string> StepUpload::StoredType() const {
  if (!plan_.lossless) {
    return std::string("float32");
  }
  if (plan_.wavelet == Wavelet::kCdf97) {
    return InvalidArgument(
        "lossless: there is no reversible form of cdf97, only of haar and cdf53");
  }
  std::vector<std::string> types;
  for (const UploadField& field : plan_.fields) {
    types.emplace_back(NameOf(field.type));
  }
  return LosslessType(types);
}

/// A store that is there must be what the plan says.
Status StepUpload::CheckStore() const {
  const store::DatasetInfo& info = writer_->info();
  if (info.hierarchy.dims() != plan_.dims) {
    return Differs(path_, "size", Show(info.hierarchy.dims()), Show(plan_.dims));
  }
  std::vector<std::string> there, asked;
  for (const store::FieldInfo& field : info.fields) {
    there.push_back(field.name);
  }
  for (const UploadField& field : plan_.fields) {
    asked.push_back(field.name);
  }
  std::sort(asked.begin(), asked.end());
  std::sort(there.begin(), there.end());
  if (there != asked) {
    return Differs(path_, "list of fields", absl::StrJoin(there, ", "), absl::StrJoin(asked, ", "));
  }
  if (plan_.wavelet && WaveletName(*plan_.wavelet) != info.wavelet) {
    return Differs(path_, "wavelet", info.wavelet, std::string(WaveletName(*plan_.wavelet)));
  }
  if (plan_.chunk_edge && *plan_.chunk_edge != info.chunk_edge) {
    return Differs(path_, "chunk edge", std::to_string(info.chunk_edge),
                   std::to_string(*plan_.chunk_edge));
  }
  if (plan_.index_to_world && *plan_.index_to_world != info.index_to_world) {
    return FailedPrecondition(
        "{} is there, and lies otherwise in the world: leave index_to_world "
        "out to take it as it is",
        path_);
  }
  if (plan_.source && plan_.source != info.source) {
    return FailedPrecondition("{} is there, and is not of this series of files", path_);
  }
  return absl::OkStatus();
}

Status StepUpload::CheckStep() const {
  const int64_t there = committed_steps();
  if (plan_.step > there) {
    return FailedPrecondition("step {}: the next step of {} is {}", plan_.step, path_, there);
  }
  if (plan_.step == there) {
    return absl::OkStatus();
  }
  FOVEA_ASSIGN_OR_RETURN(const auto dataset, store::Dataset::Open(path_));
  FOVEA_ASSIGN_OR_RETURN(const int64_t time_ns, dataset->TimeNs(plan_.step));
  FOVEA_ASSIGN_OR_RETURN(const auto frame_number, dataset->FrameNumber(plan_.step));
  if (time_ns != plan_.time_ns || frame_number != plan_.frame_number) {
    return FailedPrecondition(
        "step {} of {} is there, with another time or frame number ({} ns); the next one is {}",
        plan_.step, path_, time_ns, there);
  }
  return absl::OkStatus();
}

Status StepUpload::StartField() {
  const UploadField& field = plan_.fields[field_];
  const store::DatasetInfo& info = writer_->info();
  const store::FieldInfo& stored = info.FieldOf(field.name);
  if (!stored.scales.empty()) {
    return FailedPrecondition(
        "{} holds quantised coefficients (--tolerance), for which a step must "
        "be there as a whole: ingest it from files",
        path_);
  }
  FOVEA_ASSIGN_OR_RETURN(basis_.wavelet, ParseWavelet(info.wavelet));
  basis_.integer = stored.type != "float32";
  if (plan_.lossless && !basis_.integer) {
    return FailedPrecondition("{} holds float32 coefficients: lossless ones cannot be added to it",
                              path_);
  }
  if (basis_.integer) {
    FOVEA_ASSIGN_OR_RETURN(const std::string needed,
                           LosslessType({std::string(NameOf(field.type))}));
    if (stored.type == "int16" && needed != "int16") {
      return FailedPrecondition("{} holds int16 coefficients: voxels of 16 bits do not fit", path_);
    }
  }
  FOVEA_ASSIGN_OR_RETURN(stream_,
                         FieldStream::Start(writer_.get(), field.name, basis_, 0, threads_));
  const Box3 box{{0, 0, 0}, plan_.dims};
  dense_ = std::make_unique<DenseField>(box, 2 * info.chunk_edge, WorkingBytes(plan_));
  return dense_->Begin({0, field.type, box});
}

StepUpload::Awaited StepUpload::awaited() const {
  return {field_, came_, complete() ? 0 : BytesOf(plan_, field_) - came_};
}

Status StepUpload::Add(std::span<const std::byte> bytes) {
  came_ += std::ssize(bytes);
  const auto row_bytes = static_cast<size_t>(plan_.dims.x * BytesOf(plan_.fields[field_].type));
  if (!part_.empty()) {
    const size_t more = std::min(row_bytes - part_.size(), bytes.size());
    part_.insert(part_.end(), bytes.begin(), bytes.begin() + static_cast<int64_t>(more));
    bytes = bytes.subspan(more);
    if (part_.size() == row_bytes) {
      FOVEA_RETURN_IF_ERROR(AddRows(part_));
      part_.clear();
    }
  }
  const size_t whole = bytes.size() / row_bytes * row_bytes;
  FOVEA_RETURN_IF_ERROR(AddRows(bytes.first(whole)));
  part_.insert(part_.end(), bytes.begin() + static_cast<int64_t>(whole), bytes.end());
  return came_ == BytesOf(plan_, field_) ? EndField() : absl::OkStatus();
}

Status StepUpload::AddRows(std::span<const std::byte> bytes) {
  const int64_t row_bytes = plan_.dims.x * BytesOf(plan_.fields[field_].type);
  const int64_t rows = std::ssize(bytes) / row_bytes;
  return rows == 0 ? absl::OkStatus() : dense_->AddRows(rows, bytes, [this](DenseSlices slices) {
    return stream_->Push(std::move(slices));
  });
}

Status StepUpload::EndField() {
  FOVEA_RETURN_IF_ERROR(
      dense_->End(0, [this](DenseSlices slices) { return stream_->Push(std::move(slices)); }));
  FOVEA_ASSIGN_OR_RETURN(const DenseEnd end, dense_->Finish());
  nonfinite_ += end.nonfinite;
  FOVEA_RETURN_IF_ERROR(stream_->Finish(end.stats));
  stream_.reset();
  came_ = 0;
  ++field_;
  return field_ < plan_.fields.size() ? StartField() : absl::OkStatus();
}

Status StepUpload::Commit() {
  return writer_->Commit(plan_.time_ns, plan_.frame_number);
}

}  // namespace fovea::ingest
