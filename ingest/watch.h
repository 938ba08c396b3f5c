#ifndef INGEST_WATCH_H_
#define INGEST_WATCH_H_

#include <functional>
#include <optional>
#include <string>

#include "engine/base/status.h"
#include "ingest/ingest.h"

namespace fovea::ingest {

struct WatchOptions {
  std::optional<double> idle_seconds;  // end when no file came for so long; absent: never
  double gap_seconds = 30;             // how long a number that is skipped is waited for
  double poll_seconds = 1;             // how often the folder is looked through
};

/// Takes each new file of a numbered series as it is finished, in the order of numbers, and
/// commits it. `options.inputs` is one pattern (smoke.####.vdb) that may match nothing yet. A file
/// is finished when its writer closes it or moves it there (inotify, where the kernel tells), or
/// when two looks through the folder, poll_seconds apart, find it unchanged. Numbers are expected
/// at the smallest distance seen; after gap_seconds one that is missing is an error, left out, or
/// stood in for, as options.on_missing says. Files with a number before the last one taken are left
/// out, with a warning. The extent is options.extent, or that of the first file.
///
/// If the dataset is there, and was begun so with the same pattern, it goes on behind its last
/// frame number. Ends, OK, when `progress` returns false or after idle_seconds; with an error if a
/// file cannot be ingested. What was committed stays.
[[nodiscard]] StatusOr<IngestReport> Watch(
    const IngestOptions& options, const WatchOptions& watch,
    const std::function<bool(const IngestProgress&)>& progress);

}  // namespace fovea::ingest

#endif  // INGEST_WATCH_H_
