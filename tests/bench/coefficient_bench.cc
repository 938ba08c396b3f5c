// What StreamCoefficients sends, over loopback from a server in this process:
//   coefficient_bench DATASET.zarr [X,Y,Z [RATE]]
// Bytes, blocks and milliseconds (one of each, as they come) of a fresh set, the same again, moves
// of the fovea by 8 voxels along x and along all axes, and of every step after the one before; for
// each field. Times are those of reading, sending and taking apart: Fetch of LocalRenderer.
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>

#include <spdlog/spdlog.h>

#include "engine/base/stopwatch.h"
#include "engine/store/dataset.h"
#include "service/client/local_renderer.h"
#include "service/server/server.h"

namespace fovea {
namespace {

void Need(const Status& status) {
  if (!status.ok()) {
    std::fprintf(stderr, "coefficient_bench: %s\n", std::string(MessageOf(status)).c_str());
    std::exit(1);
  }
}

struct Cost {
  uint64_t bytes = 0, blocks = 0;
  double ms = 0, first_ms = 0;  // until all, and until something can be drawn
};

Cost Fetch(client::LocalRenderer* local, int64_t step, const frames::FrameSpec& spec) {
  const Stopwatch watch;
  Cost cost;
  Need(local->Fetch(step, spec, [&](const client::LocalRenderer::Progress& progress) {
    if (cost.first_ms == 0 && progress.reached) {
      cost.first_ms = watch.ElapsedMs();
    }
    return true;
  }));
  cost.ms = watch.ElapsedMs();
  cost.bytes = local->progress().bytes;
  cost.blocks = local->progress().blocks;
  return cost;
}

void Print(const char* what, const Cost& cost, const Cost& fresh) {
  std::printf("  %-22s %9llu bytes (%.3f of fresh) in %4llu blocks, %7.1f ms, first %5.1f\n", what,
              static_cast<unsigned long long>(cost.bytes),
              static_cast<double>(cost.bytes) / static_cast<double>(fresh.bytes),
              static_cast<unsigned long long>(cost.blocks), cost.ms, cost.first_ms);
}

void Run(client::Client* client, const std::string& name, const store::DatasetInfo& info,
         const std::string& field, const Vec3& fovea, double rate) {
  frames::FrameSpec spec;
  spec.field = field;
  spec.fovea = frames::Position{fovea, false};
  spec.rate = rate;
  const int64_t middle = info.committed_steps / 2;
  std::printf("%s, %s, step %lld, fovea %g,%g,%g, rate %g\n", name.c_str(), field.c_str(),
              static_cast<long long>(middle), fovea.x, fovea.y, fovea.z, rate);
  for (int i = 0; i < 2; ++i) {  // the second time warm
    client::LocalRenderer local(*client, name, 0);
    const Cost fresh = Fetch(&local, middle, spec);
    Print("fresh", fresh, fresh);
    Print("the same again", Fetch(&local, middle, spec), fresh);
    spec.fovea->at.x += 8;
    Print("moved by 8 in x", Fetch(&local, middle, spec), fresh);
    spec.fovea->at = fovea;
    client::LocalRenderer other(*client, name, 0);
    Fetch(&other, middle, spec);
    spec.fovea->at = fovea + Vec3{8, 8, 8};
    Print("moved by 8 in x, y, z", Fetch(&other, middle, spec), fresh);
    spec.fovea->at = fovea;
  }
  Cost fresh_steps, next_steps;
  client::LocalRenderer walking(*client, name, 0);
  for (int64_t step = 0; step < info.committed_steps; ++step) {
    client::LocalRenderer alone(*client, name, 0);
    const Cost fresh = Fetch(&alone, step, spec);
    const Cost next = Fetch(&walking, step, spec);
    if (step > 0) {
      for (const auto& [from, to] : {std::pair(&fresh, &fresh_steps), {&next, &next_steps}}) {
        to->bytes += from->bytes;
        to->blocks += from->blocks;
        to->ms += from->ms;
        to->first_ms += from->first_ms;
      }
    }
  }
  if (info.committed_steps > 1) {
    Print("all next steps, fresh", fresh_steps, fresh_steps);
    Print("all next steps, held", next_steps, fresh_steps);
  }
}

int Main(int argc, char** argv) {
  if (argc < 2) {
    std::fprintf(stderr, "usage: coefficient_bench DATASET.zarr [X,Y,Z [RATE]]\n");
    return 2;
  }
  spdlog::set_level(spdlog::level::warn);
  const std::filesystem::path path = std::filesystem::canonical(argv[1]);
  const auto dataset = store::Dataset::Open(path.string());
  Need(dataset.status());
  const store::DatasetInfo info = (*dataset)->info();
  const Int3& dims = info.hierarchy.dims();
  Vec3 fovea{static_cast<double>(dims.x) / 2, static_cast<double>(dims.y) / 2,
             static_cast<double>(dims.z) / 2};
  if (argc > 2 && std::sscanf(argv[2], "%lf,%lf,%lf", &fovea.x, &fovea.y, &fovea.z) != 3) {
    std::fprintf(stderr, "coefficient_bench: '%s' is not X,Y,Z\n", argv[2]);
    return 2;
  }
  const double rate = argc > 3 ? std::atof(argv[3]) : 40;
  server::ServerOptions options;
  options.root = path.parent_path().string();
  options.listen = "127.0.0.1:0";
  const auto server = server::Server::Start(options);
  Need(server.status());
  const auto client = client::Client::Connect((*server)->address());
  Need(client.status());
  for (const store::FieldInfo& field : info.fields) {
    Run(client->get(), path.stem().string(), info, field.name, fovea, rate);
  }
  return 0;
}

}  // namespace
}  // namespace fovea

int main(int argc, char** argv) {
  return fovea::Main(argc, argv);
}
