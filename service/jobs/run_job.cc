#include "service/jobs/run_job.h"

#include <filesystem>
#include <memory>
#include <system_error>
#include <utility>
#include <vector>

#include "engine/store/dataset.h"
#include "engine/store/metadata.h"
#include "ingest/sequence.h"
#include "service/export/frame_provider.h"
#include "service/jobs/ingest_errors.h"
#include "service/jobs/safe_path.h"

namespace fovea::jobs {
namespace {

namespace fs = std::filesystem;

std::string WithoutRoots(std::string text, const Folders& folders) {
  for (const std::string& root : {folders.ingest_root, folders.export_root, folders.root}) {
    if (!root.empty()) {
      text = WithoutFolder(std::move(text), root);
    }
  }
  return text;
}

Status Shorten(const Status& status, const Folders& folders) {
  if (status.ok()) {
    return status;
  }
  return MakeStatus(status.code(), WithoutRoots(std::string(MessageOf(status)), folders));
}

int64_t CommittedSteps(const std::string& store) {
  std::error_code error;
  if (!fs::exists(fs::path(store) / store::kMetadataName, error)) {
    return 0;
  }
  const auto dataset = store::Dataset::Open(store);
  return dataset.ok() ? (*dataset)->info().committed_steps : 0;
}

/// What a series is read from, checked.
struct Series {
  int64_t files = 0;               // that are looked at first
  std::vector<std::string> names;  // of all, below the ingest root
};

StatusOr<Series> FindSeries(const ingest::IngestOptions& options, const Folders& folders) {
  FOVEA_ASSIGN_OR_RETURN(const auto files,
                         ingest::ResolveInputs(options.inputs, options.on_missing));
  Series series{std::ssize(files), {}};
  for (const ingest::SequenceFile& file : files) {
    const std::vector<std::string> paths = file.Paths();
    FOVEA_RETURN_IF_ERROR(CheckBelow(folders.ingest_root, paths));
    for (const std::string& path : paths) {
      series.names.push_back(WithoutFolder(path, folders.ingest_root));
    }
  }
  return series;
}

Status Ingest(const v1::IngestFilesRequest& request, const Folders& folders, int threads,
              const RunHooks& hooks) {
  FOVEA_ASSIGN_OR_RETURN(ingest::IngestOptions options, IngestOptionsOf(request, folders));
  options.threads = threads;
  FOVEA_RETURN_IF_ERROR(PathBelow(folders.root, request.dataset() + ".zarr").status());
  FOVEA_ASSIGN_OR_RETURN(const Series series, FindSeries(options, folders));
  std::error_code ignored;  // what cannot be made is reported by the store, with its path
  fs::create_directories(fs::path(options.output).parent_path(), ignored);
  const int64_t before = CommittedSteps(options.output);
  int64_t looks = 0;
  const auto report = ingest::Ingest(options, [&](const ingest::IngestProgress& progress) {
    // The first pass looks at each file; how many steps there are, and whether those that the
    // store has are of this series, is known after it.
    const std::string now = WithoutFolder(progress.now, folders.ingest_root);
    hooks.tell(looks++ < series.files ? ProgressReport{0, 0, now}
                                      : ProgressReport{before + progress.steps_done,
                                                       before + progress.steps_total, now});
    return !hooks.stopped();
  });
  if (!report.ok()) {
    const Status status = Shorten(report.status(), folders);
    if (const auto failure = FailureOf(MessageOf(status), series.names)) {
      hooks.tell(*failure);
    }
    return MakeStatus(status.code(), ForJobs(std::string(MessageOf(status))));
  }
  for (const std::string& warning : report->warnings) {
    hooks.tell(WarningReport{ForJobs(WithoutRoots(warning, folders))});
  }
  const int64_t steps = report->steps_before + report->steps;
  hooks.tell(ProgressReport{steps, steps, ""});
  return absl::OkStatus();
}

Status Export(const v1::CreateExportRequest& request, const Folders& folders, int threads,
              const RunHooks& hooks) {
  FOVEA_ASSIGN_OR_RETURN(exports::ExportOptions options, ExportOptionsOf(request, folders));
  const auto short_path = [&](const std::string& path) {
    return WithoutFolder(path, folders.export_root);
  };
  FOVEA_ASSIGN_OR_RETURN(const auto provider,
                         exports::OpenLocal(DatasetPath(folders, request.dataset()), threads));
  options.on_failure = [&](const exports::PlannedFrame& frame, const Status& status) {
    hooks.tell(Failure{short_path(frame.path), std::string(MessageOf(Shorten(status, folders)))});
  };
  options.on_warning = [&](const frames::Warning& warning) {
    hooks.tell(WarningReport{warning.message});
  };
  const auto report =
      exports::Export(*provider, options, [&](const exports::ExportProgress& progress) {
        hooks.tell(ProgressReport{progress.done, progress.total, short_path(progress.now)});
        return !hooks.stopped();
      });
  if (!report.ok()) {
    return report.status();
  }
  const int64_t done = report->frames_made + report->frames_skipped;
  hooks.tell(ProgressReport{done, report->frames_total, ""});
  return done == 0 && report->frames_total > 0
             ? DataLoss("none of the {} frames could be made; the failures say why",
                        report->frames_total)
             : absl::OkStatus();
}

}  // namespace

Status RunJob(Kind kind, const std::string& request, const Folders& folders, int threads,
              const RunHooks& hooks) {
  v1::IngestFilesRequest files;
  v1::CreateExportRequest frames;
  switch (kind) {
    case Kind::kIngestFiles:
      return files.ParseFromString(request)
                 ? Shorten(Ingest(files, folders, threads, hooks), folders)
                 : Internal("the request of this job cannot be read");
    case Kind::kExport:
      return frames.ParseFromString(request)
                 ? Shorten(Export(frames, folders, threads, hooks), folders)
                 : Internal("the request of this job cannot be read");
  }
  return Internal("there is no such kind of job: {}", static_cast<int>(kind));
}

}  // namespace fovea::jobs
