#include "service/server/coefficient_job.h"

#include <algorithm>
#include <bit>
#include <charconv>
#include <utility>

#include "service/frames/frames.h"
#include "service/server/frame_job.h"
#include "service/wire/printable.h"
#include "service/wire/requests.h"
#include "service/wire/status.h"

namespace fovea::server {
namespace {

/// FNV-1a: tells requests and contents apart; no secret.
class Fingerprint {
 public:
  void Add(const std::string& text) {
    for (const char letter : text) {
      hash_ = (hash_ ^ static_cast<unsigned char>(letter)) * 1099511628211ULL;
    }
    Add(uint64_t{text.size()});
  }
  void Add(uint64_t number) {
    for (int shift = 0; shift < 64; shift += 8) {
      hash_ = (hash_ ^ ((number >> shift) & 0xFF)) * 1099511628211ULL;
    }
  }
  void Add(double number) { Add(std::bit_cast<uint64_t>(number)); }
  void Add(const Fovea& fovea) {
    for (int axis = 0; axis < 3; ++axis) {
      Add(fovea.at[axis]);
      Add(fovea.rate[axis]);
    }
  }
  [[nodiscard]] uint64_t value() const { return hash_ == 0 ? 1 : hash_; }

 private:
  uint64_t hash_ = 14695981039346656037ULL;
};

Status CheckCost(const store::DatasetInfo& info, const Fovea& fovea) {
  const auto retained = RetainedSet::Make(info.hierarchy, fovea);
  FOVEA_RETURN_IF_ERROR(wire::PointAtSpecField(retained.status(), "spec"));
  if (retained->CoefficientCount() > kMaxSuperVoxelsPerFrame) {
    return ResourceExhausted(
        "rate {} keeps {} coefficients; this server's limit is {} a stream; ask for a smaller rate",
        FormatRate(fovea.rate), retained->CoefficientCount(), kMaxSuperVoxelsPerFrame);
  }
  return absl::OkStatus();
}

}  // namespace

StatusOr<std::unique_ptr<CoefficientJob>> CoefficientJob::Prepare(
    Catalogue& catalogue, const wire::CoefficientsRequest& request) {
  std::unique_ptr<CoefficientJob> job(new CoefficientJob);
  FOVEA_ASSIGN_OR_RETURN(job->dataset_, catalogue.Find(request.dataset));
  FOVEA_RETURN_IF_ERROR(job->Open(request));
  FOVEA_RETURN_IF_ERROR(job->TakeHeld(request));
  auto plan = coefficients::MakePlan(job->info_, job->request_);
  FOVEA_RETURN_IF_ERROR(plan.status());
  job->plan_ = *std::move(plan);
  job->set_.blocks = job->plan_.blocks.size();
  job->set_.coefficients = static_cast<uint64_t>(job->plan_.coefficients);
  FOVEA_RETURN_IF_ERROR(job->Resume(request.resume_token));
  return job;
}

/// What is asked for, with nothing left to default.
Status CoefficientJob::Open(const wire::CoefficientsRequest& request) {
  store::Dataset& store = dataset_->dataset();
  info_ = store.info();
  FOVEA_RETURN_IF_ERROR(wire::CheckStep(request.dataset, 0, info_.committed_steps));
  if (request.time_ns) {
    FOVEA_ASSIGN_OR_RETURN(set_.step, frames::StepAtTime(store, *request.time_ns));
  } else {
    FOVEA_RETURN_IF_ERROR(wire::CheckStep(request.dataset, request.step, info_.committed_steps));
    set_.step = static_cast<int64_t>(request.step);
  }
  FOVEA_ASSIGN_OR_RETURN(const frames::FrameSpec defaults, dataset_->DefaultSpec());
  auto resolved = frames::ResolveSpec(store, request.spec, defaults);
  FOVEA_RETURN_IF_ERROR(wire::PointAtSpecField(resolved.status(), "spec"));
  set_.used = *std::move(resolved);
  FOVEA_ASSIGN_OR_RETURN(set_.dataset, dataset_->Summary(/*whole=*/false));
  FOVEA_ASSIGN_OR_RETURN(set_.time_ns, store.TimeNs(set_.step));
  FOVEA_ASSIGN_OR_RETURN(set_.frame_number, store.FrameNumber(set_.step));

  request_.fields = {*set_.used.field};
  if (set_.used.color_field && *set_.used.color_field != *set_.used.field) {
    request_.fields.push_back(*set_.used.color_field);
  }
  request_.fovea = {set_.used.fovea->at, *set_.used.rate, WindowShape::kCube};
  FOVEA_RETURN_IF_ERROR(CheckCost(info_, request_.fovea));
  FOVEA_ASSIGN_OR_RETURN(const RetainedSet retained,
                         RetainedSet::Make(info_.hierarchy, request_.fovea));
  retention_ = frames::RetentionWarning(info_, retained);
  for (const std::string& field : request_.fields) {
    const store::FieldInfo& of = info_.FieldOf(field);
    FOVEA_ASSIGN_OR_RETURN(const uint64_t content, ContentOf(set_.step, field));
    set_.fields.push_back({field, store::IsIntegerType(of.type) && of.scales.empty(), content});
    FOVEA_ASSIGN_OR_RETURN(
        sources_.emplace_back(),
        store.OpenStep(set_.step, field,
                       set_.used.strict ? store::OnDamage::kFail : store::OnDamage::kCount));
  }
  return absl::OkStatus();
}

Status CoefficientJob::TakeHeld(const wire::CoefficientsRequest& request) {
  store::Dataset& store = dataset_->dataset();
  base_step_ = set_.step;
  for (size_t i = 0; i < request.held.size(); ++i) {
    const wire::HeldCoefficients& held = request.held[i];
    const std::string path = fmt::format("held[{}]", i);
    FOVEA_RETURN_IF_ERROR(wire::CheckStep(request.dataset, held.step, info_.committed_steps));
    const auto step = static_cast<int64_t>(held.step);
    if (held.content.size() != request_.fields.size()) {
      return wire::BadField(path + ".content",
                            fmt::format("has {} numbers; the request has {} fields",
                                        held.content.size(), request_.fields.size()));
    }
    if (step != set_.step && base_step_ != set_.step && step != base_step_) {
      return wire::BadField(path + ".step",
                            fmt::format("{} is a third step, beside {} and {}: differences are "
                                        "from one step",
                                        step, set_.step, base_step_));
    }
    if (const auto set = RetainedSet::Make(info_.hierarchy, held.fovea); !set.ok()) {
      return wire::BadField(path + ".fovea", MessageOf(set.status()));
    }
    for (size_t field = 0; field < request_.fields.size(); ++field) {
      FOVEA_ASSIGN_OR_RETURN(const uint64_t content, ContentOf(step, request_.fields[field]));
      if (content != held.content[field]) {
        return FailedPrecondition(
            "{}.content: step {} of '{}' is not what it was when these coefficients were sent; "
            "drop them, and ask without them",
            path, step, request_.fields[field]);
      }
    }
    (step == set_.step ? request_.held : request_.base).push_back(held.fovea);
    base_step_ = step == set_.step ? base_step_ : step;
  }
  for (const std::string& field : request_.fields) {
    if (base_step_ != set_.step) {
      // Strictly: differences from zeros that the client does not have would be wrong.
      FOVEA_ASSIGN_OR_RETURN(bases_.emplace_back(),
                             store.OpenStep(base_step_, field, store::OnDamage::kFail));
    }
  }
  return absl::OkStatus();
}

StatusOr<uint64_t> CoefficientJob::ContentOf(int64_t step, const std::string& field) {
  store::Dataset& store = dataset_->dataset();
  const store::FieldInfo& of = info_.FieldOf(field);
  Fingerprint content;
  content.Add(field);
  content.Add(of.type);
  content.Add(info_.wavelet);
  for (int axis = 0; axis < 3; ++axis) {
    content.Add(static_cast<uint64_t>(info_.hierarchy.dims()[axis]));
  }
  for (const float scale : of.scales) {
    content.Add(double{scale});
  }
  FOVEA_ASSIGN_OR_RETURN(const int64_t time_ns, store.TimeNs(step));
  FOVEA_ASSIGN_OR_RETURN(const FieldStats stats, store.Stats(step, field));
  content.Add(static_cast<uint64_t>(time_ns));
  content.Add(stats.minimum);
  content.Add(stats.maximum);
  for (const uint64_t count : stats.histogram) {
    content.Add(count);
  }
  return content.value();
}

std::string CoefficientJob::TokenFor(int64_t next) const {
  return fmt::format("{:016x}-{}", fingerprint_, next);
}

Status CoefficientJob::Resume(const std::string& token) {
  Fingerprint request;
  request.Add(set_.dataset.name);
  request.Add(static_cast<uint64_t>(set_.step));
  for (const auto& field : set_.fields) {
    request.Add(field.name);
    request.Add(field.content);
  }
  request.Add(request_.fovea);
  request.Add(static_cast<uint64_t>(base_step_));
  for (const auto* foveas : {&request_.held, &request_.base}) {
    request.Add(uint64_t{foveas->size()});
    for (const Fovea& fovea : *foveas) {
      request.Add(fovea);
    }
  }
  fingerprint_ = request.value();

  const auto blocks = static_cast<int64_t>(plan_.blocks.size());
  if (!token.empty()) {
    const size_t dash = token.find('-');
    const char* end = token.data() + token.size();
    const auto [last, error] =
        std::from_chars(token.data() + std::min(dash, token.size() - 1) + 1, end, first_);
    if (dash == std::string::npos || error != std::errc() || last != end || first_ < 0 ||
        first_ > blocks || token != TokenFor(first_)) {
      return wire::BadField("resume_token",
                            fmt::format("'{}' is not of this request: the step, the field, the "
                                        "fovea, the rate and what is held must be as they were",
                                        wire::Printable(token)));
    }
  }
  end_ = std::max(blocks, first_ + 1);
  return absl::OkStatus();
}

int64_t CoefficientJob::CoefficientsIn(int64_t index) const {
  const auto at = static_cast<size_t>(index);
  return at < plan_.blocks.size() ? plan_.blocks[at].Values() : 0;
}

int64_t CoefficientJob::WorkingBytes() {
  // Numbers and base, as floats and as stored, the planes and the block; chunks being decoded.
  constexpr int64_t kCopies = 12;
  return kCopies * coefficients::kMaxNumberBytes;
}

int64_t CoefficientJob::PlanBytes() const {
  size_t bytes = 0;
  for (const coefficients::PlannedBlock& block : plan_.blocks) {
    bytes += sizeof(block) + block.boxes.capacity() * sizeof(coefficients::PlannedBox);
  }
  return static_cast<int64_t>(bytes);
}

StatusOr<std::vector<std::byte>> CoefficientJob::Read(store::StepSource& source,
                                                      const coefficients::BlockHeader& header,
                                                      bool differences) const {
  const auto each = static_cast<size_t>(store::BytesOfType(header.type));
  std::vector<std::byte> numbers(static_cast<size_t>(header.Values()) * each);
  std::vector<float> values;
  size_t at = 0;
  for (const coefficients::BlockBox& box : header.boxes) {
    values.resize(static_cast<size_t>(box.Values()));
    const std::span<std::byte> out = std::span(numbers).subspan(at, values.size() * each);
    at += out.size();
    if (differences && !box.difference) {
      continue;
    }
    FOVEA_RETURN_IF_ERROR(box.level == coefficients::kCoarse
                              ? source.ReadCoarse(values)
                              : source.ReadDetail(box.level, box.box, values));
    if (const Status fits = store::ToStored(values, {header.type, box.scale}, out); !fits.ok()) {
      return DataLoss("step {}: {}; `fovea verify` says more", header.step, MessageOf(fits));
    }
  }
  return numbers;
}

StatusOr<std::string> CoefficientJob::Encode(const coefficients::PlannedBlock& planned) {
  const auto field = static_cast<size_t>(planned.field);
  coefficients::BlockHeader header;
  header.field = planned.field;
  header.step = header.base_step = static_cast<uint64_t>(set_.step);
  for (const coefficients::PlannedBox& box : planned.boxes) {
    const store::Coding coding = coefficients::CodingOf(info_, request_.fields[field], box.level);
    header.type = coding.type;
    header.boxes.push_back({box.level, box.box, box.difference, coding.scale});
  }
  FOVEA_ASSIGN_OR_RETURN(const std::vector<std::byte> numbers,
                         Read(*sources_[field], header, /*differences=*/false));
  std::string with_differences;
  if (header.HasDifferences()) {
    header.base_step = static_cast<uint64_t>(base_step_);
    // A base that is damaged is no base.
    const auto base = Read(*bases_[field], header, /*differences=*/true);
    if (base.ok()) {
      FOVEA_ASSIGN_OR_RETURN(with_differences,
                             coefficients::EncodeBlock(header, info_.hierarchy, numbers, *base));
    }
    for (coefficients::BlockBox& box : header.boxes) {
      box.difference = false;
    }
    header.base_step = header.step;
  }
  FOVEA_ASSIGN_OR_RETURN(std::string plain,
                         coefficients::EncodeBlock(header, info_.hierarchy, numbers, {}));
  const bool shorter = !with_differences.empty() && with_differences.size() < plain.size();
  return shorter ? std::move(with_differences) : std::move(plain);
}

std::vector<frames::Warning> CoefficientJob::Warnings() const {
  std::vector<frames::Warning> warnings;
  for (size_t field = 0; field < sources_.size(); ++field) {
    auto warning =
        frames::DamageWarning(sources_[field]->read_stats(), request_.fields[field], set_.step);
    if (warning) {
      warnings.push_back(*std::move(warning));
    }
  }
  if (retention_) {
    warnings.push_back(*retention_);
  }
  return warnings;
}

StatusOr<wire::CoefficientsMessage> CoefficientJob::Make(int64_t index) {
  wire::CoefficientsMessage message;
  message.index = static_cast<uint64_t>(index);
  const auto at = static_cast<size_t>(index);
  if (at < plan_.blocks.size()) {
    const coefficients::PlannedBlock& planned = plan_.blocks[at];
    auto data = Encode(planned);
    FOVEA_RETURN_IF_ERROR(dataset_->CheckPresent());
    FOVEA_ASSIGN_OR_RETURN(message.data, std::move(data));
    message.reached = planned.reached;
    message.resume_token = TokenFor(index + 1);
  } else {
    message.reached = plan_.blocks.empty() ? plan_.reached : plan_.blocks.back().reached;
    message.resume_token = TokenFor(index);
  }
  if (index == first_) {
    message.set = set_;
  }
  message.warnings = Warnings();
  return message;
}

}  // namespace fovea::server
