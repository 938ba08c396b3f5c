#include "service/server/catalogue.h"

#include <sys/stat.h>

#include <algorithm>
#include <filesystem>
#include <system_error>
#include <utility>

#include <spdlog/spdlog.h>

#include "service/wire/printable.h"
#include "service/wire/readings.h"
#include "service/wire/status.h"

namespace fovea::server {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kSuffix = ".zarr";
constexpr size_t kMaxDirectoryEntries = 1'000'000;  // of one scan

/// Whether `path` is `root` or lies below it; both canonical.
bool IsBelow(const fs::path& path, const fs::path& root) {
  const auto [at, end] = std::mismatch(root.begin(), root.end(), path.begin(), path.end());
  return at == root.end();
}

/// How many bytes follow `lead` in a character of UTF-8; -1 if none can start so, or it is a
/// control character.
int FollowingBytes(unsigned char lead) {
  if (lead < 0x20 || lead == 0x7F || (lead >= 0x80 && lead < 0xC2) || lead >= 0xF5) {
    return -1;
  }
  return lead < 0x80 ? 0 : lead < 0xE0 ? 1 : lead < 0xF0 ? 2 : 3;
}

/// What a name must be to be sent in a proto string and shown on a terminal.
bool IsPrintableUtf8(std::string_view name) {
  int following = 0;
  for (const char c : name) {
    const auto byte = static_cast<unsigned char>(c);
    if (following > 0 && (byte & 0xC0U) == 0x80U) {
      --following;
    } else {
      following = following > 0 ? -1 : FollowingBytes(byte);
    }
    if (following < 0) {
      return false;
    }
  }
  return following == 0;
}

}  // namespace

Catalogue::Identity Catalogue::IdentityOf(const std::string& path) {
  struct stat status {};
  if (::stat(path.c_str(), &status) != 0) {
    return {path, 0, 0};
  }
  return {path, status.st_dev, status.st_ino};
}

/// One walk over the root. Directories that cannot be read are left out.
class Catalogue::Scanner {
 public:
  explicit Scanner(const fs::path& root) : root_(root) {}

  Found Run() {
    open_.push_back(root_);
    Walk(root_, "", 0);
    return std::move(found_);
  }

 private:
  void Walk(const fs::path& directory, const std::string& prefix, int depth) {
    std::error_code error;
    for (fs::directory_iterator it(directory, error), end; !error && it != end;
         it.increment(error)) {
      if (++entries_ > kMaxDirectoryEntries || found_.size() >= kMaxDatasets) {
        return;
      }
      const std::string name = it->path().filename().string();
      if (name.starts_with('.') || !IsPrintableUtf8(name)) {
        continue;
      }
      Visit(it->path(), prefix, name, depth);
    }
  }

  void Visit(const fs::path& path, const std::string& prefix, const std::string& name, int depth) {
    std::error_code error;
    if (!fs::is_directory(path, error) || error) {
      return;
    }
    const fs::path canonical = fs::canonical(path, error);
    if (error || !IsBelow(canonical, root_)) {
      return;
    }
    if (name.size() > kSuffix.size() && name.ends_with(kSuffix)) {
      found_[prefix + name.substr(0, name.size() - kSuffix.size())] =
          IdentityOf(canonical.string());
      return;
    }
    // A link back to a directory that is being walked would go round for ever.
    if (depth + 1 < kMaxDepth && std::find(open_.begin(), open_.end(), canonical) == open_.end()) {
      open_.push_back(canonical);
      Walk(canonical, prefix + name + "/", depth + 1);
      open_.pop_back();
    }
  }

  const fs::path root_;
  std::vector<fs::path> open_;  // from the root to the directory in hand
  size_t entries_ = 0;
  Found found_;
};

StatusOr<std::unique_ptr<Catalogue>> Catalogue::Open(const std::string& root,
                                                     std::chrono::milliseconds rescan_interval,
                                                     std::shared_ptr<frames::VolumeCache> volumes) {
  std::error_code error;
  const fs::path canonical = fs::canonical(root, error);
  if (error) {
    return NotFound("the root '{}' cannot be opened: {}; give a directory that holds datasets",
                    root, error.message());
  }
  if (!fs::is_directory(canonical)) {
    return FailedPrecondition("the root '{}' is not a directory; give one that holds datasets",
                              root);
  }
  fs::directory_iterator(canonical, error);
  if (error) {
    return FailedPrecondition("the root '{}' cannot be read: {}", root, error.message());
  }
  if (canonical.extension() == kSuffix) {
    return FailedPrecondition(
        "the root '{}' is itself a dataset: give the directory that holds it, '{}'", root,
        canonical.parent_path().string());
  }
  auto catalogue = std::unique_ptr<Catalogue>(
      new Catalogue(canonical.string(), rescan_interval, std::move(volumes)));
  catalogue->Rescan(true);
  return catalogue;
}

void Catalogue::Rescan(bool always) {
  const std::lock_guard scan_lock(scan_mutex_);
  if (!always && ServedDataset::Clock::now() - scanned_ < rescan_interval_) {
    return;
  }
  const Found found = Scanner(root_).Run();
  std::map<std::string, Entry> before;
  {
    const std::lock_guard lock(mutex_);
    before = entries_;
  }
  std::map<std::string, Entry> entries;
  for (const auto& [name, identity] : found) {
    const auto known = before.find(name);
    entries[name] = OpenEntry(name, identity, known == before.end() ? nullptr : &known->second);
  }
  if (found.size() >= kMaxDatasets) {
    spdlog::warn("more than {} datasets below the root: the others are not served", kMaxDatasets);
  }
  scanned_ = ServedDataset::Clock::now();
  for (const auto& [name, entry] : before) {
    const auto still = entries.find(name);
    if (entry.dataset != nullptr &&
        (still == entries.end() || still->second.dataset != entry.dataset)) {
      entry.dataset->MarkGone();
    }
  }
  const std::lock_guard lock(mutex_);
  entries_.swap(entries);
}

Catalogue::Entry Catalogue::OpenEntry(const std::string& name, const Identity& identity,
                                      const Entry* before) const {
  const bool known = before != nullptr && before->identity == identity;
  if (known && before->dataset != nullptr && before->dataset->CheckPresent().ok()) {
    return *before;
  }
  Entry entry{identity, nullptr, absl::OkStatus()};
  auto dataset = store::Dataset::Open(identity.path);
  if (dataset.ok()) {
    entry.dataset =
        std::make_shared<ServedDataset>(name, *std::move(dataset), rescan_interval_, volumes_);
    spdlog::info("dataset '{}': {} steps", name, entry.dataset->dataset().info().committed_steps);
    return entry;
  }
  entry.error = dataset.status();
  if (!known || before->error != entry.error) {
    spdlog::warn("dataset '{}' is left out: {}", name, MessageOf(entry.error));
  }
  return entry;
}

StatusOr<Catalogue::Entry> Catalogue::Lookup(const std::string& name) const {
  const std::lock_guard lock(mutex_);
  const auto found = entries_.find(name);
  if (found == entries_.end()) {
    return NoDataset(name);
  }
  return found->second;
}

StatusOr<std::shared_ptr<ServedDataset>> Catalogue::Find(const std::string& name) {
  return FindEntry(name, false);
}

StatusOr<std::shared_ptr<ServedDataset>> Catalogue::FindNow(const std::string& name) {
  return FindEntry(name, true);
}

StatusOr<std::shared_ptr<ServedDataset>> Catalogue::FindEntry(const std::string& name, bool now) {
  auto entry = Lookup(name);
  const auto usable = [&entry, now] {
    return entry.ok() && entry->dataset != nullptr && entry->dataset->CheckPresent().ok() &&
           entry->dataset->Refresh(now).ok();
  };
  if (!usable()) {
    // New, gone, repaired or replaced: the disk knows.
    Rescan(now);
    entry = Lookup(name);
  }
  FOVEA_RETURN_IF_ERROR(entry.status());
  FOVEA_RETURN_IF_ERROR(Annotate(entry->error, fmt::format("dataset '{}'", name)));
  FOVEA_RETURN_IF_ERROR(
      Annotate(entry->dataset->Refresh(false), fmt::format("dataset '{}'", name)));
  return entry->dataset;
}

StatusOr<std::string> Catalogue::PathOfNew(const std::string& name) const {
  if (!wire::IsNewDatasetName(name)) {
    return InvalidArgument("'{}' cannot be the name of a dataset", wire::Printable(name));
  }
  const fs::path path = fs::path(root_) / (name + std::string(kSuffix));
  std::error_code error;
  const fs::path folder = fs::weakly_canonical(path.parent_path(), error);
  if (error || !IsBelow(folder, root_)) {
    return FailedPrecondition("dataset '{}' cannot be made: that is outside of the root", name);
  }
  fs::create_directories(folder, error);
  if (error) {
    return FailedPrecondition("dataset '{}' cannot be made: {}", name, error.message());
  }
  return (folder / path.filename()).string();
}

Catalogue::Page Catalogue::List(const std::string& after, size_t limit,
                                const std::function<bool(const std::string&)>& visible) {
  Rescan(false);
  Page page;
  {
    const std::lock_guard lock(mutex_);
    for (auto it = entries_.upper_bound(after); it != entries_.end() && !page.more; ++it) {
      if (it->second.dataset == nullptr || !visible(it->first)) {
        continue;
      }
      page.more = page.datasets.size() == limit;
      if (!page.more) {
        page.datasets.push_back(it->second.dataset);
      }
    }
  }
  // One that cannot be refreshed is shown as it was: the next call for it says what is wrong.
  for (const auto& dataset : page.datasets) {
    if (const Status status = dataset->Refresh(false); !status.ok()) {
      spdlog::warn("dataset '{}': {}", dataset->name(), MessageOf(status));
    }
  }
  return page;
}

size_t Catalogue::size() const {
  const std::lock_guard lock(mutex_);
  return entries_.size();
}

Status Catalogue::WithoutRoot(const Status& status) const {
  std::string message(MessageOf(status));
  const std::string prefix = root_ + "/";
  for (size_t at = message.find(prefix); at != std::string::npos; at = message.find(prefix, at)) {
    message.erase(at, prefix.size());
  }
  if (message == MessageOf(status)) {
    return status;
  }
  return wire::WithMessage(status, message);
}

Status NoDataset(std::string_view name) {
  return wire::WithResource(
      NotFound("no dataset '{}', or this token is not for it; ListDatasets (`fovea info --server`) "
               "says which there are",
               wire::Printable(name)),
      "fovea.v1.Dataset", name);
}

}  // namespace fovea::server
