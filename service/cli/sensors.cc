#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <string>
#include <string_view>
#include <utility>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "ingest/sensors/sensor_ingest.h"
#include "ingest/sensors/voxel_box.h"
#include "service/cli/checks.h"
#include "service/cli/commands.h"
#include "service/cli/console.h"
#include "service/cli/dataset_output.h"
#include "service/cli/flags.h"
#include "service/cli/number_list.h"
#include "service/cli/sensors_remote.h"
#include "service/cli/verbs.h"

namespace fovea::cli {
namespace {

using ingest::ReadingFormat;
using ingest::SensorOptions;
using ingest::StepsBy;

/// A flag whose text `take` reads; it returns a Status.
template <typename Take>
void AddText(CLI::App* verb, const std::string& flag, const char* type, const Take& take,
             const char* help) {
  const auto on_text = [flag, take](const std::string& text) {
    const Status status = take(std::string_view(text));
    if (!status.ok()) {
      throw CLI::ValidationError(flag, std::string(MessageOf(status)));
    }
  };
  verb->add_option_function<std::string>(flag, on_text, help)->type_name(type);
}

template <typename T>
Status Choose(std::string_view text, std::initializer_list<std::pair<const char*, T>> choices,
              T* to) {
  std::string names;
  for (const auto& [name, value] : choices) {
    if (text == name) {
      *to = value;
      return absl::OkStatus();
    }
    names += (names.empty() ? "" : ", ") + std::string(name);
  }
  return InvalidArgument("'{}' is none of {}", text, names);
}

std::vector<std::string> SplitAtCommas(std::string_view text) {
  std::vector<std::string> parts;
  for (size_t at = 0; at <= text.size();) {
    const size_t end = std::min(text.find(',', at), text.size());
    parts.emplace_back(Trimmed(text.substr(at, end - at)));
    at = end + 1;
  }
  return parts;
}

/// time=t,x=lon,y=lat,value=temperature,value=humidity
Status TakeColumns(std::string_view text, ingest::ReadingColumns* columns) {
  for (const std::string& part : SplitAtCommas(text)) {
    const size_t equals = part.find('=');
    const std::string role = part.substr(0, equals);
    const std::string name = equals == std::string::npos ? "" : part.substr(equals + 1);
    std::string* target = nullptr;
    Status known = Choose<std::string*>(role,
                                        {{"time", &columns->time},
                                         {"x", &columns->x},
                                         {"y", &columns->y},
                                         {"z", &columns->z},
                                         {"value", nullptr}},
                                        &target);
    if (!known.ok() || name.empty()) {
      return InvalidArgument("'{}' is not ROLE=COLUMN, ROLE one of time, x, y, z, value", part);
    }
    if (target == nullptr) {
      columns->values.push_back(name);
    } else {
      *target = name;
    }
  }
  return absl::OkStatus();
}

Status TakeBounds(std::string_view text, ingest::SensorBox* box) {
  std::array<double, 6> at{};
  if (!ReadList<double>(text, ',', at)) {
    return InvalidArgument("'{}' is not X0,Y0,Z0,X1,Y1,Z1 in world units", text);
  }
  box->bounds = {Vec3{at[0], at[1], at[2]}, Vec3{at[3], at[4], at[5]}};
  return absl::OkStatus();
}

Status TakeVoxel(std::string_view text, ingest::SensorBox* box) {
  std::array<double, 3> size{};
  if (const auto one = Number<double>(Trimmed(text))) {
    size = {*one, *one, *one};
  } else if (!ReadList<double>(text, ',', size)) {
    return InvalidArgument("'{}' is neither SIZE nor X,Y,Z in world units", text);
  }
  for (const double edge : size) {
    if (!(edge > 0)) {
      return InvalidArgument("a voxel of size {}: must be more than 0", edge);
    }
  }
  box->voxel = Vec3{size[0], size[1], size[2]};
  return absl::OkStatus();
}

Status TakeDims(std::string_view text, ingest::SensorBox* box) {
  std::array<int64_t, 3> dims{};
  if (!ReadList<int64_t>(text, ',', dims)) {
    return InvalidArgument("'{}' is not NX,NY,NZ in whole voxels", text);
  }
  box->dims = Int3{dims[0], dims[1], dims[2]};
  return absl::OkStatus();
}

Status TakeRange(std::string_view text, SensorOptions* ingest) {
  std::array<double, 2> range{};
  if (!ReadList<double>(text, ',', range) || !(range[0] <= range[1])) {
    return InvalidArgument("'{}' is not LOW,HIGH", text);
  }
  ingest->least_value = range[0];
  ingest->greatest_value = range[1];
  return absl::OkStatus();
}

void AddInputFlags(CLI::App* verb, SensorOptions* ingest) {
  verb->add_option("input", ingest->inputs,
                   "Files, globs, or 'scan_####.csv'; - is standard input, read as it comes")
      ->required()
      ->type_name("INPUT...");
  AddText(
      verb, "--format", "F",
      [=](std::string_view text) {
        ReadingFormat format{};
        FOVEA_RETURN_IF_ERROR(Choose<ReadingFormat>(text,
                                                    {{"csv", ReadingFormat::kCsv},
                                                     {"jsonl", ReadingFormat::kJsonLines},
                                                     {"f32", ReadingFormat::kRecords}},
                                                    &format));
        ingest->format = format;
        return absl::OkStatus();
      },
      "csv, jsonl (an object a line), or f32 (five little-endian float32 a reading: x, y, z, t, "
      "value). Default: by the file's name, else by its first byte");
  AddText(
      verb, "--columns", "LIST",
      [=](std::string_view text) { return TakeColumns(text, &ingest->columns); },
      "What is in which column or at which key: time=t,x=lon,y=lat,z=alt,value=temp,value=wind; "
      "numbers from 1 without a header. Several values become several fields");
  AddText(
      verb, "--separator", "C",
      [=](std::string_view text) {
        if (text == "tab") {
          text = "\t";
        }
        if (text.size() != 1 || text[0] == '"' || text[0] == '\n') {
          return InvalidArgument("'{}' is not one character, or tab", text);
        }
        ingest->separator = text[0];
        return absl::OkStatus();
      },
      "Between the fields of a CSV line (default: tab, semicolon or comma, as the first line has)");
}

void AddReadingFlags(CLI::App* verb, SensorOptions* ingest) {
  AddText(
      verb, "--time-unit", "U",
      [=](std::string_view text) {
        return Choose<double>(
            text, {{"s", 1}, {"ms", 1e-3}, {"us", 1e-6}, {"ns", 1e-9}, {"min", 60}, {"h", 3600}},
            &ingest->time_unit_s);
      },
      "What numbers of the time column count: s, ms, us, ns, min or h (default s). Dates and times "
      "like 2020-02-07T13:00:00Z need no unit");
  verb->add_option("--max-bad", ingest->max_bad,
                   "How many lines that cannot be read are left out; one more is an error "
                   "(default 0)")
      ->check(Whole(0))
      ->type_name("N");
  AddText(
      verb, "--value-range", "LOW,HIGH",
      [=](std::string_view text) { return TakeRange(text, ingest); },
      "Readings with a value outside are left out, and counted");
  AddText(
      verb, "--duplicates", "WHAT",
      [=](std::string_view text) {
        return Choose<sensors::Duplicates>(
            text, {{"last", sensors::Duplicates::kLast}, {"mean", sensors::Duplicates::kMean}},
            &ingest->duplicates);
      },
      "Of readings of the same place and time the last stands, or the mean counts each: last or "
      "mean (default last)");
}

void AddStepFlags(CLI::App* verb, SensorOptions* ingest) {
  AddText(
      verb, "--step-seconds", "S",
      [=](std::string_view text) {
        const auto seconds = Number<double>(Trimmed(text));
        if (!seconds || !(*seconds > 0)) {
          return InvalidArgument("'{}' must be more than 0 seconds", text);
        }
        ingest->steps.window_s = *seconds;
        return absl::OkStatus();
      },
      "A step for each window of this length that holds readings (default: a step for each input)");
  AddText(
      verb, "--start", "T",
      [=](std::string_view text) {
        const std::optional<double> start = ingest::ParseTime(text, 1);
        if (!start || !std::isfinite(*start)) {
          return InvalidArgument("'{}' is neither seconds nor a date and time", text);
        }
        ingest->steps.start_s = *start;
        return absl::OkStatus();
      },
      "Where window 0 begins: seconds, or a date and time (default 0)");
  verb->add_option("--step-key", ingest->columns.step,
                   "A step for each text or number that stands in this column")
      ->type_name("COLUMN");
  verb->add_option("--watermark", ingest->steps.watermark_s,
                   "Seconds that a step stays open past its end for readings that come late "
                   "(default 0); later ones are left out, and counted")
      ->check(NotNegative())
      ->type_name("S");
  verb->add_option("--most-ahead", ingest->steps.most_ahead,
                   "Readings more windows ahead of all before them are left out: a broken clock "
                   "(default 1000)")
      ->check(Whole(1))
      ->type_name("N");
  AddText(
      verb, "--on-missing", "WHAT",
      [=](std::string_view text) {
        return Choose<sensors::OnEmpty>(text,
                                        {{"skip", sensors::OnEmpty::kSkip},
                                         {"hold", sensors::OnEmpty::kHold},
                                         {"error", sensors::OnEmpty::kError}},
                                        &ingest->steps.on_empty);
      },
      "A window without readings is no step (skip), the step before with a coverage of 0 (hold), "
      "or an error (default skip)");
}

void AddVoxelFlags(CLI::App* verb, SensorOptions* ingest) {
  ingest::SensorBox* box = &ingest->box;
  AddText(
      verb, "--bounds", "X0,...,Z1", [=](std::string_view text) { return TakeBounds(text, box); },
      "The box of the voxels, in world units (default: around all readings). Readings outside are "
      "left out, and counted");
  AddText(
      verb, "--voxel", "SIZE", [=](std::string_view text) { return TakeVoxel(text, box); },
      "Size of a voxel in world units, SIZE or X,Y,Z (default: by the number of readings)");
  AddText(
      verb, "--dims", "NX,NY,NZ", [=](std::string_view text) { return TakeDims(text, box); },
      "Instead of --voxel: how many voxels");
  verb->add_option("--reach", ingest->fill.reach_voxels,
                   "Voxels farther from readings than a super-voxel this wide get the background "
                   "(default: all are filled)")
      ->check(Whole(1))
      ->type_name("VOXELS");
  verb->add_option("--background", ingest->fill.background,
                   "With --reach: the value out of reach (default 0)")
      ->type_name("V");
}

nlohmann::json Array(const Vec3& v) {
  return {v.x, v.y, v.z};
}

nlohmann::json ReportJson(const SensorsCommand& command, const ingest::SensorReport& report,
                          double total_ms) {
  const sensors::ReadingCounts& c = report.counts;
  const Int3& dims = report.grid.hierarchy.dims();
  return {{"dataset", command.ingest.output},
          {"steps", report.steps},
          {"nx", dims.x},
          {"ny", dims.y},
          {"nz", dims.z},
          {"lower", Array(report.grid.lower)},
          {"voxel", Array(report.grid.voxel)},
          {"fields", report.fields},
          {"warnings", report.warnings},
          {"interrupted", report.interrupted},
          {"readings", CountsToJson(c)},
          {"bad_lines", report.bad_lines},
          {"empty_windows", c.empty_windows},
          {"measured_voxels", report.measured_voxels},
          {"fovea", Array(report.density.fovea)},
          {"rate", report.density.rate},
          {"input_bytes", report.input_bytes},
          {"read_ms", report.read_ms},
          {"bin_ms", report.bin_ms},
          {"fill_ms", report.fill_ms},
          {"write_ms", report.write_ms},
          {"total_ms", total_ms}};
}

void PrintReport(const SensorsCommand& command, const ingest::SensorReport& report, double ms) {
  const Int3& dims = report.grid.hierarchy.dims();
  std::string fields;
  for (const std::string& field : report.fields) {
    fields += field + ", ";
  }
  PrintLine(fmt::format("{}: {} of {} x {} x {} voxels, fields {}{}", command.ingest.output,
                        CountOf(report.steps, "step"), dims.x, dims.y, dims.z, fields,
                        ingest::kCoverageField));
  PrintLine(fmt::format(
      "{} readings in {} ({:.2f} million a second); read {:.0f} ms, bin {:.0f} ms, fill {:.0f} ms, "
      "write {:.0f} ms",
      report.counts.used, HumanSeconds(ms / 1000),
      static_cast<double>(report.counts.read) / std::max(ms, 1e-6) / 1000, report.read_ms,
      report.bin_ms, report.fill_ms, report.write_ms));
  if (const std::string left_out = LeftOut(report); !left_out.empty()) {
    PrintLine(fmt::format("left out: {}", left_out));
  }
  if (report.measured_voxels > 0) {
    PrintLine(fmt::format(
        "readings in {} voxels of the fullest step, densest at --fovea {:.0f},{:.0f},{:.0f}; 90 % "
        "of them lie within --rate {:.0f}",
        report.measured_voxels, report.density.fovea.x, report.density.fovea.y,
        report.density.fovea.z, report.density.rate));
  }
}

}  // namespace

std::string LeftOut(const ingest::SensorReport& report) {
  const sensors::ReadingCounts& c = report.counts;
  std::string text;
  for (const auto& [count, what] :
       {std::pair(c.duplicates, "replaced by later ones of the same place and time"),
        std::pair(c.not_finite, "NaN or infinite"),
        std::pair(c.out_of_range, "out of --value-range"), std::pair(c.outside, "outside the box"),
        std::pair(
            c.late,
            "late, of steps that were closed (--watermark S holds steps open S seconds longer)"),
        std::pair(c.ahead, "too far ahead"),
        std::pair(c.pending, "of steps that were not complete"),
        std::pair(report.bad_lines, "bad lines")}) {
    if (count > 0) {
      text += fmt::format("{}{} {}", text.empty() ? "" : ", ", count, what);
    }
  }
  return text;
}

CLI::App* AddSensors(CLI::App* app, SensorsCommand* command) {
  CLI::App* verb = AddVerb(
      app, "sensors", "Make a dataset of scattered readings: CSV, JSON lines, float32 records",
      "  fovea sensors readings.csv -o field.zarr\n"
      "  fovea sensors log.csv --columns time=t,x=lon,y=lat,value=temp --step-seconds 600 "
      "-o t.zarr\n"
      "  fovea sensors 'scan##.f32' --voxel 1000,1000,250 --world-unit m -o radar.zarr\n"
      "  tail -n +1 -f log.csv | fovea sensors - --bounds 0,0,0,100,100,10 --voxel 1 "
      "--step-seconds 60 -o live.zarr\n"
      "  fovea sensors log.csv -o lab/live --server 127.0.0.1:50051 --step-seconds 60 "
      "--bounds 0,0,0,100,100,10 --voxel 1\n"
      "Values without readings come from the nearest super-voxel that has some; the field "
      "'coverage'\nsays where: 1 measured, 1/w from a super-voxel w voxels wide. Ctrl-C keeps all "
      "steps that are complete.");
  AddServerFlags(verb, &command->server, &command->credentials);
  AddInputFlags(verb, &command->ingest);
  AddReadingFlags(verb, &command->ingest);
  verb->add_option("-o,--output", command->ingest.output, "The dataset to make")
      ->required()
      ->type_name("DS.zarr");
  AddText(
      verb, "--field", "F",
      [command](std::string_view text) {
        command->ingest.fields = SplitAtCommas(text);
        return absl::OkStatus();
      },
      "What the values are called, commas between several (default: as the input calls them)");
  AddStepFlags(verb, &command->ingest);
  AddVoxelFlags(verb, &command->ingest);
  verb->add_option("--world-unit", command->ingest.world_unit, "The unit of places, such as m")
      ->type_name("U");
  verb->add_option("--value-unit", command->ingest.value_unit,
                   "The unit of the values, such as dBZ")
      ->type_name("U");
  verb->add_option("--clock", command->ingest.clock, "What time 0 is, in words")->type_name("TEXT");
  CLI::Option* append =
      verb->add_flag("--append", command->ingest.append, "Add steps to a dataset that is there");
  verb->add_option("--chunk", command->ingest.chunk_edge,
                   "Edge of a chunk: 8, 16 or 32 coefficients (default 16)")
      ->check(CLI::IsMember({8, 16, 32}))
      ->type_name("C")
      ->excludes(append);
  AddOutputFlags(verb, &command->output);
  return verb;
}

/// What a dataset says once and for all.
Status CheckAppended(const SensorOptions& ingest) {
  for (const auto& [flag, text] :
       {std::pair("--world-unit", &ingest.world_unit),
        std::pair("--value-unit", &ingest.value_unit), std::pair("--clock", &ingest.clock)}) {
    if (ingest.append && !text->empty()) {
      return InvalidArgument("--append: the dataset keeps what it began with; leave out {}", flag);
    }
  }
  return absl::OkStatus();
}

Status Check(SensorsCommand* command) {
  SensorOptions& ingest = command->ingest;
  if (ingest.box.voxel && ingest.box.dims) {
    return InvalidArgument("--voxel and --dims say the same: give one of them");
  }
  if (ingest.append && (ingest.box.bounds || ingest.box.voxel || ingest.box.dims)) {
    return InvalidArgument(
        "--append: the dataset has its box already; leave out --bounds, --voxel "
        "and --dims");
  }
  if (ingest.append && !ingest.fields.empty()) {
    return InvalidArgument("--append: the dataset has its fields already; leave out --field");
  }
  FOVEA_RETURN_IF_ERROR(CheckAppended(ingest));
  if (ingest.steps.window_s && !ingest.columns.step.empty()) {
    return InvalidArgument("--step-seconds and --step-key: steps go by one of them");
  }
  ingest.steps_by = ingest.steps.window_s          ? StepsBy::kWindow
                    : !ingest.columns.step.empty() ? StepsBy::kKey
                                                   : StepsBy::kFile;
  if (command->server && (ingest.steps_by != StepsBy::kWindow || ingest.append)) {
    return InvalidArgument(
        "--server: steps go by --step-seconds, and a dataset that is there is always gone on with: "
        "give the one, and neither --step-key nor --append");
  }
  if (command->server && ingest.steps.on_empty == sensors::OnEmpty::kError) {
    return InvalidArgument("--server: a server skips or holds empty windows (--on-missing)");
  }
  return absl::OkStatus();
}

Status Run(const SensorsCommand& command) {
  if (command.server) {
    return SendSensors(command);
  }
  const Stopwatch watch;
  if (!command.ingest.append) {
    PrepareOutput(command.output, command.ingest.output);
  }
  StatusOr<ingest::SensorReport> report = [&] {
    Progress progress(command.output, "sensors", "steps");
    return ingest::IngestSensors(command.ingest, [&](const ingest::SensorProgress& now) {
      progress.Update(now.steps, -1, fmt::format("{} readings, {}", now.readings, now.now));
      return !Interrupted();
    });
  }();
  if (!report.ok()) {
    return report.status();
  }
  const double ms = watch.ElapsedMs();
  if (command.output.json) {
    PrintJson(ReportJson(command, *report, ms));
  } else {
    for (const std::string& warning : report->warnings) {
      Note(command.output, "note: " + warning);
    }
    if (report->box_was_chosen && !report->interrupted) {
      Note(command.output, "chosen from the readings: " + ingest::BoxFlags(report->grid));
    }
    if (report->bad_lines > 0) {
      Note(command.output, "note: the first bad line: " + report->first_bad_line);
    }
    PrintReport(command, *report, ms);
  }
  if (report->interrupted && command.ingest.inputs.front() != "-") {
    return Cancelled("stopped as asked, after {}", CountOf(report->steps, "step"));
  }
  return absl::OkStatus();
}

}  // namespace fovea::cli
