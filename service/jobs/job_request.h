#ifndef SERVICE_JOBS_JOB_REQUEST_H_
#define SERVICE_JOBS_JOB_REQUEST_H_

#include <string>
#include <vector>

#include "engine/base/status.h"
#include "fovea/v1/ingest.pb.h"
#include "fovea/v1/jobs.pb.h"
#include "ingest/ingest.h"
#include "service/export/exporter.h"

/// Requests of jobs as the options of what does the work, checked: what can be told without looking
/// at a file or a dataset has been. Errors are INVALID_ARGUMENT and point at the field, but
/// NOT_FOUND for a file that is read outside of its root. Thread-safe.
namespace fovea::jobs {

/// Where a server's jobs read and write. Empty: it does not serve such jobs. All canonical.
struct Folders {
  std::string root;         // of the datasets
  std::string ingest_root;  // of the files that may be ingested
  std::string export_root;  // of what exports make
};

/// Makes all canonical. NOT_FOUND, FAILED_PRECONDITION name the flag of a folder that is not there,
/// or where exports would write to datasets.
[[nodiscard]] Status MakeCanonical(Folders* folders);

/// Folders::ingest_root must be there.
[[nodiscard]] StatusOr<ingest::IngestOptions> IngestOptionsOf(const v1::IngestFilesRequest& request,
                                                              const Folders& folders);

/// Folders::export_root must be there. A range without an end has none in the options either.
[[nodiscard]] StatusOr<exports::ExportOptions> ExportOptionsOf(
    const v1::CreateExportRequest& request, const Folders& folders);

/// ROOT/NAME.zarr.
[[nodiscard]] std::string DatasetPath(const Folders& folders, const std::string& dataset);

}  // namespace fovea::jobs

#endif  // SERVICE_JOBS_JOB_REQUEST_H_
