#include <nlohmann/json.hpp>

#include "service/cli/commands.h"
#include "service/cli/console.h"
#include "service/cli/values.h"
#include "service/client/client.h"
#include "service/frames/frames.h"
#include "service/frames/spec_json.h"

namespace fovea::cli {
namespace {

using nlohmann::json;

StatusOr<client::DatasetSummary> LocalSummary(const std::string& path) {
  FOVEA_ASSIGN_OR_RETURN(const auto dataset, store::Dataset::Open(path));
  client::DatasetSummary summary;
  summary.name = path;
  summary.info = dataset->info();
  if (summary.info.committed_steps > 0) {
    FOVEA_ASSIGN_OR_RETURN(summary.first_time_ns, dataset->TimeNs(0));
    FOVEA_ASSIGN_OR_RETURN(summary.last_time_ns, dataset->TimeNs(summary.info.committed_steps - 1));
    FOVEA_ASSIGN_OR_RETURN(summary.default_spec, frames::DefaultSpec(*dataset));
  }
  return summary;
}

json ToJson(const client::DatasetSummary& summary) {
  const store::DatasetInfo& info = summary.info;
  const Int3& dims = info.hierarchy.dims();
  json fields = json::array();
  for (const store::FieldInfo& field : info.fields) {
    fields.push_back({{"name", field.name},
                      {"type", field.type},
                      {"minimum", field.minimum},
                      {"maximum", field.maximum},
                      {"value_unit", field.value_unit}});
    if (!field.lost_steps.empty()) {
      fields.back()["lost_steps"] = field.lost_steps;
    }
    if (!field.scales.empty()) {
      fields.back().update({{"scales", field.scales},
                            {"tolerance", field.tolerance},
                            {"max_error", field.max_error}});
    }
  }
  json value = {{"name", summary.name},
                {"nx", dims.x},
                {"ny", dims.y},
                {"nz", dims.z},
                {"committed_steps", info.committed_steps},
                {"fields", fields},
                {"default_field", info.default_field},
                {"wavelet", info.wavelet},
                {"index_to_world", info.index_to_world.m},
                {"world_unit", info.world_unit},
                {"first_time_ns", summary.first_time_ns},
                {"last_time_ns", summary.last_time_ns}};
  if (!info.clock.empty()) {
    value["clock"] = info.clock;
  }
  if (!info.retention.empty()) {
    value["retention"] = json::array();
    for (const store::RetainedWindow& window : info.retention) {
      value["retention"].push_back({{"fovea", {window.at.x, window.at.y, window.at.z}},
                                    {"rate", {window.rate.x, window.rate.y, window.rate.z}}});
    }
  }
  if (info.source) {
    const store::SourceInfo& source = *info.source;
    value["source"] = {{"series", source.series},
                       {"series_steps", source.steps},
                       {"part", source.part},
                       {"parts", source.parts},
                       {"complete", store::IsComplete(info)}};
  }
  if (summary.default_spec.field) {
    value["default_spec"] = frames::SpecToJson(summary.default_spec);
  }
  return value;
}

std::string DescribeSource(const store::DatasetInfo& info) {
  const store::SourceInfo& source = *info.source;
  if (source.steps == 0) {
    return "a series that may go on (--watch)";
  }
  const std::string part =
      source.parts > 1
          ? fmt::format("part {} of {} (from 0), steps {} to {} of {}", source.part, source.parts,
                        source.FirstStep(), source.LastStep() - 1, source.steps)
          : "a series of " + CountOf(source.steps, "step");
  if (store::IsComplete(info)) {
    return part + ", complete";
  }
  // A merge commits all of its steps at once.
  const bool may_be_merge = source.parts == 1 && info.committed_steps == 0;
  return part + fmt::format(", not complete: give the same `fovea ingest`{} command again to go on",
                            may_be_merge ? " or `fovea merge`" : "");
}

void Print(const client::DatasetSummary& summary) {
  const store::DatasetInfo& info = summary.info;
  const Int3& dims = info.hierarchy.dims();
  const Vec3 spacing = info.index_to_world.Spacing();
  PrintLine(summary.name);
  PrintLine(fmt::format("  volume    {} x {} x {} voxels of {:.6g} x {:.6g} x {:.6g}{}{}", dims.x,
                        dims.y, dims.z, spacing.x, spacing.y, spacing.z,
                        info.world_unit.empty() ? "" : " ", info.world_unit));
  PrintLine(fmt::format("  wavelet   {}, {} levels", info.wavelet, info.hierarchy.finest() + 1));
  PrintLine(fmt::format("  steps     {}, {:.6g} to {:.6g} s{}", info.committed_steps,
                        static_cast<double>(summary.first_time_ns) / 1e9,
                        static_cast<double>(summary.last_time_ns) / 1e9,
                        info.clock.empty() ? "" : fmt::format(" (0 is: {})", info.clock)));
  if (info.source) {
    PrintLine("  source    " + DescribeSource(info));
  }
  for (size_t i = 0; i < info.retention.size(); ++i) {
    PrintLine(fmt::format("  {}  {}{}", i == 0 ? "retained" : "        ",
                          FormatRetained(info.retention[i]),
                          i == 0 ? " (detail elsewhere was dropped)" : ""));
  }
  for (const store::FieldInfo& field : info.fields) {
    const std::string error = field.scales.empty()
                                  ? ""
                                  : fmt::format(", off by {:.3g} at most (tolerance {:.3g})",
                                                field.max_error, field.tolerance);
    PrintLine(fmt::format("  field     {}: {:.6g} to {:.6g}{}{}, {}{}{}", field.name, field.minimum,
                          field.maximum, field.value_unit.empty() ? "" : " ", field.value_unit,
                          field.type, error, field.name == info.default_field ? " (default)" : ""));
  }
  for (const store::FieldInfo& field : info.fields) {
    if (!field.lost_steps.empty()) {
      PrintLine("  lost      " + DescribeLost(field.name, field.lost_steps));
    }
  }
  if (summary.default_spec.field) {
    PrintLine(fmt::format("  pictures  {}", PinningFlags(summary.default_spec, dims)));
  }
}

void PrintEvent(const client::DatasetEvent& event, bool as_json) {
  json steps = json::array();
  for (const client::DatasetEvent::Step& step : event.steps) {
    if (!as_json) {
      PrintLine(
          fmt::format("step {}: {:.6g} s", step.step, static_cast<double>(step.time_ns) / 1e9));
      continue;
    }
    steps.push_back({{"step", step.step}, {"time_ns", step.time_ns}});
    if (step.frame_number) {
      steps.back()["frame_number"] = *step.frame_number;
    }
  }
  if (as_json) {
    PrintJson({{"state", event.present ? "PRESENT" : "ABSENT"},
               {"committed_steps", event.committed_steps},
               {"steps", steps}});
  } else if (!event.present) {
    PrintLine("no dataset of this name is there");
  }
}

Status Watch(const InfoCommand& command) {
  FOVEA_ASSIGN_OR_RETURN(const auto client,
                         client::Client::Connect(*command.server, command.credentials));
  return client->WatchDataset(
      {.dataset = command.dataset, .first_step = 0, .wait = true},
      [&](const client::DatasetEvent& event) {
        PrintEvent(event, command.output.json);
        std::fflush(stdout);
        return !Interrupted();
      },
      [] { return !Interrupted(); });
}

}  // namespace

Status Run(const InfoCommand& command) {
  if (command.watch) {
    return Watch(command);
  }
  std::vector<client::DatasetSummary> summaries;
  if (!command.server) {
    FOVEA_ASSIGN_OR_RETURN(client::DatasetSummary summary, LocalSummary(command.dataset));
    summaries.push_back(std::move(summary));
  } else {
    FOVEA_ASSIGN_OR_RETURN(const auto client,
                           client::Client::Connect(*command.server, command.credentials));
    if (command.dataset.empty()) {
      FOVEA_ASSIGN_OR_RETURN(summaries, client->ListDatasets());
    } else {
      FOVEA_ASSIGN_OR_RETURN(client::DatasetSummary summary, client->GetDataset(command.dataset));
      summaries.push_back(std::move(summary));
    }
  }
  if (command.output.json && command.dataset.empty()) {
    json list = json::array();
    for (const client::DatasetSummary& summary : summaries) {
      list.push_back(ToJson(summary));
    }
    PrintJson(json({{"datasets", list}}));
    return absl::OkStatus();
  }
  for (const client::DatasetSummary& summary : summaries) {
    command.output.json ? PrintJson(ToJson(summary)) : Print(summary);
  }
  if (summaries.empty()) {
    Note(command.output, "the server has no datasets");
  }
  return absl::OkStatus();
}

}  // namespace fovea::cli
