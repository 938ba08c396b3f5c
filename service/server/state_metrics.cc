#include "service/server/state_metrics.h"

#include <sys/resource.h>
#include <unistd.h>

#include <cstdint>
#include <cstdio>
#include <ctime>
#include <initializer_list>
#include <memory>
#include <string>
#include <utility>

#include <dirent.h>

namespace fovea::server {
namespace {

using prometheus::ClientMetric;
using prometheus::MetricFamily;
using prometheus::MetricType;

struct Sample {
  std::string label;  // the value of the family's one label; empty if it has none
  double value = 0;
};

class Families {
 public:
  void Gauge(const char* name, const char* help, const char* label,
             std::initializer_list<Sample> samples) {
    Add(name, help, label, samples, MetricType::Gauge);
  }
  void Counter(const char* name, const char* help, const char* label,
               std::initializer_list<Sample> samples) {
    Add(name, help, label, samples, MetricType::Counter);
  }
  [[nodiscard]] std::vector<MetricFamily> Take() { return std::move(families_); }

 private:
  void Add(const char* name, const char* help, const char* label,
           std::initializer_list<Sample> samples, MetricType type) {
    MetricFamily& family = families_.emplace_back();
    family.name = name;
    family.help = help;
    family.type = type;
    for (const Sample& sample : samples) {
      ClientMetric& metric = family.metric.emplace_back();
      if (!sample.label.empty()) {
        metric.label.push_back({label, sample.label});
      }
      (type == MetricType::Counter ? metric.counter.value : metric.gauge.value) = sample.value;
    }
  }

  std::vector<MetricFamily> families_;
};

double Number(auto value) {
  return static_cast<double>(value);
}

void AddQueues(Services& services, Families* families) {
  const WorkPool::Counts renders = services.renders.counts();
  const WorkPool::Counts lookups = services.lookups.counts();
  families->Gauge("fovea_queue_waiting", "Calls that wait to be rendered or looked up", "queue",
                  {{"render", Number(renders.waiting)}, {"lookup", Number(lookups.waiting)}});
  families->Gauge("fovea_queue_limit", "Calls that may wait", "queue",
                  {{"render", Number(services.renders.limits().max_waiting)},
                   {"lookup", Number(services.lookups.limits().max_waiting)}});
  families->Gauge("fovea_queue_running", "Calls that are rendered or looked up now", "queue",
                  {{"render", Number(renders.running)}, {"lookup", Number(lookups.running)}});
  families->Counter("fovea_queue_refused_total", "Calls that found a queue full", "queue",
                    {{"render", Number(renders.refused)}, {"lookup", Number(lookups.refused)}});
}

/// Of long work, which has a queue of its own.
void AddJobs(jobs::JobRunner& runner, Families* families) {
  const jobs::JobRunner::Counts counts = runner.counts();
  families->Gauge("fovea_jobs", "Jobs that have not ended (ingests and exports)", "state",
                  {{"queued", Number(counts.queued)}, {"running", Number(counts.running)}});
  families->Counter("fovea_jobs_ended_total", "Jobs that ended", "state",
                    {{"done", Number(counts.done)},
                     {"failed", Number(counts.failed)},
                     {"cancelled", Number(counts.cancelled)}});
}

void AddMemory(Services& services, Families* families) {
  families->Gauge("fovea_memory_used_bytes", "Estimated, of the parts of the memory limit", "part",
                  {{"requests", Number(services.requests.used_bytes())},
                   {"replies", Number(services.replies.used_bytes())},
                   {"rendering", Number(services.renders.counts().running_bytes)}});
  families->Gauge("fovea_memory_limit_bytes", "Of the parts of the memory limit", "part",
                  {{"requests", Number(services.requests.limit_bytes())},
                   {"replies", Number(services.replies.limit_bytes())},
                   {"rendering", Number(services.renders.limits().max_running_bytes)}});
  families->Counter("fovea_memory_refused_total", "Calls refused for want of memory", "part",
                    {{"requests", Number(services.requests.refused())},
                     {"replies", Number(services.replies.refused())}});
}

void AddVolumes(frames::VolumeCache& volumes, Families* families) {
  const frames::VolumeCache::Counts counts = volumes.counts();
  families->Counter("fovea_cache_hits_total", "Volumes of frames that were there, or being made",
                    "", {{"", Number(counts.hits)}});
  families->Counter("fovea_cache_misses_total", "Volumes that were read and reconstructed", "",
                    {{"", Number(counts.misses)}});
  families->Counter("fovea_cache_evictions_total", "Volumes dropped for others", "",
                    {{"", Number(counts.evictions)}});
  families->Gauge("fovea_cache_bytes", "Memory of the volumes kept", "",
                  {{"", Number(counts.bytes)}});
  families->Gauge("fovea_cache_limit_bytes", "What they may take", "",
                  {{"", Number(volumes.limit_bytes())}});
}

void AddConnections(Acceptor& acceptor, Families* families) {
  const Acceptor::Counts counts = acceptor.counts();
  families->Gauge("fovea_connections_open", "Connections that are open", "",
                  {{"", Number(acceptor.CountOpen())}});
  families->Counter("fovea_connections_accepted_total", "Connections taken", "",
                    {{"", Number(counts.accepted)}});
  families->Counter("fovea_connections_refused_total", "Connections closed at once", "reason",
                    {{"total", Number(counts.over_total)},
                     {"address", Number(counts.over_address)},
                     {"descriptors", Number(counts.out_of_descriptors)}});
}

/// Resident pages of this process, in bytes; 0 if the kernel does not tell.
double ResidentBytes() {
  const std::unique_ptr<FILE, int (*)(FILE*)> file(std::fopen("/proc/self/statm", "r"), fclose);
  long long size = 0;
  long long resident = 0;
  const bool read = file != nullptr && std::fscanf(file.get(), "%lld %lld", &size, &resident) == 2;
  return read ? Number(resident) * Number(sysconf(_SC_PAGESIZE)) : 0;
}

int64_t OpenDescriptors() {
  const std::unique_ptr<DIR, int (*)(DIR*)> folder(opendir("/proc/self/fd"), closedir);
  int64_t entries = 0;
  while (folder != nullptr && readdir(folder.get()) != nullptr) {
    ++entries;
  }
  constexpr int64_t kOthers = 3;  // ".", "..", and the folder's own
  return entries - kOthers;
}

/// Under the names that Prometheus' own clients use.
void AddProcess(Families* families) {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& time) {
    return Number(time.tv_sec) + 1e-6 * Number(time.tv_usec);
  };
  rlimit descriptors{};
  getrlimit(RLIMIT_NOFILE, &descriptors);
  static const double start = Number(std::time(nullptr));
  families->Counter("process_cpu_seconds_total", "Processor time, user and system", "",
                    {{"", seconds(usage.ru_utime) + seconds(usage.ru_stime)}});
  families->Gauge("process_resident_memory_bytes", "Resident memory", "", {{"", ResidentBytes()}});
  families->Gauge("process_open_fds", "Open file descriptors", "",
                  {{"", Number(OpenDescriptors())}});
  families->Gauge("process_max_fds", "Descriptors that may be open", "",
                  {{"", Number(descriptors.rlim_cur)}});
  families->Gauge("process_start_time_seconds", "When it started, seconds since 1970", "",
                  {{"", start}});
}

}  // namespace

std::vector<MetricFamily> StateMetrics(Services& services, Acceptor& acceptor) {
  Families families;
  families.Gauge("fovea_datasets", "Datasets that are served", "",
                 {{"", Number(services.catalogue->size())}});
  families.Gauge("fovea_draining", "1 while the server stops", "",
                 {{"", services.calls.draining() ? 1.0 : 0.0}});
  families.Counter("fovea_frames_rendered_total", "Frames rendered, sent or not", "",
                   {{"", Number(services.frames_rendered.load())}});
  AddQueues(services, &families);
  if (services.jobs != nullptr) {
    AddJobs(*services.jobs, &families);
  }
  AddMemory(services, &families);
  if (services.catalogue->volumes() != nullptr) {
    AddVolumes(*services.catalogue->volumes(), &families);
  }
  AddConnections(acceptor, &families);
  AddProcess(&families);
  return families.Take();
}

}  // namespace fovea::server
