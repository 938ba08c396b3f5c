// How soon a reading is in a picture, and a committed step is known:
//   live_bench FOLDER [SECONDS [READINGS [SIDE [RATE]]]]
// A server in this process, over gRPC: a client sends READINGS (10,000) a step, ten steps a second,
// in five batches a step, at fixed times whatever the server does; a viewer follows with frames of
// SIDE x SIDE pixels (512) at RATE (40), window 2. Each batch is timed from when it was due to the
// first frame of its step or a later one. A watcher is timed from the acknowledgement, and, for
// steps that another writer commits, from the commit. FOLDER is on the disk that is to be measured.

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <mutex>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include <fmt/format.h>
#include <grpcpp/grpcpp.h>
#include <spdlog/spdlog.h>

#include "engine/store/dataset_writer.h"
#include "fovea/v1/datasets.grpc.pb.h"
#include "fovea/v1/ingest.grpc.pb.h"
#include "fovea/v1/render.grpc.pb.h"
#include "service/server/server.h"
#include "service/wire/convert.h"
#include "service/wire/status.h"

namespace fovea::server {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr int kBatchesPerStep = 5;
constexpr milliseconds kStep{100};
constexpr int64_t kDims = 128;

double Ms(Clock::duration duration) {
  return std::chrono::duration<double, std::milli>(duration).count();
}

void Print(const char* what, std::vector<double> values) {
  if (values.empty()) {
    fmt::print("{}: nothing came\n", what);
    return;
  }
  std::sort(values.begin(), values.end());
  const auto at = [&](double part) {
    return values[std::min(values.size() - 1,
                           static_cast<size_t>(part * static_cast<double>(values.size())))];
  };
  fmt::print("{}: p50 {:.1f} ms, p90 {:.1f}, p99 {:.1f}, most {:.1f} ({} of them)\n", what, at(0.5),
             at(0.9), at(0.99), values.back(), values.size());
}

void Check(const Status& status, const char* what) {
  if (!status.ok()) {
    fmt::print(stderr, "{}: {}\n", what, std::string(MessageOf(status)));
    std::exit(1);
  }
}

/// When each step was first known of, by whom it concerns.
class Times {
 public:
  void Note(int64_t up_to, Clock::time_point now) {
    const std::lock_guard lock(mutex_);
    for (int64_t step = static_cast<int64_t>(times_.size()); step <= up_to; ++step) {
      times_.push_back(now);
    }
  }
  /// Of those that came.
  std::vector<Clock::time_point> Get() {
    const std::lock_guard lock(mutex_);
    return times_;
  }

 private:
  std::mutex mutex_;
  std::vector<Clock::time_point> times_;  // by step
};

struct Setup {
  int steps = 100;
  int readings = 10'000;
  uint32_t side = 512;
  double rate = 40;
};

v1::StreamReadingsRequest Header(const std::string& dataset) {
  v1::StreamReadingsRequest message;
  v1::ReadingsHeader& header = *message.mutable_header();
  header.set_dataset(dataset);
  header.set_step_seconds(Ms(kStep) / 1000);
  header.mutable_lower()->set_x(0);
  for (auto* vec : {header.mutable_upper(), header.mutable_voxel()}) {
    const double size = vec == &header.upper() ? static_cast<double>(kDims) : 1;
    vec->set_x(size);
    vec->set_y(size);
    vec->set_z(size);
  }
  return message;
}

/// Readings around a place that moves.
v1::StreamReadingsRequest Batch(int64_t index, int count, std::mt19937* random) {
  v1::StreamReadingsRequest message;
  v1::ReadingBatch& batch = *message.mutable_batch();
  batch.set_sequence(static_cast<uint64_t>(index) + 1);
  const int64_t batch_ns = std::chrono::nanoseconds(kStep).count() / kBatchesPerStep;
  std::normal_distribution<double> around(0, kDims / 8.0);
  const double middle = kDims * (0.5 + 0.2 * std::sin(static_cast<double>(index) * 0.02));
  const auto place = [&](double center) {
    return std::clamp(center + around(*random), 0.0, static_cast<double>(kDims));
  };
  for (int i = 0; i < count; ++i) {
    batch.add_time_ns(index * batch_ns + batch_ns * i / count);
    batch.add_x(place(middle));
    batch.add_y(place(kDims / 2.0));
    batch.add_z(place(kDims / 2.0));
    batch.add_value(static_cast<float>(1 + std::abs(around(*random))));
  }
  if ((index + 1) % kBatchesPerStep == 0) {
    batch.set_complete_before_ns((index + 1) * batch_ns);
  }
  return message;
}

class Bench {
 public:
  Bench(const std::string& root, const Setup& setup) : setup_(setup) {
    std::filesystem::create_directories(root);
    ServerOptions options;
    options.root = root;
    options.listen = "127.0.0.1:0";
    options.allow_ingest = true;
    auto server = Server::Start(options);
    Check(server.status(), "server");
    server_ = *std::move(server);
    grpc::ChannelArguments arguments;
    arguments.SetMaxReceiveMessageSize(wire::kMaxReplyMessageBytes);
    arguments.SetInt(GRPC_ARG_HTTP2_BDP_PROBE, 0);
    const auto connect = [&](int number) {
      arguments.SetInt("fovea.bench", number);  // a connection of its own
      return grpc::CreateCustomChannel(server_->address(), grpc::InsecureChannelCredentials(),
                                       arguments);
    };
    ingest_ = v1::Ingest::NewStub(connect(0));
    render_ = v1::Render::NewStub(connect(1));
    datasets_ = v1::Datasets::NewStub(connect(2));
  }

  void MeasureReadings() {
    grpc::ClientContext sending;
    const auto call = ingest_->StreamReadings(&sending);
    call->Write(Header("live"));
    v1::StreamReadingsResponse response;
    call->Read(&response);
    std::mt19937 random(1);
    for (int64_t i = 0; i < kBatchesPerStep; ++i) {  // step 0, so that there is something to see
      call->Write(Batch(i, setup_.readings / kBatchesPerStep, &random));
    }
    while (response.committed_steps() < 1 && call->Read(&response)) {
    }
    Times acknowledged;
    acknowledged.Note(0, Clock::now());
    std::thread acknowledging([&] {
      while (call->Read(&response)) {
        acknowledged.Note(static_cast<int64_t>(response.committed_steps()) - 1, Clock::now());
      }
    });
    grpc::ClientContext following, watching;
    std::thread viewer([&] { Follow(&following); });
    std::thread watcher([&] { Watch("live", &watching, &told_); });
    std::this_thread::sleep_for(milliseconds(500));
    SendSteps(call.get(), &random);
    std::this_thread::sleep_for(milliseconds(1000));
    v1::StreamReadingsRequest last = Batch((setup_.steps + 1) * kBatchesPerStep, 0, &random);
    last.mutable_batch()->set_last(true);
    call->Write(last);
    call->WritesDone();
    acknowledging.join();
    Check(wire::FromGrpc(call->Finish()), "StreamReadings");
    following.TryCancel();
    watching.TryCancel();
    viewer.join();
    watcher.join();
    Report(acknowledged.Get());
  }

  /// Steps of another writer, of which the server is told by nobody.
  void MeasureWatch(const std::string& path) {
    Times told;
    grpc::ClientContext watching;
    std::thread watcher([&] { Watch("live", &watching, &told); });
    auto writer = store::DatasetWriter::Append(path);
    Check(writer.status(), "writer");
    const int64_t before = (*writer)->info().committed_steps;
    std::vector<double> latency;
    std::vector<Clock::time_point> committed;
    for (int i = 0; i < 50; ++i) {
      WriteEmptyStep(writer->get());
      committed.push_back(Clock::now());
      std::this_thread::sleep_for(milliseconds(30 + 7 * (i % 5)));
    }
    std::this_thread::sleep_for(milliseconds(200));
    watching.TryCancel();
    watcher.join();
    const std::vector<Clock::time_point> times = told.Get();
    for (size_t i = 0; i < committed.size(); ++i) {
      const size_t step = static_cast<size_t>(before) + i;
      if (step < times.size()) {
        latency.push_back(Ms(times[step] - committed[i]));
      }
    }
    Print("another writer's commit to its watcher", latency);
  }

 private:
  static void WriteEmptyStep(store::DatasetWriter* writer) {
    const store::DatasetInfo& info = writer->info();
    CoefficientSet set;
    set.hierarchy = info.hierarchy;
    set.coarse = Grid(Box3::OfSize(info.hierarchy.DimsAt(0)));
    for (int level = 0; level < info.hierarchy.finest(); ++level) {
      set.detail.emplace_back(info.hierarchy.DimsAt(level), info.chunk_edge, 7, 0.0F);
    }
    FieldStats stats;
    stats.histogram[0] = static_cast<uint64_t>(info.hierarchy.dims().Product());
    for (const store::FieldInfo& field : info.fields) {
      Check(writer->WriteField(field.name, set, stats), "WriteField");
    }
    Check(writer->Commit(int64_t{1} << 60, std::nullopt), "Commit");
  }

  void SendSteps(
      grpc::ClientReaderWriter<v1::StreamReadingsRequest, v1::StreamReadingsResponse>* call,
      std::mt19937* random) {
    const Clock::time_point start = Clock::now();
    for (int64_t i = 0; i < setup_.steps * kBatchesPerStep; ++i) {
      const auto batch = Batch(i + kBatchesPerStep, setup_.readings / kBatchesPerStep, random);
      const Clock::time_point due = start + kStep * (i + 1) / kBatchesPerStep;
      std::this_thread::sleep_until(due);
      due_.push_back(due);
      call->Write(batch);
    }
  }

  void Follow(grpc::ClientContext* context) {
    v1::RenderSequenceRequest request;
    request.set_dataset("live");
    request.set_follow(true);
    request.set_window(2);
    request.set_stream_id("live-bench-0123456789");
    request.mutable_spec()->set_encoding(v1::JPEG);
    request.mutable_spec()->set_width_px(setup_.side);
    request.mutable_spec()->set_height_px(setup_.side);
    request.mutable_spec()->set_rate(setup_.rate);
    const auto reader = render_->RenderSequence(context, request);
    v1::Frame frame;
    while (reader->Read(&frame)) {
      const Clock::time_point now = Clock::now();
      seen_.Note(static_cast<int64_t>(frame.step()), now);
      const v1::FrameStats& stats = frame.stats();
      frame_ms_.push_back(stats.read_ms() + stats.reconstruct_ms() + stats.render_ms() +
                          stats.smooth_warp_ms() + stats.encode_ms());
      v1::AcknowledgeRequest acknowledge;
      acknowledge.set_stream_id(request.stream_id());
      acknowledge.set_index(frame.index());
      v1::AcknowledgeResponse none;
      grpc::ClientContext unary;
      Check(wire::FromGrpc(render_->Acknowledge(&unary, acknowledge, &none)), "Acknowledge");
    }
  }

  void Watch(const std::string& dataset, grpc::ClientContext* context, Times* told) {
    v1::WatchDatasetRequest request;
    request.set_dataset(dataset);
    const auto reader = datasets_->WatchDataset(context, request);
    v1::DatasetEvent event;
    while (reader->Read(&event)) {
      told->Note(static_cast<int64_t>(event.committed_steps()) - 1, Clock::now());
    }
  }

  void Report(const std::vector<Clock::time_point>& acknowledged) {
    const auto seen = seen_.Get();
    const auto told = told_.Get();
    std::vector<double> first, last, committed, watched;
    for (size_t i = 0; i < due_.size(); ++i) {
      const size_t step = 1 + i / kBatchesPerStep;
      if (step >= seen.size() || step >= told.size() || step >= acknowledged.size()) {
        continue;
      }
      const double age = Ms(seen[step] - due_[i]);
      if (i % kBatchesPerStep == 0) {
        first.push_back(age);
      }
      if (i % kBatchesPerStep == kBatchesPerStep - 1) {
        last.push_back(age);
        committed.push_back(Ms(acknowledged[step] - due_[i]));
        watched.push_back(Ms(told[step] - acknowledged[step]));
      }
    }
    fmt::print("{} steps of {} readings, {} x {} pixels, rate {}; {} frames\n", setup_.steps,
               setup_.readings, setup_.side, setup_.side, setup_.rate, frame_ms_.size());
    Print("first reading of a step to its picture", first);
    Print("last reading of a step to its picture", last);
    Print("last reading of a step to its acknowledgement", committed);
    Print("acknowledgement to watcher", watched);
    Print("making a frame", frame_ms_);
  }

  const Setup setup_;
  std::unique_ptr<Server> server_;
  std::unique_ptr<v1::Ingest::Stub> ingest_;
  std::unique_ptr<v1::Render::Stub> render_;
  std::unique_ptr<v1::Datasets::Stub> datasets_;
  std::vector<Clock::time_point> due_;  // of batches, from step 1 on
  Times seen_, told_;
  std::vector<double> frame_ms_;
};

int Main(int argc, char** argv) {
  if (argc < 2) {
    fmt::print(stderr, "usage: live_bench FOLDER [SECONDS [READINGS [SIDE [RATE]]]]\n");
    return 2;
  }
  spdlog::set_level(spdlog::level::warn);
  Setup setup;
  setup.steps = argc > 2 ? 10 * std::atoi(argv[2]) : setup.steps;
  setup.readings = argc > 3 ? std::atoi(argv[3]) : setup.readings;
  setup.side = argc > 4 ? static_cast<uint32_t>(std::atoi(argv[4])) : setup.side;
  setup.rate = argc > 5 ? std::atof(argv[5]) : setup.rate;
  const std::string root = std::string(argv[1]) + "/live_bench";
  std::filesystem::remove_all(root);
  Bench bench(root, setup);
  bench.MeasureReadings();
  bench.MeasureWatch(root + "/live.zarr");
  std::filesystem::remove_all(root);
  return 0;
}

}  // namespace
}  // namespace fovea::server

int main(int argc, char** argv) {
  return fovea::server::Main(argc, argv);
}
