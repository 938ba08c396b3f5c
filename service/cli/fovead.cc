// The command line of fovead.

#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <string>
#include <thread>

#include <CLI/CLI.hpp>
#include <fmt/format.h>
#include <signal.h>
#include <spdlog/spdlog.h>

#include "engine/base/status.h"
#include "service/cli/checks.h"
#include "service/server/acceptor.h"
#include "service/server/log.h"
#include "service/server/server.h"

namespace fovea::cli {
namespace {

using server::Server;

constexpr int kExitFailed = 1;
constexpr int kExitUsage = 2;

constexpr char kFooter[] =
    "Serves fovea.v1 (Coefficients, Datasets, Ingest, Jobs, Render), grpc.health.v1 and "
    "reflection\n"
    "over every NAME.zarr below ROOT. The first line on stdout is 'fovead listening on grpc\n"
    "ADDR:PORT'; the log goes to stderr. SIGTERM or Ctrl-C: no new calls, running ones\n"
    "finish; a second one stops at once.\n\n"
    "Examples:\n"
    "  fovead ~/volumes\n"
    "  fovead ~/volumes --listen 127.0.0.1:0 --threads 4\n"
    "  fovead ~/volumes --listen [::]:50051 --tls-cert me.crt --tls-key me.key --tokens "
    "tokens.json\n"
    "  fovea render plume --server 127.0.0.1:50051 --step 3 -o frame.png\n\n"
    "Exit status: 0 stopped cleanly, 1 failed, 2 wrong usage.";

struct Flags {
  server::ServerOptions server;
  int drain_delay_seconds = 0;
  int drain_seconds = 30;
  std::string log_level = "info";
  std::string log_format = "text";
};

/// Who may reach the server, and as whom.
void AddAccessFlags(CLI::App& app, Flags* flags) {
  app.add_flag("--insecure-plaintext", flags->server.insecure_plaintext,
               "Allow addresses that other machines can reach, unencrypted");
  app.add_option("--tls-cert", flags->server.tls.certificate,
                 "Serve TLS with this certificate, and those between it and its authority (PEM); "
                 "read again when it changes")
      ->type_name("FILE");
  app.add_option("--tls-key", flags->server.tls.key, "The key of --tls-cert (PEM)")
      ->type_name("FILE");
  app.add_option("--tls-client-ca", flags->server.tls.client_ca,
                 "Ask clients for a certificate of one of these authorities (PEM)")
      ->type_name("FILE");
  app.add_option("--tokens", flags->server.tokens,
                 "Ask for a bearer token of this file (`fovea token` makes it); read again when it "
                 "changes")
      ->type_name("FILE");
}

/// What clients may write, and where.
void AddWritingFlags(CLI::App& app, Flags* flags) {
  app.add_flag(
      "--allow-ingest", flags->server.allow_ingest,
      "Let everyone who reaches the port write readings into datasets; with --tokens, their "
      "rights alone decide");
  app.add_option("--state", flags->server.state,
                 "Keep jobs (fovea.v1.Jobs) in this folder, so that a restart goes on with them")
      ->type_name("DIR");
  app.add_option("--ingest-root", flags->server.ingest_root,
                 "Files below this folder may be ingested by whoever may write (IngestFiles)")
      ->type_name("DIR");
  app.add_option("--export-root", flags->server.export_root,
                 "Exports write below this folder (CreateExport)")
      ->type_name("DIR");
  app.add_option("--jobs", flags->server.jobs, "Jobs that run at once")
      ->check(Whole(1, 64))
      ->type_name("N")
      ->capture_default_str();
}

void AddFlags(CLI::App& app, Flags* flags) {
  app.footer(kFooter);
  app.set_version_flag("--version", "fovead " FOVEA_VERSION);
  app.add_option("ROOT", flags->server.root, "Directory; its datasets are NAME.zarr, at any depth")
      ->required();
  app.add_option("--listen", flags->server.listen, "HOST:PORT; port 0 takes any free one")
      ->capture_default_str();
  app.add_option(
         "--admin", flags->server.admin,
         "Serve /livez, /readyz and /metrics over HTTP here; loopback only, unless told otherwise")
      ->type_name("HOST:PORT");
  app.add_flag("--admin-any-address", flags->server.admin_any_address,
               "Allow an --admin address that other machines can reach: it asks nobody who they "
               "are");
  app.add_option("--memory-limit", flags->server.memory_limit,
                 "Memory of the whole process: an amount, or a share of the machine's")
      ->type_name("16GB|50%")
      ->capture_default_str();
  app.add_option("--threads", flags->server.threads, "Threads that render; 0: all processors")
      ->check(Whole(0, 1024))
      ->type_name("N")
      ->capture_default_str();
  app.add_option("--render-queue", flags->server.render_queue,
                 "Calls that may wait to be rendered; more are refused (RESOURCE_EXHAUSTED)")
      ->check(Whole(1, 100'000))
      ->type_name("N")
      ->capture_default_str();
  app.add_option("--max-connections", flags->server.max_connections,
                 "Connections that may be open, more are closed at once; 0: 1000, or half of what "
                 "ulimit -n allows")
      ->check(Whole(0, 1'000'000))
      ->type_name("N")
      ->capture_default_str();
  app.add_option("--max-connections-per-address", flags->server.max_connections_per_address,
                 "Of these, from one IPv4 address or one /64 of IPv6")
      ->check(Whole(1, 1'000'000))
      ->type_name("N")
      ->capture_default_str();
  app.add_option(
         "--drain-delay-seconds", flags->drain_delay_seconds,
         "How long calls are still taken after SIGTERM, while /readyz and the health service "
         "say no: until balancers have noticed")
      ->check(Whole(0, 3600))
      ->type_name("N")
      ->capture_default_str();
  app.add_option("--drain-seconds", flags->drain_seconds,
                 "How long running calls may go on after SIGTERM")
      ->check(Whole(0, 86'400))
      ->type_name("N")
      ->capture_default_str();
  AddAccessFlags(app, flags);
  AddWritingFlags(app, flags);
  app.add_option("--log-level", flags->log_level, "trace, debug, info, warn, err or off")
      ->check(CLI::IsMember({"trace", "debug", "info", "warn", "err", "off"}))
      ->capture_default_str();
  app.add_option("--log-format", flags->log_format, "text, or json: one object a line")
      ->check(CLI::IsMember({"text", "json"}))
      ->capture_default_str();
}

/// The signals that stop a server, blocked in every thread so that main can wait for them.
sigset_t BlockStopSignals() {
  sigset_t stop;
  sigemptyset(&stop);
  sigaddset(&stop, SIGTERM);
  sigaddset(&stop, SIGINT);
  pthread_sigmask(SIG_BLOCK, &stop, nullptr);
  return stop;
}

void ExitAtOnce(int /*signal*/) {
  constexpr char kMessage[] = "fovead: second signal, stopping at once\n";
  static_cast<void>(!write(STDERR_FILENO, kMessage, sizeof(kMessage) - 1));
  _exit(kExitFailed);
}

/// From now on the stop signals end the process.
void StopAtOnceOn(const sigset_t& stop) {
  struct sigaction action {};
  action.sa_handler = ExitAtOnce;
  sigaction(SIGTERM, &action, nullptr);
  sigaction(SIGINT, &action, nullptr);
  pthread_sigmask(SIG_UNBLOCK, &stop, nullptr);
}

int Serve(const Flags& flags) {
  const sigset_t stop = BlockStopSignals();
  signal(SIGPIPE, SIG_IGN);
  signal(SIGXFSZ, SIG_IGN);  // a file that may not grow is an error of its write
  server::RaiseDescriptorLimit();
  auto running = Server::Start(flags.server);
  if (!running.ok()) {
    fmt::print(stderr, "fovead: {}\n", MessageOf(running.status()));
    return absl::IsInvalidArgument(running.status()) ? kExitUsage : kExitFailed;
  }
  fmt::print("fovead listening on grpc {}\n", (*running)->address());
  if (const std::string admin = (*running)->admin_address(); !admin.empty()) {
    fmt::print("fovead admin on http {}\n", admin);
  }
  std::fflush(stdout);
  spdlog::info("serving {} datasets below '{}' on {}", (*running)->dataset_count(),
               flags.server.root, (*running)->address());

  int signal_number = 0;
  sigwait(&stop, &signal_number);
  StopAtOnceOn(stop);
  if (flags.drain_delay_seconds > 0) {
    spdlog::info("{}: not ready any more; calls are taken for {} s", strsignal(signal_number),
                 flags.drain_delay_seconds);
    (*running)->SayNotReady();
    std::this_thread::sleep_for(std::chrono::seconds(flags.drain_delay_seconds));
  }
  spdlog::info("{}: no new calls; running ones may take {} s", strsignal(signal_number),
               flags.drain_seconds);
  const int64_t cut = (*running)->Drain(std::chrono::seconds(flags.drain_seconds));
  spdlog::info("stopped; {} frames rendered, {} calls cut short", (*running)->frames_rendered(),
               cut);
  return 0;
}

int Main(int argc, char** argv) {
  CLI::App app("Renders foveated volumes for other programs, over gRPC", "fovead");
  Flags flags;
  AddFlags(app, &flags);
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& help) {
    return app.exit(help);
  } catch (const CLI::ParseError& error) {
    fmt::print(stderr, "fovead: {}\nRun with --help for more information.\n", error.what());
    return kExitUsage;
  }
  server::SetUpLog(flags.log_level, flags.log_format == "json" ? server::LogFormat::kJson
                                                               : server::LogFormat::kText);
  return Serve(flags);
}

}  // namespace
}  // namespace fovea::cli

int main(int argc, char** argv) {
  return fovea::cli::Main(argc, argv);
}
