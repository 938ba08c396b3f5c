#include "service/jobs/job_message.h"

namespace fovea::jobs {

v1::Job ToProto(const Job& job) {
  v1::Job proto;
  proto.set_id(job.id);
  proto.set_kind(job.kind == Kind::kExport ? v1::Job::EXPORT : v1::Job::INGEST_FILES);
  proto.set_state(static_cast<v1::Job::State>(job.state));  // the same numbers
  proto.set_dataset(job.dataset);
  proto.set_target(job.target);
  proto.set_done(static_cast<uint64_t>(job.progress.done));
  proto.set_total(static_cast<uint64_t>(job.progress.total));
  proto.set_failed(static_cast<uint64_t>(job.progress.failed));
  if (job.seconds_left) {
    proto.set_seconds_left(*job.seconds_left);
  }
  proto.set_now(job.now);
  proto.set_message(job.message);
  for (const Failure& failure : job.failures) {
    v1::Job::Failure* told = proto.add_failures();
    told->set_file(failure.file);
    told->set_reason(failure.reason);
  }
  for (const std::string& warning : job.warnings) {
    proto.add_warnings(warning);
  }
  proto.set_warning_count(job.warnings.size());
  proto.set_created_ms(job.created_ms);
  if (job.started_ms) {
    proto.set_started_ms(*job.started_ms);
  }
  if (job.ended_ms) {
    proto.set_ended_ms(*job.ended_ms);
  }
  return proto;
}

}  // namespace fovea::jobs
