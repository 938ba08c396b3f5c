#include "service/jobs/job_request.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <string_view>
#include <utility>

#include "ingest/ingest_checks.h"
#include "service/jobs/safe_path.h"
#include "service/wire/convert.h"
#include "service/wire/printable.h"
#include "service/wire/readings.h"
#include "service/wire/requests.h"
#include "service/wire/status.h"

namespace fovea::jobs {
namespace {

namespace fs = std::filesystem;
constexpr int kMaxFiles = 1000;
constexpr int kMaxGrids = 64;
constexpr size_t kMaxGridBytes = 256;
constexpr size_t kMaxRawBytes = 128;
constexpr size_t kMaxFieldBytes = 64;
constexpr int kMaxOutputParts = 16;
constexpr size_t kMaxAnimationBytes = size_t{512} << 10;
constexpr double kLeastRate = 1e-6, kGreatestRate = 1e6;

Status CheckText(std::string_view field, const std::string& text, size_t most) {
  if (text.size() > most || text.find('\0') != std::string::npos) {
    return wire::BadField(field, fmt::format("'{}' has more than {} bytes, or a zero byte",
                                             wire::Printable(text), most));
  }
  return absl::OkStatus();
}

Status TakeFiles(const v1::IngestFilesRequest& request, const Folders& folders,
                 ingest::IngestOptions* options) {
  if (request.files().empty() || request.files_size() > kMaxFiles) {
    return wire::BadField(
        "files", fmt::format("there are {}, outside 1 to {}", request.files_size(), kMaxFiles));
  }
  for (const std::string& name : request.files()) {
    if (name.find_first_of("*?[") < name.rfind('/') && name.rfind('/') != std::string::npos) {
      return wire::BadField(
          "files", fmt::format("'{}': '*' '?' '[' belong in the last part", wire::Printable(name)));
    }
    FOVEA_ASSIGN_OR_RETURN(std::string path, PathBelow(folders.ingest_root, name));
    options->inputs.push_back(std::move(path));
  }
  return absl::OkStatus();
}

Status TakeFormat(const v1::IngestFilesRequest& request, ingest::IngestOptions* options) {
  FOVEA_RETURN_IF_ERROR(CheckText("raw", request.raw(), kMaxRawBytes));
  if (!request.raw().empty()) {
    auto raw = ingest::ParseRawFormat(request.raw());
    if (!raw.ok()) {
      return wire::BadField("raw", MessageOf(raw.status()));
    }
    options->raw = *std::move(raw);
  }
  if (request.grids_size() > kMaxGrids) {
    return wire::BadField("grids",
                          fmt::format("there are {}, above {}", request.grids_size(), kMaxGrids));
  }
  for (const std::string& grid : request.grids()) {
    FOVEA_RETURN_IF_ERROR(CheckText("grids", grid, kMaxGridBytes));
    options->grids.push_back(grid);
  }
  FOVEA_RETURN_IF_ERROR(CheckText("field", request.field(), kMaxFieldBytes));
  if (!request.field().empty()) {
    options->field = request.field();
  }
  return absl::OkStatus();
}

Status TakeRules(const v1::IngestFilesRequest& request, ingest::IngestOptions* options) {
  if (!v1::IngestFilesRequest::OnMissing_IsValid(request.on_missing())) {
    return wire::BadField("on_missing", fmt::format("{} is none", request.on_missing()));
  }
  if (!v1::IngestFilesRequest::Registration_IsValid(request.registration())) {
    return wire::BadField("registration", fmt::format("{} is none", request.registration()));
  }
  options->on_missing =
      request.on_missing() == v1::IngestFilesRequest::SKIP   ? ingest::OnMissing::kSkip
      : request.on_missing() == v1::IngestFilesRequest::HOLD ? ingest::OnMissing::kHold
                                                             : ingest::OnMissing::kError;
  options->registration =
      request.registration() == v1::IngestFilesRequest::INDEX   ? ingest::Registration::kIndex
      : request.registration() == v1::IngestFilesRequest::WORLD ? ingest::Registration::kWorld
                                                                : ingest::Registration::kSame;
  if (request.has_frames_per_second()) {
    const double rate = request.frames_per_second();
    if (!(rate >= kLeastRate && rate <= kGreatestRate)) {
      return wire::BadField("frames_per_second",
                            fmt::format("{} is outside {} to {}", rate, kLeastRate, kGreatestRate));
    }
    options->frames_per_second = rate;
  }
  return absl::OkStatus();
}

Status TakeCoefficients(const v1::IngestFilesRequest& request, ingest::IngestOptions* options) {
  if (!request.wavelet().empty()) {
    const auto wavelet = ParseWavelet(request.wavelet());
    if (!wavelet.ok()) {
      return wire::BadField("wavelet", fmt::format("'{}' is none of haar, cdf53, cdf97",
                                                   wire::Printable(request.wavelet())));
    }
    options->wavelet = *wavelet;
  }
  options->lossless = request.lossless();
  if (request.has_tolerance()) {
    if (!(request.tolerance() > 0) || !std::isfinite(request.tolerance())) {
      return wire::BadField("tolerance",
                            fmt::format("{} is not above 0 and finite", request.tolerance()));
    }
    options->tolerance = ingest::Tolerance{request.tolerance(), false};
  }
  return absl::OkStatus();
}

bool IsOutputCharacter(char c) {
  return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') ||
         std::string_view("_.#%-/").find(c) != std::string_view::npos;
}

Status BadOutput(const std::string& output) {
  return wire::BadField(
      "output", fmt::format("'{}' is not below the server's export root: 1 to {} parts of "
                            "[A-Za-z0-9_.#%-] between slashes, none beginning with '.', and no "
                            "link that leads out",
                            wire::Printable(output), kMaxOutputParts));
}

Status CheckOutput(const std::string& output) {
  if (!std::all_of(output.begin(), output.end(), IsOutputCharacter) ||
      std::count(output.begin(), output.end(), '/') >= kMaxOutputParts) {
    return BadOutput(output);
  }
  if (output.find(".zarr/") != std::string::npos) {
    return wire::BadField(
        "output", fmt::format("'{}': a folder whose name ends in .zarr is a dataset's", output));
  }
  const Status status = exports::ValidateOutputName(output);
  return status.ok() ? status : wire::BadField("output", MessageOf(status));
}

/// Below the export root, also through links.
StatusOr<std::string> OutputPath(const Folders& folders, const std::string& output) {
  const auto path = PathBelow(folders.export_root, output);
  return path.ok() ? path : BadOutput(output);
}

/// Exports must not write among the chunks of a dataset.
Status CheckExportRoot(const Folders& folders) {
  const fs::path exports = folders.export_root;
  const bool in_store = std::any_of(exports.begin(), exports.end(), [](const fs::path& part) {
    return part.extension() == ".zarr";
  });
  if (in_store || (!exports.empty() && IsBelow(folders.root, exports))) {
    return FailedPrecondition(
        "--export-root: '{}' {}: name a folder of its own, so that exports write to no dataset",
        exports.string(), in_store ? "is in a dataset" : "is, or holds, the root that is served");
  }
  return absl::OkStatus();
}

}  // namespace

Status MakeCanonical(Folders* folders) {
  for (const auto& [path, flag] :
       {std::pair{&folders->root, "ROOT"}, std::pair{&folders->ingest_root, "--ingest-root"},
        std::pair{&folders->export_root, "--export-root"}}) {
    if (!path->empty()) {
      FOVEA_ASSIGN_OR_RETURN(*path, CanonicalFolder(*path, flag));
    }
  }
  return CheckExportRoot(*folders);
}

std::string DatasetPath(const Folders& folders, const std::string& dataset) {
  return fmt::format("{}/{}.zarr", folders.root, dataset);
}

StatusOr<ingest::IngestOptions> IngestOptionsOf(const v1::IngestFilesRequest& request,
                                                const Folders& folders) {
  ingest::IngestOptions options;
  if (!wire::IsNewDatasetName(request.dataset())) {
    return wire::BadField("dataset",
                          fmt::format("'{}' is not 1 to 16 parts of [A-Za-z0-9_.-] between slashes,"
                                      " none beginning with '.' or ending in '.zarr'",
                                      wire::Printable(request.dataset())));
  }
  options.output = DatasetPath(folders, request.dataset());
  FOVEA_RETURN_IF_ERROR(TakeFiles(request, folders, &options));
  FOVEA_RETURN_IF_ERROR(TakeFormat(request, &options));
  FOVEA_RETURN_IF_ERROR(TakeRules(request, &options));
  FOVEA_RETURN_IF_ERROR(TakeCoefficients(request, &options));
  const Status status = ingest::CheckIngestOptions(options);
  if (!status.ok()) {
    return MakeStatus(status.code(), WithoutFolder(WithoutFolder(std::string(MessageOf(status)),
                                                                 folders.ingest_root),
                                                   folders.root));
  }
  return options;
}

StatusOr<exports::ExportOptions> ExportOptionsOf(const v1::CreateExportRequest& request,
                                                 const Folders& folders) {
  exports::ExportOptions options;
  FOVEA_RETURN_IF_ERROR(wire::CheckDatasetName(request.dataset()));
  FOVEA_RETURN_IF_ERROR(CheckOutput(request.output()));
  FOVEA_ASSIGN_OR_RETURN(options.output, OutputPath(folders, request.output()));
  v1::RenderSequenceRequest range;
  range.set_dataset(request.dataset());
  *range.mutable_steps() = request.steps();
  *range.mutable_spec() = request.spec();
  FOVEA_ASSIGN_OR_RETURN(const wire::SequenceRequest sequence, wire::FromProto(range));
  constexpr uint64_t kMost = uint64_t{1} << 40;  // past the end of any series
  options.first = static_cast<int64_t>(std::min(sequence.first, kMost));
  if (sequence.last) {
    options.last = static_cast<int64_t>(std::min(*sequence.last, kMost));
  }
  options.stride = static_cast<int64_t>(std::min(sequence.stride, kMost));
  options.spec = sequence.spec;
  options.overwrite = request.overwrite();
  if (request.animation_json().size() > kMaxAnimationBytes) {
    return wire::BadField("animation_json",
                          fmt::format("it has {} bytes, above {}", request.animation_json().size(),
                                      kMaxAnimationBytes));
  }
  if (!request.animation_json().empty()) {
    auto animation = frames::Animation::Parse(request.animation_json());
    if (!animation.ok()) {
      return wire::BadField("animation_json", MessageOf(animation.status()));
    }
    options.animation = *std::move(animation);
  }
  if (request.has_frames_per_second()) {
    const double rate = request.frames_per_second();
    if (!(rate >= 0.01 && rate <= 1000)) {
      return wire::BadField("frames_per_second", fmt::format("{} is outside 0.01 to 1000", rate));
    }
    options.frames_per_second = rate;
  }
  FOVEA_RETURN_IF_ERROR(wire::PointAtSpecField(exports::ValidateExport(options), "spec"));
  return options;
}

}  // namespace fovea::jobs
