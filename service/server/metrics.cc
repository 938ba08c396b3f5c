#include "service/server/metrics.h"

#include <algorithm>

#include <google/protobuf/descriptor.h>
#include <prometheus/text_serializer.h>

namespace fovea::server {
namespace {

/// Seconds. A frame of a small volume takes milliseconds; a stream may take minutes.
const prometheus::Histogram::BucketBoundaries kSeconds = {
    0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1, 2.5, 5, 10, 30, 120};

template <typename Builder>
auto& Register(Builder builder, prometheus::Registry& registry, const char* name,
               const char* help) {
  return builder.Name(name).Help(help).Register(registry);
}

/// "fovea.v1.Render/RenderFrame" of "/fovea.v1.Render/RenderFrame"; "other" if nothing is so named.
std::string NameOf(std::string_view path) {
  std::string name(path.substr(std::min<size_t>(path.size(), path.starts_with('/') ? 1 : 0)));
  std::string full_name = name;
  std::replace(full_name.begin(), full_name.end(), '/', '.');
  // Health has no descriptor: gRPC parses it by hand.
  const bool known =
      google::protobuf::DescriptorPool::generated_pool()->FindMethodByName(full_name) != nullptr ||
      name == "grpc.health.v1.Health/Check" || name == "grpc.health.v1.Health/Watch";
  return known ? name : "other";
}

}  // namespace

Metrics::Metrics()
    : calls_(Register(prometheus::BuildCounter(), registry_, "fovea_requests_total",
                      "Calls that ended, by method and status code")),
      running_(Register(prometheus::BuildGauge(), registry_, "fovea_requests_running",
                        "Calls that run, streams included")),
      seconds_(Register(prometheus::BuildHistogram(), registry_, "fovea_request_seconds",
                        "From a call's arrival to its end; of a stream, all of it")),
      frame_age_(Register(prometheus::BuildHistogram(), registry_, "fovea_frame_age_seconds",
                          "From when a frame was asked for until it was handed to the transport")),
      sent_bytes_(Register(prometheus::BuildCounter(), registry_, "fovea_sent_bytes_total",
                           "Bytes of messages sent")),
      received_bytes_(Register(prometheus::BuildCounter(), registry_, "fovea_received_bytes_total",
                               "Bytes of messages received")),
      frames_(Register(prometheus::BuildCounter(), registry_, "fovea_frames_sent_total",
                       "Frames sent, by encoding")),
      frame_bytes_(Register(prometheus::BuildCounter(), registry_, "fovea_frame_bytes_total",
                            "Bytes of the pictures of frames sent, by encoding")),
      coefficients_(Register(prometheus::BuildCounter(), registry_, "fovea_coefficients_total",
                             "Coefficients that the frames sent were made of")),
      shed_(Register(prometheus::BuildCounter(), registry_, "fovea_shed_total",
                     "Calls refused with RESOURCE_EXHAUSTED, by reason")) {
  coefficients_.Add({});  // there from the start, for rates
  for (const char* reason : {"overload", "quota", "too_large"}) {
    shed_.Add({{"reason", reason}});
  }
}

Metrics::Method::Method(Metrics& all, const std::string& name)
    : all_(all),
      name_(name),
      running_(all.running_.Add({{"method", name}})),
      seconds_(all.seconds_.Add({{"method", name}}, kSeconds)),
      frame_age_(all.frame_age_.Add({{"method", name}}, kSeconds)),
      sent_bytes_(all.sent_bytes_.Add({{"method", name}})),
      received_bytes_(all.received_bytes_.Add({{"method", name}})) {}

void Metrics::Method::Ended(absl::StatusCode code, double seconds) {
  running_.Decrement();
  seconds_.Observe(seconds);
  all_.calls_.Add({{"method", name_}, {"code", absl::StatusCodeToString(code)}}).Increment();
}

Metrics::Method& Metrics::OfMethod(std::string_view path) {
  const std::lock_guard lock(mutex_);
  const auto found = methods_.find(path);
  if (found != methods_.end()) {
    return *found->second;
  }
  const std::string name = NameOf(path);
  const std::string key = name == "other" ? name : std::string(path);
  std::unique_ptr<Method>& method = methods_[key];
  if (method == nullptr) {
    method.reset(new Method(*this, name));
  }
  return *method;
}

void Metrics::FrameSent(const std::string& encoding, int64_t bytes, int64_t coefficients) {
  frames_.Add({{"encoding", encoding}}).Increment();
  frame_bytes_.Add({{"encoding", encoding}}).Increment(static_cast<double>(bytes));
  coefficients_.Add({}).Increment(static_cast<double>(coefficients));
}

void Metrics::Shed(const std::string& reason) {
  shed_.Add({{"reason", reason}}).Increment();
}

std::string ToPrometheusText(const std::vector<prometheus::MetricFamily>& families) {
  return prometheus::TextSerializer().Serialize(families);
}

}  // namespace fovea::server
