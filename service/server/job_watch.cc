#include "service/server/job_watch.h"

#include <utility>

#include "service/jobs/job_message.h"
#include "service/server/new_job.h"
#include "service/wire/status.h"

namespace fovea::server {

JobWatch* JobWatch::Start(Services& services, const grpc::CallbackServerContext& context,
                          const v1::WatchJobRequest& request) {
  auto call = std::make_shared<JobWatch>(services, request.id());
  call->self_ = call;
  JobWatch* reactor = call.get();
  auto admission = Admit(services, context, {.request = &request, .stream = true});
  if (!admission.ok()) {
    call->End(admission.status());
    return reactor;
  }
  call->admission_ = *std::move(admission);
  if (request.id().empty()) {
    call->End(wire::BadField("id", "is empty; ListJobs says which there are"));
    return reactor;
  }
  services.lookups.SubmitAdmitted(0, [call](int) { call->Subscribe(); });
  return reactor;
}

void JobWatch::Subscribe() {
  const auto runner = JobsOf(services_);
  if (!runner.ok()) {
    End(runner.status());
    return;
  }
  std::string owner;
  {
    const std::lock_guard lock(mutex_);
    if (finished_) {
      return;
    }
    owner = admission_.caller->name();
  }
  const Status status = (*runner)->Watch(owner, id_, weak_from_this());
  if (!status.ok()) {
    End(absl::IsNotFound(status) ? NoJob(id_) : status);
  }
}

void JobWatch::OnJob(const jobs::Job& job) {
  {
    const std::lock_guard lock(mutex_);
    if (is_last_) {
      return;
    }
    news_ = jobs::ToProto(job);
    is_last_ = jobs::IsEnd(job.state);
  }
  Advance();
}

void JobWatch::OnClosing() {
  End(DrainingError());
}

void JobWatch::Advance() {
  Status status;
  bool write = false;
  {
    const std::lock_guard lock(mutex_);
    if (finished_ || writing_ || end_) {
      return;
    }
    if (news_) {
      status = admission_.caller->TakeBytesIn(0);  // a token may have been taken away
      write = status.ok();
      if (write) {
        message_ = *std::exchange(news_, std::nullopt);
        writing_ = true;
      }
    }
    if (!write && !is_last_ && status.ok()) {
      return;
    }
  }
  if (write) {
    StartWrite(&message_);
  } else {
    End(status);
  }
}

void JobWatch::OnWriteDone(bool ok) {
  bool ends = false;
  {
    const std::lock_guard lock(mutex_);
    writing_ = false;
    ends = end_.has_value();
  }
  if (ends) {
    End(absl::OkStatus());  // with what it waits to end with
  } else if (ok) {
    Advance();
  } else {
    OnCancel();
  }
}

void JobWatch::OnCancel() {
  End(Cancelled("the client cancelled, went away, or its deadline passed"));
}

/// Ends the call with the first status that it gets, once nothing is being sent.
void JobWatch::End(const Status& status) {
  Status end;
  {
    const std::lock_guard lock(mutex_);
    end_ = end_.value_or(status);
    if (finished_ || writing_) {
      return;
    }
    finished_ = true;
    end = *end_;
  }
  Finish(wire::ToGrpc(end));
}

void JobWatch::OnDone() {
  {
    const std::lock_guard lock(mutex_);  // Subscribe looks at it
    admission_ = Admission();
  }
  self_.reset();  // may be the end of this
}

}  // namespace fovea::server
