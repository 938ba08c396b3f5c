#ifndef SERVICE_SERVER_METRICS_H_
#define SERVICE_SERVER_METRICS_H_

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <vector>

#include <prometheus/counter.h>
#include <prometheus/family.h>
#include <prometheus/gauge.h>
#include <prometheus/histogram.h>
#include <prometheus/metric_family.h>
#include <prometheus/registry.h>

#include "engine/base/status.h"

namespace fovea::server {

/// What a server counts as things happen (docs/operations.md lists the names). What it has at a
/// moment, like a queue's length, is read when somebody looks: state_metrics.h. Thread-safe.
class Metrics {
 public:
  Metrics();

  /// The counters of one method of gRPC. Thread-safe; lives as long as the Metrics.
  class Method {
   public:
    void Started() { running_.Increment(); }
    void Ended(absl::StatusCode code, double seconds);
    void Sent(int64_t bytes) { sent_bytes_.Increment(static_cast<double>(bytes)); }
    void Received(int64_t bytes) { received_bytes_.Increment(static_cast<double>(bytes)); }
    /// A frame went to the transport this long after it was asked for: a stream's frame since the
    /// stream's window and pace asked for it, another since its call came.
    void FrameAged(double seconds) { frame_age_.Observe(seconds); }

   private:
    friend class Metrics;
    Method(Metrics& all, const std::string& name);

    Metrics& all_;
    const std::string name_;
    prometheus::Gauge& running_;
    prometheus::Histogram& seconds_;
    prometheus::Histogram& frame_age_;
    prometheus::Counter& sent_bytes_;
    prometheus::Counter& received_bytes_;
  };

  /// `path` as gRPC has it, "/fovea.v1.Render/RenderFrame". What no linked service has counts as
  /// "other": clients cannot make up labels.
  [[nodiscard]] Method& OfMethod(std::string_view path);

  /// A frame was handed to the transport. `encoding` is the proto's name.
  void FrameSent(const std::string& encoding, int64_t bytes, int64_t coefficients);
  /// A call was refused for want of something: "quota", "overload" (worth trying again) or
  /// "too_large" (never).
  void Shed(const std::string& reason);

  [[nodiscard]] std::vector<prometheus::MetricFamily> Collect() const {
    return registry_.Collect();
  }

 private:
  prometheus::Registry registry_;
  prometheus::Family<prometheus::Counter>& calls_;
  prometheus::Family<prometheus::Gauge>& running_;
  prometheus::Family<prometheus::Histogram>& seconds_;
  prometheus::Family<prometheus::Histogram>& frame_age_;
  prometheus::Family<prometheus::Counter>& sent_bytes_;
  prometheus::Family<prometheus::Counter>& received_bytes_;
  prometheus::Family<prometheus::Counter>& frames_;
  prometheus::Family<prometheus::Counter>& frame_bytes_;
  prometheus::Family<prometheus::Counter>& coefficients_;
  prometheus::Family<prometheus::Counter>& shed_;

  std::mutex mutex_;
  std::map<std::string, std::unique_ptr<Method>, std::less<>> methods_;  // guarded by mutex_
};

/// The text that Prometheus reads (exposition format 0.0.4).
[[nodiscard]] std::string ToPrometheusText(const std::vector<prometheus::MetricFamily>& families);

}  // namespace fovea::server

#endif  // SERVICE_SERVER_METRICS_H_
