// How soon pictures come: RefineFrame on steps that are not in memory, and Explore while the view
// moves. docs/performance.md, "Looking around".
//
//   explore_bench ROOT DATASET [RATE]

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include <grpcpp/grpcpp.h>

#include "engine/base/stopwatch.h"
#include "fovea/v1/datasets.grpc.pb.h"
#include "fovea/v1/render.grpc.pb.h"
#include "service/server/server.h"
#include "service/wire/convert.h"

namespace fovea {
namespace {

namespace fs = std::filesystem;
constexpr int kRounds = 9;
constexpr double kBudgetMs = 30;

double Median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

/// The store's files leave the page cache.
void DropFromMemory(const std::string& store) {
  for (const auto& entry : fs::recursive_directory_iterator(store)) {
    if (const int fd = ::open(entry.path().c_str(), O_RDONLY); fd >= 0) {
      ::fsync(fd);
      ::posix_fadvise(fd, 0, 0, POSIX_FADV_DONTNEED);
      ::close(fd);
    }
  }
}

v1::FrameSpec Spec(double rate, double azimuth) {
  v1::FrameSpec spec;
  spec.set_rate(rate);
  spec.set_encoding(v1::RAW_RGBA8);
  spec.mutable_view()->mutable_orthographic()->set_azimuth_deg(azimuth);
  spec.mutable_view()->mutable_orthographic()->set_elevation_deg(20);
  return spec;
}

void Check(const grpc::Status& status) {
  if (!status.ok()) {
    std::fprintf(stderr, "explore_bench: %s\n", status.error_message().c_str());
    std::exit(1);
  }
}

class Bench {
 public:
  Bench(const std::string& root, std::string dataset, double rate)
      : store_(root + "/" + dataset + ".zarr"), dataset_(std::move(dataset)), rate_(rate) {
    server::ServerOptions options;
    options.root = root;
    options.listen = "127.0.0.1:0";
    auto server = server::Server::Start(options);
    if (!server.ok()) {
      std::fprintf(stderr, "explore_bench: %s\n", std::string(MessageOf(server.status())).c_str());
      std::exit(1);
    }
    server_ = *std::move(server);
    grpc::ChannelArguments arguments;
    arguments.SetMaxReceiveMessageSize(wire::kMaxReplyMessageBytes);
    arguments.SetInt(GRPC_ARG_HTTP2_BDP_PROBE, 0);
    render_ = v1::Render::NewStub(grpc::CreateCustomChannel(
        server_->address(), grpc::InsecureChannelCredentials(), arguments));
  }

  void Refine(bool cold) {
    std::vector<double> first, last, single, frames;
    for (int round = 0; round < kRounds; ++round) {
      Prepare(cold);
      double first_ms = 0;
      int count = 0;
      const Stopwatch watch;
      v1::RefineFrameRequest request;
      request.set_dataset(dataset_);
      *request.mutable_spec() = AnotherSpec(cold);
      grpc::ClientContext context;
      const auto reader = render_->RefineFrame(&context, request);
      for (v1::Frame frame; reader->Read(&frame); ++count) {
        first_ms = count == 0 ? watch.ElapsedMs() : first_ms;
      }
      Check(reader->Finish());
      first.push_back(first_ms);
      last.push_back(watch.ElapsedMs());
      frames.push_back(count);
      Prepare(cold);
      single.push_back(RenderFrame(cold));
    }
    std::printf("%s: first picture %.1f ms, last %.1f ms (%.0f frames); RenderFrame %.1f ms\n",
                cold ? "cold" : "warm", Median(first), Median(last), Median(frames),
                Median(single));
  }

  /// A view that turns by a degree every 16 ms, for so long, and then rests.
  void Turn(double seconds) {
    grpc::ClientContext context;
    const auto stream = render_->Explore(&context);
    const int views = static_cast<int>(1000 * seconds / 16);
    std::vector<double> sent_ms(static_cast<size_t>(views) + 1);
    const Stopwatch watch;
    std::thread sender([&] {
      for (int view = 1; view <= views; ++view) {
        v1::ExploreRequest request;
        if (view == 1) {
          request.set_dataset(dataset_);
          request.set_frame_budget_ms(kBudgetMs);
        }
        *request.mutable_spec() = Spec(rate_, view);
        request.set_view_id(static_cast<uint64_t>(view));
        request.set_moving(view < views);
        sent_ms[static_cast<size_t>(view)] = watch.ElapsedMs();
        stream->Write(request);
        std::this_thread::sleep_for(std::chrono::milliseconds(16));
      }
    });
    Watch(*stream, watch, sent_ms, views);
    sender.join();
    stream->WritesDone();
    Check(stream->Finish());
  }

 private:
  using Stream = grpc::ClientReaderWriter<v1::ExploreRequest, v1::Frame>;

  void Watch(Stream& stream, const Stopwatch& watch, const std::vector<double>& sent_ms,
             int views) {
    std::vector<double> ages, gaps, rates;
    double before = 0;
    for (v1::Frame frame; stream.Read(&frame);) {
      const double now = watch.ElapsedMs();
      const double age = now - sent_ms[frame.view_id()];
      if (frame.view_id() < static_cast<uint64_t>(views)) {
        ages.push_back(age);
        gaps.push_back(now - before);
        rates.push_back(frame.used().rate());
      }
      before = now;
      if (frame.view_id() == static_cast<uint64_t>(views) && frame.final()) {
        std::printf("  at rest: the last frame %.1f ms after the view\n", age);
        break;
      }
    }
    std::sort(ages.begin(), ages.end());
    std::printf(
        "  moving: %zu frames of %d views, %.1f ms from one to the next, rate %.0f; age of a frame "
        "%.1f ms, p95 %.1f ms (budget %.0f ms)\n",
        ages.size(), views, Median(gaps), Median(rates), Median(ages), ages[ages.size() * 95 / 100],
        kBudgetMs);
  }

  /// With a fovea that was not asked for before if `cold`: the server keeps volumes that it made.
  v1::FrameSpec AnotherSpec(bool cold) {
    v1::FrameSpec spec = Spec(rate_, 30);
    foveas_ += cold ? 1 : 0;
    spec.mutable_fovea()->mutable_at()->set_x(100 + 5 * foveas_);
    spec.mutable_fovea()->mutable_at()->set_y(120);
    spec.mutable_fovea()->mutable_at()->set_z(140);
    return spec;
  }

  void Prepare(bool cold) {
    if (cold) {
      DropFromMemory(store_);
    }
  }

  double RenderFrame(bool cold) {
    const Stopwatch watch;
    v1::RenderFrameRequest request;
    request.set_dataset(dataset_);
    *request.mutable_spec() = AnotherSpec(cold);
    grpc::ClientContext context;
    v1::Frame frame;
    Check(render_->RenderFrame(&context, request, &frame));
    return watch.ElapsedMs();
  }

  const std::string store_;
  const std::string dataset_;
  const double rate_;
  int foveas_ = 0;
  std::unique_ptr<server::Server> server_;
  std::unique_ptr<v1::Render::Stub> render_;
};

}  // namespace
}  // namespace fovea

int main(int argc, char** argv) {
  if (argc < 3) {
    std::fprintf(stderr, "usage: explore_bench ROOT DATASET [RATE]\n");
    return 2;
  }
  fovea::Bench bench(argv[1], argv[2], argc > 3 ? std::atof(argv[3]) : 40);
  bench.Refine(/*cold=*/true);
  bench.Refine(/*cold=*/false);
  std::printf("a view that turns, %s:\n", argv[2]);
  bench.Turn(4);
  return 0;
}
