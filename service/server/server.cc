#include "service/server/server.h"

#include <sys/resource.h>

#include <algorithm>
#include <climits>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include <google/protobuf/stubs/logging.h>
#include <grpc/support/log.h>
#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/grpcpp.h>
#include <grpcpp/health_check_service_interface.h>
#include <grpcpp/resource_quota.h>
#include <spdlog/spdlog.h>

#include "engine/base/parallel.h"
#include "service/server/acceptor.h"
#include "service/server/admin_server.h"
#include "service/server/coefficients_service.h"
#include "service/server/datasets_service.h"
#include "service/server/file_watch.h"
#include "service/server/ingest_service.h"
#include "service/server/jobs_service.h"
#include "service/server/listener.h"
#include "service/server/memory_plan.h"
#include "service/server/render_service.h"
#include "service/server/services.h"
#include "service/server/state_metrics.h"
#include "service/server/tls_credentials.h"
#include "service/wire/convert.h"
#include "service/wire/host_port.h"

namespace fovea::server {
namespace {

constexpr int kLookupThreads = 2;
constexpr int kMaxLookupsWaiting = 1000;
constexpr int kDefaultMaxConnections = 1000;
constexpr char kRenderServiceName[] = "fovea.v1.Render";

/// gRPC's own messages go where ours go.
void LogFromGrpc(gpr_log_func_args* args) {
  const auto level =
      args->severity == GPR_LOG_SEVERITY_ERROR ? spdlog::level::warn : spdlog::level::debug;
  spdlog::log(level, "grpc: {}", args->message);
}

/// So do protobuf's: what a client sent is no warning, and its status says more.
void LogFromProtobuf(google::protobuf::LogLevel /*level*/, const char* /*file*/, int /*line*/,
                     const std::string& message) {
  spdlog::debug("protobuf: {}", message);
}

/// Once a process, before the first server is built.
void SetUpGrpc() {
  static const bool done = [] {
    gpr_set_log_function(LogFromGrpc);
    google::protobuf::SetLogHandler(LogFromProtobuf);
    grpc::EnableDefaultHealthCheckService(true);
    grpc::reflection::InitProtoReflectionServerBuilderPlugin();
    return true;
  }();
  static_cast<void>(done);
}

void SetLimits(grpc::ServerBuilder& builder, int64_t transport_bytes) {
  builder.SetMaxReceiveMessageSize(wire::kMaxRequestMessageBytes);
  builder.SetMaxSendMessageSize(wire::kMaxReplyMessageBytes);
  builder.SetDefaultCompressionAlgorithm(GRPC_COMPRESS_NONE);
  builder.SetResourceQuota(
      grpc::ResourceQuota("fovead").Resize(static_cast<size_t>(transport_bytes)));
  const std::pair<const char*, int> arguments[] = {
      {GRPC_ARG_KEEPALIVE_TIME_MS, 20'000},
      {GRPC_ARG_KEEPALIVE_TIMEOUT_MS, 5'000},
      {GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1},
      {GRPC_ARG_HTTP2_MIN_RECV_PING_INTERVAL_WITHOUT_DATA_MS, 10'000},
      {GRPC_ARG_MAX_CONNECTION_AGE_MS, 3'600'000},
      {GRPC_ARG_MAX_CONNECTION_AGE_GRACE_MS, 60'000},
      {GRPC_ARG_MAX_CONCURRENT_STREAMS, 100},
      {GRPC_ARG_MAX_METADATA_SIZE, 16 << 10},
      {GRPC_ARG_SERVER_HANDSHAKE_TIMEOUT_MS, 20'000},
  };
  for (const auto& [name, value] : arguments) {
    builder.AddChannelArgument(name, value);
  }
}

/// Who can reach a server must be kept out of it in some way.
Status CheckExposure(bool loopback, const ServerOptions& options) {
  if (options.tls.given()) {
    return absl::OkStatus();
  }
  if (!loopback && !options.tokens.empty()) {
    return InvalidArgument(
        "--tokens: {} can be reached from other machines, and tokens that cross a network in "
        "plaintext are everyone's; add --tls-cert and --tls-key, or listen on 127.0.0.1 behind a "
        "proxy that ends TLS",
        options.listen);
  }
  if (!loopback && !options.insecure_plaintext) {
    return InvalidArgument(
        "{} can be reached from other machines: add --tls-cert and --tls-key (and --tokens or "
        "--tls-client-ca), listen on 127.0.0.1 behind a proxy that ends TLS, or add "
        "--insecure-plaintext if everyone on that network may see and do everything",
        options.listen);
  }
  return absl::OkStatus();
}

ConnectionTable::Limits LimitsOf(const ServerOptions& options) {
  rlimit descriptors{};
  getrlimit(RLIMIT_NOFILE, &descriptors);
  // Half of them are for the files of datasets.
  const auto half = static_cast<int>(std::clamp<rlim_t>(descriptors.rlim_cur / 2, 1, INT_MAX));
  return {.total = options.max_connections > 0 ? options.max_connections
                                               : std::min(kDefaultMaxConnections, half),
          .per_address = options.max_connections_per_address};
}

/// Null if the options ask for none. `catalogue` must outlive it.
StatusOr<std::unique_ptr<jobs::JobRunner>> OpenJobs(const ServerOptions& options,
                                                    Catalogue* catalogue) {
  if (options.state.empty()) {
    if (!options.ingest_root.empty() || !options.export_root.empty()) {
      return InvalidArgument(
          "--ingest-root and --export-root are for jobs, which are kept with --state DIR");
    }
    return nullptr;
  }
  return jobs::JobRunner::Open({.state = options.state,
                                .folders = {.root = options.root,
                                            .ingest_root = options.ingest_root,
                                            .export_root = options.export_root},
                                .at_once = options.jobs,
                                .threads = options.threads,
                                // Who is told that a job is done finds its dataset.
                                .on_made = [catalogue](const std::string& dataset) {
                                  static_cast<void>(catalogue->FindNow(dataset));
                                }});
}

/// What the files were before they were read first.
struct SeenFiles {
  std::vector<FileWatch::Seen> tokens, certificates;
};

class GrpcServer final : public Server {
 public:
  GrpcServer(std::unique_ptr<Catalogue> catalogue, std::unique_ptr<access::Gate> gate,
             const ServerOptions& options, const MemoryPlan& memory)
      : memory_(memory),
        services_(std::move(catalogue), std::move(gate), memory.replies,
                  {.name = "lookup queue",
                   .flag = "",
                   .threads = kLookupThreads,
                   .max_waiting = kMaxLookupsWaiting},
                  {.name = "render queue",
                   .flag = fmt::format("--render-queue {}", options.render_queue),
                   .threads = options.threads > 0 ? options.threads : HardwareThreads(),
                   .max_waiting = options.render_queue,
                   .max_running_bytes = memory.rendering},
                  options.allow_ingest || !options.tokens.empty(), memory.requests),
        datasets_(services_),
        ingest_(services_),
        jobs_(services_),
        render_(services_),
        coefficients_(services_) {}

  ~GrpcServer() override { Drain(std::chrono::milliseconds(0)); }

  /// Before Serve.
  void KeepJobs(std::unique_ptr<jobs::JobRunner> jobs) { services_.jobs = std::move(jobs); }

  /// With TLS, if there are certificates for it.
  [[nodiscard]] Status Serve(Listener listener, ConnectionTable::Limits limits,
                             std::optional<Certificates> certificates) {
    std::shared_ptr<grpc::ServerCredentials> credentials = grpc::InsecureServerCredentials();
    if (certificates) {
      credentials = tls_ = std::make_shared<TlsCredentials>(*std::move(certificates));
    }
    grpc::ServerBuilder builder;
    SetLimits(builder, memory_.transport);
    connections_ = builder.experimental().AddExternalConnectionAcceptor(
        grpc::ServerBuilder::experimental_type::ExternalConnectionType::FROM_FD, credentials);
    std::vector<std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface>> observers;
    observers.push_back(services_.observer.Factory());
    builder.experimental().SetInterceptorCreators(std::move(observers));
    builder.RegisterService(&datasets_);
    builder.RegisterService(&ingest_);
    builder.RegisterService(&jobs_);
    builder.RegisterService(&render_);
    builder.RegisterService(&coefficients_);
    server_ = builder.BuildAndStart();
    if (server_ == nullptr) {
      return Internal("gRPC could not be started; its messages are in the log");
    }
    server_->GetHealthCheckService()->SetServingStatus(kRenderServiceName, true);
    address_ = listener.address.ToString();
    FOVEA_ASSIGN_OR_RETURN(
        acceptor_, Acceptor::Start(std::move(listener.sockets), limits, [this](int from, int fd) {
          grpc::experimental::ExternalConnectionAcceptor::NewConnectionParameters connection;
          connection.listener_fd = from;
          connection.fd = fd;
          connections_->HandleNewConnection(&connection);
        }));
    return absl::OkStatus();
  }

  /// Removes what a server that was killed left of removals, beside the calls that come.
  void TidyUp() {
    if (services_.writable) {
      services_.ingests.SubmitAdmitted(
          0, [catalogue = services_.catalogue.get()](int) { catalogue->FinishRemovals(); });
    }
  }

  /// Reads the files of `options` again when they change, from what they were at `seen` on.
  void Watch(const ServerOptions& options, SeenFiles seen) {
    if (!options.tokens.empty()) {
      token_watch_ = std::make_unique<FileWatch>(std::vector<std::string>{options.tokens},
                                                 std::move(seen.tokens), options.reload_interval,
                                                 [this] { ReloadTokens(); });
    }
    if (tls_ != nullptr) {
      certificate_watch_ = std::make_unique<FileWatch>(
          options.tls.Paths(), std::move(seen.certificates), options.reload_interval,
          [this, files = options.tls] { ReloadCertificates(files); });
    }
  }

  /// From now on `admin` tells of this server.
  void Tell(std::unique_ptr<AdminServer> admin) {
    admin_ = std::move(admin);
    if (admin_ == nullptr) {
      return;
    }
    admin_->SetMetrics([this] {
      std::vector<prometheus::MetricFamily> families = services_.metrics.Collect();
      for (prometheus::MetricFamily& family : StateMetrics(services_, *acceptor_)) {
        families.push_back(std::move(family));
      }
      return ToPrometheusText(families);
    });
    admin_->SetState(AdminServer::State::kReady);
  }

  const std::string& address() const override { return address_; }
  std::string admin_address() const override { return admin_ == nullptr ? "" : admin_->address(); }
  size_t dataset_count() const override { return services_.catalogue->size(); }
  uint64_t frames_rendered() const override { return services_.frames_rendered.load(); }

  void SayNotReady() override {
    const std::lock_guard lock(drain_mutex_);
    if (server_ == nullptr) {
      return;
    }
    if (admin_ != nullptr) {
      admin_->SetState(AdminServer::State::kDraining);
    }
    server_->GetHealthCheckService()->SetServingStatus(false);
  }

  int64_t Drain(std::chrono::milliseconds limit) override {
    SayNotReady();
    const std::lock_guard lock(drain_mutex_);
    if (server_ == nullptr) {
      return 0;
    }
    services_.calls.StopAdmitting();
    services_.steps.Close();  // what has no end of its own
    if (services_.jobs != nullptr) {
      services_.jobs->Stop();
    }
    const int64_t left = services_.calls.WaitIdle(limit);
    if (admin_ != nullptr) {
      admin_->SetMetrics(nullptr);  // what they tell of goes
    }
    services_.observer.CutShort();
    acceptor_.reset();
    // Only now are connections closed: a balancer that saw GOAWAY first would cut streams short.
    server_->Shutdown(std::chrono::system_clock::now());
    server_->Wait();
    server_.reset();
    return left;
  }

 private:
  void ReloadTokens() {
    if (const Status status = services_.gate->Reload(); status.ok()) {
      spdlog::info("tokens: {} read", services_.gate->token_count());
    } else {
      spdlog::warn("the tokens read before stay in force: {}", MessageOf(status));
    }
  }
  void ReloadCertificates(const CertificateFiles& files) {
    if (auto certificates = LoadCertificates(files); certificates.ok()) {
      spdlog::info("certificate: {}", certificates->summary);
      tls_->Replace(*std::move(certificates));
    } else {
      spdlog::warn("the certificate read before stays in use: {}",
                   MessageOf(certificates.status()));
    }
  }

  const MemoryPlan memory_;
  Services services_;
  DatasetsService datasets_;
  IngestService ingest_;
  JobsService jobs_;
  RenderService render_;
  CoefficientsService coefficients_;
  std::string address_;  // not changed after Serve
  std::unique_ptr<grpc::experimental::ExternalConnectionAcceptor> connections_;  // likewise
  std::shared_ptr<TlsCredentials> tls_;           // likewise; null: plaintext
  std::unique_ptr<FileWatch> token_watch_;        // not changed after Watch
  std::unique_ptr<FileWatch> certificate_watch_;  // likewise
  std::unique_ptr<AdminServer> admin_;            // not changed after Tell; may be null
  std::mutex drain_mutex_;
  std::unique_ptr<Acceptor> acceptor_;    // guarded by drain_mutex_ once it runs
  std::unique_ptr<grpc::Server> server_;  // guarded by drain_mutex_ once it runs
};

}  // namespace

StatusOr<std::unique_ptr<Server>> Server::Start(const ServerOptions& options) {
  FOVEA_ASSIGN_OR_RETURN(const wire::HostPort address, wire::ParseHostPort(options.listen));
  FOVEA_RETURN_IF_ERROR(CheckExposure(address.loopback, options));
  FOVEA_ASSIGN_OR_RETURN(const int64_t limit_bytes,
                         ParseMemoryLimit(options.memory_limit, MachineBytes()));
  FOVEA_ASSIGN_OR_RETURN(const MemoryPlan memory, MemoryPlan::Divide(limit_bytes));
  std::unique_ptr<AdminServer> admin;
  if (!options.admin.empty()) {  // first: it says "starting" while the catalogue is read
    FOVEA_ASSIGN_OR_RETURN(admin, AdminServer::Start(options.admin, options.admin_any_address));
  }
  // What is short comes first: a wrong flag is not to be found below a list of datasets.
  SeenFiles seen{FileWatch::Look({options.tokens}), FileWatch::Look(options.tls.Paths())};
  FOVEA_ASSIGN_OR_RETURN(auto gate, access::Gate::Open(options.tokens));
  std::optional<Certificates> certificates;
  if (options.tls.given()) {
    FOVEA_ASSIGN_OR_RETURN(certificates, LoadCertificates(options.tls));
    spdlog::info("certificate: {}", certificates->summary);
  }
  FOVEA_ASSIGN_OR_RETURN(auto catalogue,
                         Catalogue::Open(options.root, options.rescan_interval,
                                         std::make_shared<frames::VolumeCache>(memory.volumes)));
  FOVEA_ASSIGN_OR_RETURN(Listener listener, Listen(address));
  FOVEA_RETURN_IF_ERROR(CheckExposure(listener.loopback, options));
  if (!listener.loopback && options.tokens.empty() && options.tls.client_ca.empty()) {
    spdlog::warn("whoever reaches {} may see everything: neither --tokens nor --tls-client-ca",
                 options.listen);
  }
  FOVEA_ASSIGN_OR_RETURN(auto jobs, OpenJobs(options, catalogue.get()));
  SetUpGrpc();
  auto server =
      std::make_unique<GrpcServer>(std::move(catalogue), std::move(gate), options, memory);
  server->KeepJobs(std::move(jobs));
  FOVEA_RETURN_IF_ERROR(
      server->Serve(std::move(listener), LimitsOf(options), std::move(certificates)));
  server->TidyUp();
  server->Watch(options, std::move(seen));
  server->Tell(std::move(admin));
  return server;
}

}  // namespace fovea::server
