#include "service/frames/plan.h"

#include <utility>

#include <nlohmann/json.hpp>

#include "engine/store/dataset.h"
#include "service/cli/commands.h"
#include "service/cli/console.h"
#include "service/client/client.h"
#include "service/frames/frames.h"
#include "service/frames/spec_json.h"

namespace fovea::cli {
namespace {

nlohmann::json ToJson(const PlanCommand& command, const frames::FramePlan& plan,
                      const std::string& flags) {
  return {{"dataset", command.dataset},
          {"step", command.step},
          {"used", frames::SpecToJson(plan.used)},
          {"coefficients", plan.coefficients},
          {"super_voxels", plan.counts.super_voxels},
          {"samples", plan.counts.samples},
          {"chunks_read", plan.chunks_read},
          {"chunks_total", plan.chunks_total},
          {"bytes_read", plan.bytes_read},
          {"memory_bytes", plan.counts.memory_bytes},
          {"threads", plan.threads},
          {"read_ms", plan.time.read_ms},
          {"reconstruct_ms", plan.time.reconstruct_ms},
          {"render_ms", plan.time.render_ms},
          {"smooth_warp_ms", plan.time.smooth_warp_ms},
          {"total_ms", plan.time.Total()},
          {"flags", flags}};
}

void Print(const PlanCommand& command, const frames::FramePlan& plan, const std::string& flags) {
  PrintLine(fmt::format("{}: {}x{}, step {}, rate {}{}", command.dataset, *plan.used.width_px,
                        *plan.used.height_px, command.step, FormatRate(*plan.used.rate),
                        command.budget.IsEmpty() ? "" : ", the largest within the budget"));
  PrintLine("pinned by: " + flags);
  PrintLine(
      fmt::format("m {} coefficients, {} super-voxels, {} samples; {} of {} chunks to read "
                  "({}); at most {} of memory",
                  plan.coefficients, plan.counts.super_voxels, plan.counts.samples,
                  plan.chunks_read, plan.chunks_total, HumanBytes(plan.bytes_read),
                  HumanBytes(static_cast<uint64_t>(plan.counts.memory_bytes))));
  PrintLine(
      fmt::format("about {:.1f} ms: read {:.1f}, reconstruct {:.1f}, render {:.1f}, smooth and "
                  "warp {:.1f} (threads: {}; without encoding)",
                  plan.time.Total(), plan.time.read_ms, plan.time.reconstruct_ms,
                  plan.time.render_ms, plan.time.smooth_warp_ms, plan.threads));
}

struct Planned {
  frames::FramePlan plan;
  Int3 dims;  // of the dataset
};

StatusOr<Planned> PlanHere(const PlanCommand& command) {
  FOVEA_ASSIGN_OR_RETURN(const auto dataset, store::Dataset::Open(command.dataset));
  FOVEA_ASSIGN_OR_RETURN(const frames::FrameSpec defaults, frames::DefaultSpec(*dataset));
  FOVEA_ASSIGN_OR_RETURN(const frames::FrameSpec resolved,
                         frames::ResolveSpec(*dataset, command.spec, defaults));
  FOVEA_ASSIGN_OR_RETURN(
      frames::FramePlan plan,
      command.budget.IsEmpty()
          ? frames::PlanFrame(*dataset, command.step, resolved, command.threads)
          : frames::PlanWithin(*dataset, command.step, resolved, command.budget, command.threads));
  return Planned{std::move(plan), dataset->info().hierarchy.dims()};
}

StatusOr<Planned> PlanThere(const PlanCommand& command) {
  FOVEA_ASSIGN_OR_RETURN(const auto client,
                         client::Client::Connect(*command.server, command.credentials));
  FOVEA_ASSIGN_OR_RETURN(frames::FramePlan plan, client->PlanFrame(command.dataset, command.step,
                                                                   command.spec, command.budget));
  FOVEA_ASSIGN_OR_RETURN(const client::DatasetSummary summary, client->GetDataset(command.dataset));
  return Planned{std::move(plan), summary.info.hierarchy.dims()};
}

}  // namespace

Status Run(const PlanCommand& command) {
  FOVEA_ASSIGN_OR_RETURN(const Planned planned,
                         command.server ? PlanThere(command) : PlanHere(command));
  const frames::FramePlan& plan = planned.plan;
  const std::string flags = PinningFlags(plan.used, planned.dims);
  for (const frames::Warning& warning : plan.warnings) {
    Warn(warning.message);
  }
  if (command.output.json) {
    PrintJson(ToJson(command, plan, flags));
  } else {
    Print(command, plan, flags);
  }
  return absl::OkStatus();
}

}  // namespace fovea::cli
