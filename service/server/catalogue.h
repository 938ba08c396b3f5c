#ifndef SERVICE_SERVER_CATALOGUE_H_
#define SERVICE_SERVER_CATALOGUE_H_

#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "engine/base/status.h"
#include "engine/store/removal.h"
#include "service/server/served_dataset.h"

namespace fovea::server {

/// The datasets below one directory: every NAME.zarr, at most kMaxDepth directories down. The name
/// of a dataset is its path below the root without ".zarr". Names from outside are looked up here
/// and never joined to a path, so there is nothing that a `..` could do; PathOfNew alone makes one,
/// of parts that cannot be `..`. Symbolic links that leave the root are not followed. Calls may
/// read the disk: not for gRPC's threads. Thread-safe.
class Catalogue {
 public:
  static constexpr int kMaxDepth = 16;
  static constexpr size_t kMaxDatasets = 10'000;

  /// Looks through `root`. NOT_FOUND or FAILED_PRECONDITION if it is no readable directory. The
  /// disk is looked at again at most once per `rescan_interval`. Frames of its datasets share
  /// `volumes`, if it is given.
  [[nodiscard]] static StatusOr<std::unique_ptr<Catalogue>> Open(
      const std::string& root, std::chrono::milliseconds rescan_interval,
      std::shared_ptr<frames::VolumeCache> volumes = nullptr);

  /// The dataset of this name, with its newest steps. A name that is not known makes the catalogue
  /// look at the disk again. NOT_FOUND; or why its store cannot be opened.
  [[nodiscard]] StatusOr<std::shared_ptr<ServedDataset>> Find(const std::string& name);

  /// The same, as the disk is now, however lately it was looked at.
  [[nodiscard]] StatusOr<std::shared_ptr<ServedDataset>> FindNow(const std::string& name);

  /// Where a dataset of this name belongs that is not there yet, its folders made. INVALID_ARGUMENT
  /// unless wire::IsNewDatasetName; FAILED_PRECONDITION if that is outside of the root, by a link.
  [[nodiscard]] StatusOr<std::string> PathOfNew(const std::string& name) const;

  /// Removes the dataset of this name from the disk (store::StoreRemoval): gone at once for all who
  /// ask or read, and its space is free when this returns. NOT_FOUND; FAILED_PRECONDITION if
  /// another writes to it, it is reached by a link, or it is no store of ours. One that is damaged
  /// goes, too.
  [[nodiscard]] Status Remove(const std::string& name);
  /// Removes what is left of removals that were interrupted; what cannot be removed is logged.
  void FinishRemovals() const;

  struct Page {
    std::vector<std::shared_ptr<ServedDataset>> datasets;  // by name
    bool more = false;                                     // whether any come after
  };
  /// At most `limit` datasets whose names come after `after` and are `visible`; those that cannot
  /// be opened are left out.
  [[nodiscard]] Page List(const std::string& after, size_t limit,
                          const std::function<bool(const std::string& name)>& visible);

  [[nodiscard]] size_t size() const;
  /// Null if none is shared.
  [[nodiscard]] frames::VolumeCache* volumes() const { return volumes_.get(); }
  /// `status` without the root's path in its message: clients need not know it.
  [[nodiscard]] Status WithoutRoot(const Status& status) const;

 private:
  /// What the disk holds at a name: tells a store from another that took its place.
  struct Identity {
    std::string path;                // canonical
    uint64_t device = 0, inode = 0;  // 0 if nothing is there
    friend bool operator==(const Identity&, const Identity&) = default;
  };
  struct Entry {
    Identity identity;
    std::shared_ptr<ServedDataset> dataset;  // null if it cannot be opened
    Status error;                            // why
  };
  using Found = std::map<std::string, Identity>;
  class Scanner;

  Catalogue(std::string root, std::chrono::milliseconds rescan_interval,
            std::shared_ptr<frames::VolumeCache> volumes)
      : root_(std::move(root)), rescan_interval_(rescan_interval), volumes_(std::move(volumes)) {}

  [[nodiscard]] static Identity IdentityOf(const std::string& path);
  [[nodiscard]] StatusOr<std::shared_ptr<ServedDataset>> FindEntry(const std::string& name,
                                                                   bool now);
  void Rescan(bool always);
  [[nodiscard]] Entry OpenEntry(const std::string& name, const Identity& identity,
                                const Entry* before) const;
  [[nodiscard]] StatusOr<Entry> Lookup(const std::string& name) const;
  [[nodiscard]] StatusOr<store::StoreRemoval> BeginRemoval(const std::string& name);

  const std::string root_;  // canonical
  const std::chrono::milliseconds rescan_interval_;
  const std::shared_ptr<frames::VolumeCache> volumes_;  // may be null

  std::mutex scan_mutex_;                     // held while the disk is looked at; before mutex_
  ServedDataset::Clock::time_point scanned_;  // guarded by scan_mutex_

  mutable std::mutex mutex_;
  std::map<std::string, Entry> entries_;  // guarded by mutex_
};

/// The error for a dataset that is not there, or that a caller may not know of.
[[nodiscard]] Status NoDataset(std::string_view name);

}  // namespace fovea::server

#endif  // SERVICE_SERVER_CATALOGUE_H_
