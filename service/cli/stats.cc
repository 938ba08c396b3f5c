#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include <nlohmann/json.hpp>

#include "engine/store/dataset.h"
#include "engine/store/stored_size.h"
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

/// Bytes by array, over the steps that were looked at.
using Sizes = std::vector<store::ArrayBytes>;

void Add(const Sizes& step, Sizes* sum) {
  sum->resize(step.size());
  for (size_t i = 0; i < step.size(); ++i) {
    (*sum)[i].array = step[i].array;
    (*sum)[i].bytes += step[i].bytes;
  }
}

uint64_t Total(const Sizes& sizes) {
  uint64_t bytes = 0;
  for (const store::ArrayBytes& array : sizes) {
    bytes += array.bytes;
  }
  return bytes;
}

json ToJson(const Sizes& sizes) {
  json arrays = json::object();
  for (const store::ArrayBytes& array : sizes) {
    arrays[array.array] = array.bytes;
  }
  return arrays;
}

/// "density: 1.2 MiB, 0.35 bytes a voxel (coarse 0.01, detail_2 0.29 ...)".
void PrintSizes(const std::string& field, const Sizes& sizes, double voxels) {
  std::string levels;
  for (const store::ArrayBytes& array : sizes) {
    levels += fmt::format("{}{} {:.4f}", levels.empty() ? "" : ", ", array.array,
                          static_cast<double>(array.bytes) / voxels);
  }
  PrintLine(fmt::format("{}: {}, {:.4f} bytes a voxel ({})", field, HumanBytes(Total(sizes)),
                        static_cast<double>(Total(sizes)) / voxels, levels));
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
  std::map<std::string, Sizes> sizes;  // by field
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
      FOVEA_ASSIGN_OR_RETURN(const Sizes stored,
                             store::StepBytes(dataset->path(), info, field, step));
      Add(stored, &sizes[field]);
      if (command.output.json) {
        one["fields"].push_back({{"name", field},
                                 {"minimum", stats.minimum},
                                 {"maximum", stats.maximum},
                                 {"bytes", ToJson(stored)},
                                 {"lost", info.IsLost(field, step)},
                                 {"histogram", stats.histogram}});
      } else {
        PrintLine(fmt::format("{:>6} {:>8}  {:<16} {:>13.6g} {:>13.6g}  |{}|{}", step,
                              number ? fmt::format("{}", *number) : "-", field, stats.minimum,
                              stats.maximum, Bars(stats), info.IsLost(field, step) ? " lost" : ""));
      }
    }
    steps.push_back(std::move(one));
  }
  if (command.output.json) {
    PrintJson(json({{"dataset", command.dataset}, {"steps", steps}}));
    return absl::OkStatus();
  }
  const double voxels =
      static_cast<double>(info.hierarchy.dims().Product()) * static_cast<double>(steps.size());
  for (const auto& [field, arrays] : sizes) {
    PrintSizes(field, arrays, voxels);
  }
  return absl::OkStatus();
}

}  // namespace fovea::cli
