#include <algorithm>
#include <array>
#include <cmath>

#include <nlohmann/json.hpp>

#include "engine/store/dataset.h"
#include "service/cli/commands.h"
#include "service/cli/console.h"

namespace fovea::cli {
namespace {

using nlohmann::json;

/// The histogram in 32 columns, each as high as the logarithm of its count.
std::string Bars(const FieldStats& stats) {
  constexpr size_t kColumns = 32;
  constexpr std::string_view kHeights = " .:-=+*#%@";
  const size_t bins = stats.histogram.size() / kColumns;
  std::array<double, kColumns> heights{};
  double greatest = 0;
  for (size_t i = 0; i < stats.histogram.size(); ++i) {
    heights[i / bins] += static_cast<double>(stats.histogram[i]);
  }
  for (double& height : heights) {
    height = std::log1p(height);
    greatest = std::max(greatest, height);
  }
  std::string bars;
  for (const double height : heights) {
    const double part = greatest > 0 ? height / greatest : 0;
    bars += kHeights[static_cast<size_t>(std::ceil(part * (kHeights.size() - 1)))];
  }
  return bars;
}

std::vector<std::string> FieldsOf(const store::DatasetInfo& info,
                                  const std::optional<std::string>& wanted) {
  if (wanted) {
    return {*wanted};
  }
  std::vector<std::string> names;
  for (const store::FieldInfo& field : info.fields) {
    names.push_back(field.name);
  }
  return names;
}

}  // namespace

Status Run(const StatsCommand& command) {
  FOVEA_ASSIGN_OR_RETURN(const auto dataset, store::Dataset::Open(command.dataset));
  const store::DatasetInfo info = dataset->info();
  const std::vector<std::string> fields = FieldsOf(info, command.field);
  const int64_t last = command.steps.last.value_or(info.committed_steps - 1);
  json steps = json::array();
  if (!command.output.json) {
    PrintLine(fmt::format("{:>6} {:>8}  {:<16} {:>13} {:>13}  histogram (log)", "step", "frame",
                          "field", "minimum", "maximum"));
  }
  for (int64_t step = command.steps.first; step <= last; step += command.steps.stride) {
    if (Interrupted()) {
      return Cancelled("stopped before step {}", step);
    }
    FOVEA_ASSIGN_OR_RETURN(const int64_t time_ns, dataset->TimeNs(step));
    FOVEA_ASSIGN_OR_RETURN(const auto number, dataset->FrameNumber(step));
    json one = {{"step", step}, {"time_ns", time_ns}, {"fields", json::array()}};
    if (number) {
      one["frame_number"] = *number;
    }
    for (const std::string& field : fields) {
      FOVEA_ASSIGN_OR_RETURN(const FieldStats stats, dataset->Stats(step, field));
      if (command.output.json) {
        one["fields"].push_back({{"name", field},
                                 {"minimum", stats.minimum},
                                 {"maximum", stats.maximum},
                                 {"histogram", stats.histogram}});
      } else {
        PrintLine(fmt::format("{:>6} {:>8}  {:<16} {:>13.6g} {:>13.6g}  |{}|", step,
                              number ? fmt::format("{}", *number) : "-", field, stats.minimum,
                              stats.maximum, Bars(stats)));
      }
    }
    steps.push_back(std::move(one));
  }
  if (command.output.json) {
    PrintJson(json({{"dataset", command.dataset}, {"steps", steps}}));
  }
  return absl::OkStatus();
}

}  // namespace fovea::cli
