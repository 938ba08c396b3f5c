#include "service/client/local_renderer.h"

#include <algorithm>
#include <chrono>
#include <thread>

#include "engine/fovea/coefficient_source.h"
#include "engine/store/stored_type.h"
#include "engine/volume/basis.h"
#include "service/frames/frames.h"
#include "service/wire/status.h"

namespace fovea::client {
namespace {

using coefficients::HeldStep;

/// A stream waits this long, at most, where the server says when it will have room again.
constexpr auto kLongestRetry = std::chrono::seconds(10);

/// What a server sent cannot be: its fault, whatever it is called where it was found.
Status Blame(const Status& status) {
  return absl::IsDataLoss(status) ? Internal("the server sent {}", MessageOf(status)) : status;
}

StatusOr<std::vector<HeldStep::Field>> FieldsOf(const wire::CoefficientsSummary& set) {
  const auto wavelet = ParseWavelet(set.dataset.info.wavelet);
  if (!wavelet.ok()) {
    return Internal("the server sent coefficients of an unknown kind: {}",
                    MessageOf(wavelet.status()));
  }
  std::vector<HeldStep::Field> fields;
  for (const wire::CoefficientsSummary::Field& field : set.fields) {
    if (field.reversible && *wavelet == Wavelet::kCdf97) {
      return Internal("the server sent coefficients of a transform that there is not");
    }
    fields.push_back({field.name, {*wavelet, field.reversible}, field.content});
  }
  return fields;
}

void AddOnce(const frames::Warning& warning, std::vector<frames::Warning>* warnings) {
  if (std::none_of(warnings->begin(), warnings->end(), [&](const frames::Warning& there) {
        return there.message == warning.message;
      })) {
    warnings->push_back(warning);
  }
}

bool IsStale(const Status& status) {
  return absl::IsFailedPrecondition(status);
}

}  // namespace

/// The step that is fetched becomes the current one; what it was before is what differences are
/// from.
void LocalRenderer::Turn(int64_t step, const Fields& fields) {
  if (fields != fields_) {
    Drop();
    fields_ = fields;
  }
  if (current_ != nullptr) {
    // What was damaged stays so; what was not retained is another matter for every fovea.
    for (const frames::Warning& warning : warnings_) {
      if (warning.code == frames::Warning::Code::kDataLoss) {
        AddOnce(warning, &current_->warnings);
      }
    }
  }
  warnings_.clear();
  if (current_ != nullptr && current_->held.step() == step) {
    return;
  }
  if (previous_ != nullptr && previous_->held.step() == step) {
    std::swap(current_, previous_);
  } else if (current_ != nullptr) {
    previous_ = std::move(current_);
  }
  set_.reset();
}

void LocalRenderer::Drop() {
  current_.reset();
  previous_.reset();
  set_.reset();
  warnings_.clear();
}

std::vector<wire::HeldCoefficients> LocalRenderer::Held() const {
  std::vector<wire::HeldCoefficients> held;
  for (const Kept* step : {current_.get(), previous_.get()}) {
    if (step == nullptr) {
      continue;
    }
    std::vector<uint64_t> content;
    for (const HeldStep::Field& field : step->held.fields()) {
      content.push_back(field.content);
    }
    for (const Fovea& region : step->held.regions()) {
      held.push_back({static_cast<uint64_t>(step->held.step()), region, content});
    }
  }
  return held;
}

Status LocalRenderer::Fetch(int64_t step, const frames::FrameSpec& spec,
                            const OnGrowth& on_growth) {
  if (step < 0) {
    return InvalidArgument("step {}: steps count from 0", step);
  }
  Turn(step, {spec.field, spec.color_field});
  wire::CoefficientsRequest request;
  request.dataset = dataset_;
  request.step = static_cast<uint64_t>(step);
  request.spec = spec;
  request.held = Held();
  progress_ = {};
  const bool holds = current_ != nullptr || previous_ != nullptr;
  Status status = FetchOnce(request, on_growth);
  if (IsStale(status) && holds) {
    // The dataset is not what it was: nothing that is here counts any more.
    Drop();
    request.held.clear();
    progress_ = {};
    status = FetchOnce(std::move(request), on_growth);
  }
  return status;
}

Status LocalRenderer::FetchOnce(wire::CoefficientsRequest request, const OnGrowth& on_growth) {
  begun_ = false;
  next_index_ = 0;
  resume_token_.clear();
  while (true) {
    const uint64_t before = next_index_;
    ended_ = false;
    bool stopped = false;
    const Status status =
        client_.StreamCoefficients(request, [&](const wire::CoefficientsMessage& message) {
          FOVEA_RETURN_IF_ERROR(Take(message, request));
          stopped = on_growth && !on_growth(progress_);
          return stopped ? Cancelled("stopped") : absl::OkStatus();
        });
    if (stopped) {
      return absl::OkStatus();
    }
    if (status.ok() && !progress_.complete) {
      return Internal("the server ended a stream of coefficients before all had come");
    }
    const auto retry = wire::RetryDelayOf(status);
    const bool above_quota = absl::IsResourceExhausted(status) && retry && *retry <= kLongestRetry;
    if (!(absl::IsUnavailable(status) || above_quota) || next_index_ == before) {
      return status;
    }
    if (above_quota) {
      std::this_thread::sleep_for(*retry);
    }
    // The rest in the same way as what came, also where defaults have changed since.
    request.spec = set_->used;
    request.resume_token = resume_token_;
  }
}

Status LocalRenderer::Begin(const wire::CoefficientsSummary& set, int64_t step) {
  FOVEA_ASSIGN_OR_RETURN(auto fields, FieldsOf(set));
  if (set.step != step) {
    return Internal("the server sent coefficients of step {} for step {}", set.step, step);
  }
  const Hierarchy& hierarchy = set.dataset.info.hierarchy;
  for (const Kept* kept : {current_.get(), previous_.get()}) {
    if (kept != nullptr && kept->held.coefficients(0).hierarchy != hierarchy) {
      return FailedPrecondition("the volume has another size than what is held of it");
    }
  }
  if (current_ == nullptr) {
    current_ = std::make_unique<Kept>(Kept{HeldStep(hierarchy, set.step, std::move(fields)), {}});
  } else if (current_->held.fields() != fields) {
    return FailedPrecondition("step {} is not what is held of it", set.step);
  }
  const auto retained =
      RetainedSet::Make(hierarchy, {set.used.fovea->at, *set.used.rate, WindowShape::kCube});
  if (!retained.ok()) {
    return Internal("the server sent coefficients of an impossible fovea: {}",
                    MessageOf(retained.status()));
  }
  if (!begun_) {
    values_left_ = retained->CoefficientCount() * static_cast<int64_t>(set.fields.size());
  }
  begun_ = true;
  set_ = set;
  return absl::OkStatus();
}

Status LocalRenderer::Take(const wire::CoefficientsMessage& message,
                           const wire::CoefficientsRequest& request) {
  if (message.set) {
    FOVEA_RETURN_IF_ERROR(Begin(*message.set, static_cast<int64_t>(request.step)));
  }
  if (!begun_ || ended_ || message.index != next_index_) {
    return Internal("the server sent block {} where block {} of a set that was told was due",
                    message.index, next_index_);
  }
  if (!message.data.empty()) {
    const auto added =
        current_->held.Add(message.data, previous_ != nullptr ? &previous_->held : nullptr);
    FOVEA_RETURN_IF_ERROR(Blame(added.status()));
    values_left_ -= *added;
    if (values_left_ < 0) {
      return Internal("the server sent more coefficients than the fovea has");
    }
    ++next_index_;
    ++progress_.blocks;
    progress_.bytes += message.data.size();
  }
  ended_ = message.data.empty();
  resume_token_ = message.resume_token;
  warnings_ = message.warnings;
  const Rate& asked = *set_->used.rate;
  if (message.reached) {
    current_->held.Complete({set_->used.fovea->at, *message.reached, WindowShape::kCube});
    progress_.reached = message.reached;
    progress_.complete = *message.reached == asked;
  }
  return absl::OkStatus();
}

StatusOr<frames::FrameSpec> LocalRenderer::Reached() const {
  if (!set_ || !progress_.reached) {
    return FailedPrecondition("no coefficients are here yet that a picture could be made of");
  }
  frames::FrameSpec spec = set_->used;
  spec.rate = progress_.reached;
  return spec;
}

StatusOr<frames::Frame> LocalRenderer::Render(const frames::FrameSpec& resolved) const {
  if (!set_ || current_ == nullptr) {
    return FailedPrecondition("no coefficients are here yet");
  }
  if (!resolved.fovea || !resolved.rate || !current_->held.Holds(frames::FoveaOf(resolved))) {
    return FailedPrecondition("the coefficients of this fovea and rate are not here; fetch them");
  }
  std::vector<std::unique_ptr<MemorySource>> sources;
  frames::FrameCoefficients coefficients;
  for (size_t i = 0; i < current_->held.fields().size(); ++i) {
    sources.push_back(std::make_unique<MemorySource>(current_->held.coefficients(i)));
    const std::string& name = current_->held.fields()[i].name;
    coefficients.value = resolved.field == name ? sources.back().get() : coefficients.value;
    coefficients.color = resolved.color_field == name ? sources.back().get() : coefficients.color;
  }
  if (coefficients.value == nullptr || (resolved.color_field && coefficients.color == nullptr)) {
    return FailedPrecondition("the coefficients of this field are not here; fetch them");
  }
  FOVEA_ASSIGN_OR_RETURN(
      frames::Frame frame,
      frames::RenderCoefficients(coefficients, set_->dataset.info, resolved, threads_));
  frame.dataset = set_->dataset.name;
  frame.step = set_->step;
  frame.time_ns = set_->time_ns;
  frame.frame_number = set_->frame_number;
  frame.stats.chunks_read = progress_.blocks;
  frame.stats.chunks_total = set_->blocks;
  frame.stats.bytes_read = progress_.bytes;
  frame.warnings = current_->warnings;
  for (const frames::Warning& warning : warnings_) {
    AddOnce(warning, &frame.warnings);
  }
  return frame;
}

}  // namespace fovea::client
