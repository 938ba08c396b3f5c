// What a server does under load, from outside:
//   load_bench FOVEAD ROOT DATASET MODE [SECONDS [FOVEAD_FLAG...]]
// Starts FOVEAD over ROOT, with 2 GiB of memory, and calls it over loopback. Calls come
// at fixed times, whatever the server does, and are timed from when they were due. MODE:
//   frame     RenderFrame, RAW_RGBA8, 512 x 512, rate 40, cached step, in turns with the same frame
//             made in this process from the same volume; medians
//   clients   200 clients ask for 5 frames a second each (256 x 256, JPEG, rate 25)
//   large     40 clients ask for 200 frames a second of 64 MiB each (2048 x 2048, RAW_RGBA_F32,
//             rate 200)
//   overload  10 times what the server can do (measured first), then a load of 0.8 times that
//   apart     the same, the server on processor 0 and the clients on 1: what refusing costs the
//             server, without what asking costs
//   slow      a stream of window 2 whose client takes 50 ms a frame: how old each frame is when it
//             comes, since the acknowledgement that asked for it
//   soak      0.8 times what the server can do; resident memory twice a minute

#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include <fmt/format.h>
#include <grpcpp/grpcpp.h>
#include <sched.h>
#include <signal.h>

#include "fovea/v1/render.grpc.pb.h"
#include "service/frames/frames.h"
#include "service/wire/convert.h"

namespace fovea {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;
using std::chrono::seconds;

double Ms(Clock::duration duration) {
  return std::chrono::duration<double, std::milli>(duration).count();
}

double At(std::vector<double>& values, double part) {
  if (values.empty()) {
    return 0;
  }
  std::sort(values.begin(), values.end());
  const auto index = static_cast<size_t>(part * static_cast<double>(values.size()));
  return values[std::min(values.size() - 1, index)];
}

/// A fovead of this process.
class Child {
 public:
  Child(const std::string& fovead, const std::string& root, const std::vector<std::string>& flags) {
    int fds[2];
    if (pipe(fds) != 0 || (pid_ = fork()) < 0) {
      std::exit(1);
    }
    if (pid_ == 0) {
      dup2(fds[1], STDOUT_FILENO);
      std::vector<std::string> words = {fovead,           root,   "--listen",    "127.0.0.1:0",
                                        "--memory-limit", "2GiB", "--log-level", "err"};
      words.insert(words.end(), flags.begin(), flags.end());
      std::vector<char*> argv;
      for (std::string& word : words) {
        argv.push_back(word.data());
      }
      argv.push_back(nullptr);
      execv(fovead.c_str(), argv.data());
      _exit(1);
    }
    close(fds[1]);
    FILE* out = fdopen(fds[0], "r");
    char line[256] = "";
    if (std::fgets(line, sizeof(line), out) == nullptr) {
      fmt::print(stderr, "{} does not serve\n", fovead);
      std::exit(1);
    }
    const std::string text(line);
    address_ = text.substr(text.rfind(' ') + 1);
    address_.pop_back();
  }
  ~Child() {
    kill(pid_, SIGTERM);
    waitpid(pid_, nullptr, 0);
  }

  [[nodiscard]] const std::string& address() const { return address_; }
  [[nodiscard]] double ResidentMiB() const {
    int64_t size = 0;
    int64_t resident = 0;
    std::ifstream("/proc/" + std::to_string(pid_) + "/statm") >> size >> resident;
    return static_cast<double>(resident * sysconf(_SC_PAGESIZE)) / (1 << 20);
  }

 private:
  pid_t pid_ = -1;
  std::string address_;
};

std::unique_ptr<v1::Render::Stub> Connect(const std::string& address) {
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(wire::kMaxReplyMessageBytes);
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);  // a connection of its own
  arguments.SetInt(GRPC_ARG_HTTP2_BDP_PROBE, 0);
  return v1::Render::NewStub(
      grpc::CreateCustomChannel(address, grpc::InsecureChannelCredentials(), arguments));
}

v1::FrameSpec Spec(v1::Encoding encoding, uint32_t side, double rate, double azimuth_deg) {
  v1::FrameSpec spec;
  spec.set_encoding(encoding);
  spec.set_width_px(side);
  spec.set_height_px(side);
  spec.set_rate(rate);
  spec.mutable_view()->mutable_orthographic()->set_azimuth_deg(azimuth_deg);
  spec.mutable_view()->mutable_orthographic()->set_elevation_deg(20);
  return spec;
}

/// What became of the calls that were due in one interval. Thread-safe.
struct Outcomes {
  std::mutex mutex;
  std::vector<double> served_ms;
  int64_t shed = 0;
  int64_t failed = 0;
  std::string failure;  // the first
  std::atomic<int64_t> running = 0;

  void Add(const grpc::Status& status, double ms) {
    const std::lock_guard lock(mutex);
    if (status.ok()) {
      served_ms.push_back(ms);
    } else if (status.error_code() == grpc::StatusCode::RESOURCE_EXHAUSTED) {
      ++shed;
    } else if (++failed == 1) {
      failure =
          fmt::format("{}: {}", static_cast<int>(status.error_code()), status.error_message());
    }
  }
  void AwaitAll() const {
    while (running > 0) {
      std::this_thread::sleep_for(milliseconds(1));
    }
  }
  void Print(const char* what, double duration_s) {
    fmt::print(
        "{}: {:.1f} served a second, p50 {:.1f} ms, p99 {:.1f} ms; {} served, {} shed, {} "
        "failed{}{}\n",
        what, static_cast<double>(served_ms.size()) / duration_s, At(served_ms, 0.5),
        At(served_ms, 0.99), served_ms.size(), shed, failed, failed > 0 ? ": " : "", failure);
    std::fflush(stdout);
  }
};

class Load {
 public:
  Load(const std::string& address, std::string dataset, int clients,
       v1::FrameSpec spec = Spec(v1::JPEG, 256, 25, 0))
      : dataset_(std::move(dataset)), spec_(std::move(spec)) {
    for (int i = 0; i < clients; ++i) {
      stubs_.push_back(Connect(address));
    }
  }

  /// One frame of the load, asked for now, that was due then.
  void Ask(int64_t index, Clock::time_point due, Outcomes* outcomes) {
    struct Call {
      grpc::ClientContext context;
      v1::RenderFrameRequest request;
      v1::Frame frame;
    };
    auto call = std::make_shared<Call>();
    call->request.set_dataset(dataset_);
    *call->request.mutable_spec() = spec_;
    call->request.mutable_spec()->mutable_view()->mutable_orthographic()->set_azimuth_deg(
        static_cast<double>(index * 7 % 360));
    ++outcomes->running;
    auto& stub = *stubs_[static_cast<size_t>(index) % stubs_.size()];
    stub.async()->RenderFrame(&call->context, &call->request, &call->frame,
                              [call, due, outcomes](const grpc::Status& status) {
                                outcomes->Add(status, Ms(Clock::now() - due));
                                --outcomes->running;
                              });
  }

  /// `rate` calls a second, for so long; returns when all have ended.
  void Run(double rate, double duration_s, Outcomes* outcomes) {
    const Clock::time_point start = Clock::now();
    const auto calls = static_cast<int64_t>(rate * duration_s);
    for (int64_t i = 0; i < calls; ++i) {
      const auto due = start + std::chrono::duration_cast<Clock::duration>(
                                   std::chrono::duration<double>(static_cast<double>(i) / rate));
      std::this_thread::sleep_until(due);
      Ask(next_++, due, outcomes);
    }
    outcomes->AwaitAll();
  }

  /// Frames a second with `at_once` calls always under way.
  double Capacity(int at_once, seconds duration) {
    Outcomes outcomes;
    const Clock::time_point start = Clock::now();
    while (Clock::now() - start < duration) {
      while (outcomes.running < at_once) {
        Ask(next_++, Clock::now(), &outcomes);
      }
      std::this_thread::sleep_for(std::chrono::microseconds(200));
    }
    const double served = static_cast<double>(outcomes.served_ms.size());
    const double took_s = Ms(Clock::now() - start) / 1e3;
    outcomes.AwaitAll();
    return served / took_s;
  }

 private:
  const std::string dataset_;
  const v1::FrameSpec spec_;
  std::vector<std::unique_ptr<v1::Render::Stub>> stubs_;
  int64_t next_ = 0;
};

template <typename T>
T ValueOf(StatusOr<T> value) {
  if (!value.ok()) {
    fmt::print(stderr, "{}\n", MessageOf(value.status()));
    std::exit(1);
  }
  return *std::move(value);
}

void MeasureFrame(const Child& child, const std::string& root, const std::string& name) {
  const auto stub = Connect(child.address());
  const auto dataset = ValueOf(store::Dataset::Open(root + "/" + name + ".zarr"));
  const frames::FrameSpec defaults = ValueOf(frames::DefaultSpec(*dataset));
  frames::VolumeCache volumes(int64_t{1} << 30);
  std::vector<double> engine_ms;
  std::vector<double> served_ms;
  constexpr int kTurns = 200;
  for (int i = 0; i < kTurns; ++i) {
    v1::RenderFrameRequest request;
    request.set_dataset(name);
    *request.mutable_spec() = Spec(v1::RAW_RGBA8, 512, 40, i % 90);
    const frames::FrameSpec spec = ValueOf(
        frames::ResolveSpec(*dataset, ValueOf(wire::FromProto(request.spec(), "spec")), defaults));
    Clock::time_point start = Clock::now();
    const frames::Frame expected =
        ValueOf(frames::RenderFrame(*dataset, name, 0, spec, 0, {&volumes, 1}));
    engine_ms.push_back(Ms(Clock::now() - start));
    grpc::ClientContext context;
    v1::Frame frame;
    start = Clock::now();
    const grpc::Status status = stub->RenderFrame(&context, request, &frame);
    served_ms.push_back(Ms(Clock::now() - start));
    if (!status.ok() || frame.pixels() != expected.pixels) {
      fmt::print(stderr, "not the same frame: {}\n", status.error_message());
      std::exit(1);
    }
  }
  const double engine = At(engine_ms, 0.5);
  const double served = At(served_ms, 0.5);
  fmt::print(
      "engine {:.2f} ms, served {:.2f} ms: 1.15 x + 0.5 ms would be {:.2f} ms ({:.3f} x + "
      "0.5)\n",
      engine, served, 1.15 * engine + 0.5, (served - 0.5) / engine);
}

void MeasureWithMemory(const Child& child, Load* load, double rate, double duration_s,
                       const char* what) {
  std::atomic<bool> stop = false;
  double most_mib = 0;
  std::thread memory([&] {
    while (!stop) {
      most_mib = std::max(most_mib, child.ResidentMiB());
      std::this_thread::sleep_for(milliseconds(10));
    }
  });
  Outcomes outcomes;
  load->Run(rate, duration_s, &outcomes);
  stop = true;
  memory.join();
  outcomes.Print(what, duration_s);
  fmt::print("resident memory: at most {:.0f} MiB of 2048\n", most_mib);
}

void MeasureClients(const Child& child, const std::string& name, double duration_s) {
  Load load(child.address(), name, 200);
  MeasureWithMemory(child, &load, 1000, duration_s, "200 clients, 5 frames a second each");
}

void MeasureLarge(const Child& child, const std::string& name, double duration_s) {
  Load load(child.address(), name, 40, Spec(v1::RAW_RGBA_F32, 2048, 200, 0));
  MeasureWithMemory(child, &load, 200, duration_s, "frames of 64 MiB, 200 a second asked for");
}

void MeasureOverload(const Child& child, const std::string& name, double duration_s) {
  Load load(child.address(), name, 20);
  load.Capacity(4, seconds(3));
  const double capacity = load.Capacity(4, seconds(10));
  fmt::print("unloaded goodput (4 calls at once): {:.1f} frames a second\n", capacity);
  Outcomes calm;
  load.Run(0.8 * capacity, 5, &calm);
  calm.Print("0.8 times that", 5);
  Outcomes over;
  load.Run(10 * capacity, duration_s, &over);
  over.Print("10 times that", duration_s);
  fmt::print("goodput under overload: {:.2f} of unloaded; memory {:.0f} MiB\n",
             static_cast<double>(over.served_ms.size()) / duration_s / capacity,
             child.ResidentMiB());
  for (int i = 0; i < 6; ++i) {
    Outcomes after;
    load.Run(0.8 * capacity, 1, &after);
    after.Print(fmt::format("0.8 times, second {} after it", i).c_str(), 1);
  }
}

void MeasureSlow(const Child& child, const std::string& name, double duration_s) {
  const auto stub = Connect(child.address());
  const std::string id = "load-bench-slow-client";
  std::vector<double> ages_ms;
  std::vector<Clock::time_point> acknowledged;
  const Clock::time_point end = Clock::now() + std::chrono::duration_cast<Clock::duration>(
                                                   std::chrono::duration<double>(duration_s));
  while (Clock::now() < end) {
    grpc::ClientContext context;
    v1::RenderSequenceRequest request;
    request.set_dataset(name);
    *request.mutable_spec() = Spec(v1::RAW_RGBA8, 320, 25, 30);
    request.set_window(2);
    request.set_stream_id(id);
    const auto reader = stub->RenderSequence(&context, request);
    acknowledged.clear();
    v1::Frame frame;
    while (reader->Read(&frame)) {
      // Frame i is asked for when frame i - 2 was acknowledged.
      if (frame.index() >= 2) {
        ages_ms.push_back(Ms(Clock::now() - acknowledged[frame.index() - 2]));
      }
      std::this_thread::sleep_for(milliseconds(50));
      grpc::ClientContext acknowledge_context;
      v1::AcknowledgeRequest acknowledge;
      acknowledge.set_stream_id(id);
      acknowledge.set_index(frame.index());
      v1::AcknowledgeResponse response;
      acknowledged.push_back(Clock::now());
      stub->Acknowledge(&acknowledge_context, acknowledge, &response);
    }
    const grpc::Status status = reader->Finish();
    if (!status.ok()) {
      fmt::print(stderr, "the stream failed: {}\n", status.error_message());
      std::exit(1);
    }
  }
  fmt::print(
      "age of a frame when a client of 50 ms a frame takes it, window 2: p50 {:.1f} ms, p99 "
      "{:.1f} ms ({} frames)\n",
      At(ages_ms, 0.5), At(ages_ms, 0.99), ages_ms.size());
}

void Soak(const Child& child, const std::string& name, double duration_s) {
  Load load(child.address(), name, 20);
  load.Capacity(4, seconds(3));
  const double capacity = load.Capacity(4, seconds(10));
  fmt::print("0.8 of {:.1f} frames a second\n", capacity);
  constexpr double kInterval = 30;
  for (double at = 0; at < duration_s; at += kInterval) {
    Outcomes outcomes;
    load.Run(0.8 * capacity, std::min(kInterval, duration_s - at), &outcomes);
    outcomes.Print(fmt::format("{:.0f} s, {:.1f} MiB", at + kInterval, child.ResidentMiB()).c_str(),
                   kInterval);
  }
}

/// All that this thread starts from now on runs on this processor.
void StayOn(int processor) {
  cpu_set_t only;
  CPU_ZERO(&only);
  CPU_SET(processor, &only);
  if (sched_setaffinity(0, sizeof(only), &only) != 0) {
    fmt::print(stderr, "load_bench: there is no processor {}\n", processor);
    std::exit(1);
  }
}

int Main(int argc, char** argv) {
  if (argc < 5) {
    fmt::print(
        stderr,
        "load_bench FOVEAD ROOT DATASET frame|clients|large|overload|apart|slow|soak [SECONDS "
        "[FOVEAD_FLAG...]]\n");
    return 2;
  }
  const std::string root = argv[2];
  const std::string name = argv[3];
  const std::string mode = argv[4];
  const double duration_s = argc > 5 ? std::atof(argv[5]) : 30;
  if (mode == "apart") {
    StayOn(0);  // the child does, too
  }
  const Child child(argv[1], root, {argv + std::min(argc, 6), argv + argc});
  if (mode == "apart") {
    StayOn(1);
  }
  if (mode == "frame") {
    MeasureFrame(child, root, name);
  } else if (mode == "clients") {
    MeasureClients(child, name, duration_s);
  } else if (mode == "large") {
    MeasureLarge(child, name, duration_s);
  } else if (mode == "overload" || mode == "apart") {
    MeasureOverload(child, name, duration_s);
  } else if (mode == "slow") {
    MeasureSlow(child, name, duration_s);
  } else if (mode == "soak") {
    Soak(child, name, duration_s);
  } else {
    fmt::print(stderr, "load_bench: there is no mode '{}'\n", mode);
    return 2;
  }
  return 0;
}

}  // namespace
}  // namespace fovea

int main(int argc, char** argv) {
  return fovea::Main(argc, argv);
}
