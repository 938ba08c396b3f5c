#include "ingest/ingest_checks.h"

#include <algorithm>
#include <filesystem>
#include <system_error>

#include <absl/strings/str_join.h>

#include "engine/store/file.h"
#include "ingest/raw_format.h"

namespace fovea::ingest {

namespace fs = std::filesystem;

Status IsThere(const IngestOptions& options, const std::string& why) {
  return AlreadyExists("'{}' is there already{}: remove it, name another, or add to it (--append)",
                       options.output, why);
}

Status CheckCoding(const IngestOptions& options) {
  if (options.tolerance && (options.lossless || options.append)) {
    return InvalidArgument("--tolerance: not with {}", options.lossless
                                                           ? "--lossless, whose error is 0"
                                                           : "--append: the store's own holds");
  }
  if (options.lossless && options.wavelet == Wavelet::kCdf97) {
    return InvalidArgument(
        "--wavelet: with --lossless there is haar and cdf53; cdf97 has no reversible integer form");
  }
  return absl::OkStatus();
}

Status CheckIngestOptions(const IngestOptions& options) {
  if (options.output.empty()) {
    return InvalidArgument("no dataset to write was named");
  }
  if (options.chunk_edge != 8 && options.chunk_edge != 16 && options.chunk_edge != 32) {
    return InvalidArgument("chunk edge {}: must be 8, 16 or 32", options.chunk_edge);
  }
  if (options.raw) {
    FOVEA_RETURN_IF_ERROR(CheckRawFormat(*options.raw));
  }
  FOVEA_RETURN_IF_ERROR(CheckCoding(options));
  if (options.append && options.extent) {
    return InvalidArgument("--extent is for a new dataset: '{}' has its own", options.output);
  }
  if (options.append && !options.retain.empty()) {
    return InvalidArgument(
        "--retain is for a new dataset: '{}' has its own (`fovea retain` cuts "
        "down what is there)",
        options.output);
  }
  std::error_code error;
  const bool is_new = !fs::exists(options.output, error) || fs::is_empty(options.output, error);
  const bool is_ours = fs::exists(fs::path(options.output) / store::kLockName, error);
  return options.append || is_new || is_ours ? absl::OkStatus() : IsThere(options, "");
}

namespace {

std::string Joined(std::vector<std::string> names) {
  std::sort(names.begin(), names.end());
  return absl::StrJoin(names, ", ");
}

/// A step that is at another time in the store than `plan` says; empty if there is none.
std::string TimeDifference(const IngestOptions& options, const SeriesPlan& plan) {
  const auto dataset = store::Dataset::Open(options.output);
  if (!dataset.ok()) {
    return "";
  }
  const int64_t steps =
      std::min((*dataset)->info().committed_steps, static_cast<int64_t>(plan.steps.size()));
  for (int64_t step = 0; step < steps; ++step) {
    const StatusOr<int64_t> there_ns = (*dataset)->TimeNs(step);
    const PlannedStep& planned = plan.steps[static_cast<size_t>(step)];
    if (!there_ns.ok() || *there_ns == planned.time_ns) {
      continue;
    }
    const double there_s = static_cast<double>(*there_ns) / 1e9;
    const double wanted_s = static_cast<double>(planned.time_ns) / 1e9;
    const double number = static_cast<double>(planned.frame_number.value_or(step));
    const bool by_rate = options.times_s.empty() && number > 0 && there_s > 0 && wanted_s > 0;
    return fmt::format(", and its step {} is at {:.6g} s, not at {:.6g} s{}", step, there_s,
                       wanted_s,
                       by_rate ? fmt::format(": made as with --fps {:.6g}, not {:.6g}",
                                             number / there_s, number / wanted_s)
                               : fmt::format(" (--{})", options.times_s.empty() ? "fps" : "times"));
  }
  return "";
}

}  // namespace

std::string SeriesDifference(const IngestOptions& options, const store::DatasetInfo& there,
                             const store::SourceInfo& wanted, const SeriesPlan& plan) {
  std::vector<std::string> names;
  double tolerance = 0;
  for (const store::FieldInfo& field : there.fields) {
    names.push_back(field.name);
    tolerance = field.scales.empty() ? tolerance : field.tolerance;
  }
  if (Joined(names) != Joined(plan.fields)) {
    return fmt::format(", with the fields {}, not {} (--grid of VDB files, --field of others)",
                       Joined(names), Joined(plan.fields));
  }
  if (there.source && (there.source->part != wanted.part || there.source->parts != wanted.parts)) {
    return fmt::format(", part {} of {}, not {} of {} (--shard)", there.source->part,
                       there.source->parts, wanted.part, wanted.parts);
  }
  if ((tolerance > 0) != options.tolerance.has_value()) {
    return fmt::format(
        ", made {}, not {} one",
        tolerance > 0 ? fmt::format("with --tolerance {:.6g}", tolerance) : "without --tolerance",
        tolerance > 0 ? "without" : "with");
  }
  if (const std::string time = TimeDifference(options, plan); !time.empty()) {
    return time;
  }
  if (there.source && there.source->steps != wanted.steps) {
    return fmt::format(", of a series of {} steps, not {}", there.source->steps, wanted.steps);
  }
  if (options.tolerance && !options.tolerance->relative && options.tolerance->value != tolerance) {
    return fmt::format(", made with --tolerance {:.6g}, not {:.6g}", tolerance,
                       options.tolerance->value);
  }
  return fmt::format(", made of other files{}",
                     options.tolerance ? " or with another --tolerance" : "");
}

std::string MakingDifference(const std::string& what, const store::DatasetInfo& there,
                             const store::DatasetInfo& wanted) {
  const auto type_of = [](const store::DatasetInfo& info) {
    return info.fields.empty() ? "" : info.fields.front().type;
  };
  if (there.wavelet != wanted.wavelet) {
    return fmt::format(", made with --wavelet {}, not {}", there.wavelet, wanted.wavelet);
  }
  if (there.chunk_edge != wanted.chunk_edge) {
    return fmt::format(", made with --chunk {}, not {}", there.chunk_edge, wanted.chunk_edge);
  }
  if (type_of(there) != type_of(wanted)) {
    return fmt::format(", with {} coefficients, not {} (--lossless)", type_of(there),
                       type_of(wanted));
  }
  const std::string flag = what == "extent"               ? " (--extent)"
                           : what == "retention"          ? " (--retain)"
                           : what == "place in the world" ? " (--spacing, --registration)"
                                                          : "";
  return fmt::format(", and its {} is another{}", what, flag);
}

StatusOr<std::string> LosslessType(const std::vector<std::string>& source_types) {
  std::string needed = "int16";
  for (const std::string& type : source_types) {
    if (type == "uint16" || type == "int16") {
      needed = "int32";
    } else if (type != "uint8" && type != "int8") {
      return InvalidArgument(
          "--lossless: integer coefficients are made of voxels of 8 or 16 bits, not of {}", type);
    }
  }
  return needed;
}

}  // namespace fovea::ingest
