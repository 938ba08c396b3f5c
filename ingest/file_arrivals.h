#ifndef INGEST_FILE_ARRIVALS_H_
#define INGEST_FILE_ARRIVALS_H_

#include <chrono>
#include <cstdint>
#include <map>
#include <string>

#include "engine/base/status.h"
#include "ingest/name_pattern.h"

namespace fovea::ingest {

/// The finished files of one folder that match a pattern, by number, as they come. One thread.
class FileArrivals {
 public:
  /// `folder` must be there.
  FileArrivals(std::string folder, NamePattern pattern);
  ~FileArrivals();
  FileArrivals(const FileArrivals&) = delete;
  FileArrivals& operator=(const FileArrivals&) = delete;

  /// Whether the kernel tells of files that are closed; else only looks through the folder find
  /// them.
  [[nodiscard]] bool is_told() const { return inotify_ >= 0; }
  /// Waits until something happens in the folder, at most `seconds`; a signal ends it too. Then
  /// takes note of what is finished. If `look`, looks through the folder: what is as the look
  /// before found it is finished; but where the kernel tells, and it was not there at the first
  /// look, ten looks must find it so, as its writer may be slow and not be done.
  [[nodiscard]] Status Wait(double seconds, bool look);
  /// By number: the names, without folder, of all that were found finished.
  [[nodiscard]] const std::map<int64_t, std::string>& finished() const { return finished_; }

 private:
  struct Seen {
    int64_t bytes = 0;
    int64_t changed_ns = 0;
    int quiet_looks_wanted = 1;  // how many more must find it so
  };
  void ReadEvents();
  [[nodiscard]] Status Look();
  void Finish(const std::string& name);

  std::string folder_;
  NamePattern pattern_;
  int inotify_ = -1;
  bool has_looked_ = false;
  std::map<std::string, Seen> seen_;  // as the last look found them; not those that are finished
  std::map<int64_t, std::string> finished_;
};

}  // namespace fovea::ingest

#endif  // INGEST_FILE_ARRIVALS_H_
