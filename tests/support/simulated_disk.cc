#include "tests/support/simulated_disk.h"

#include <algorithm>
#include <cerrno>
#include <string_view>
#include <utility>

namespace fovea::testing {
namespace {

std::vector<std::string> Parts(std::string_view path) {
  std::vector<std::string> parts;
  while (!path.empty()) {
    const size_t end = std::min(path.find('/'), path.size());
    if (const std::string_view part = path.substr(0, end); !part.empty() && part != ".") {
      parts.emplace_back(part);
    }
    path.remove_prefix(std::min(end + 1, path.size()));
  }
  return parts;
}

}  // namespace

bool SimulatedDisk::Changes(Operation operation) {
  switch (operation) {
    case Operation::kOpen:
    case Operation::kSize:
    case Operation::kRead:
    case Operation::kLock:
    case Operation::kList:
      return false;
    default:
      return true;
  }
}

SimulatedDisk::SimulatedDisk() : nodes_(1) {
  nodes_[0].is_directory = true;
}

int SimulatedDisk::Fault(Operation operation, const std::string& path) {
  const int64_t index = calls_++;
  return fault_ ? fault_({index, operation, path}) : 0;
}

size_t SimulatedDisk::AtOnce(size_t asked) {
  return most_at_once_ == 0 ? asked : std::min(asked, 1 + turn_++ % most_at_once_);
}

int SimulatedDisk::Find(const std::string& path, Place* place) const {
  const std::vector<std::string> parts = Parts(path);
  *place = {0, "", 0};
  for (const std::string& part : parts) {
    if (!place->node) {
      return -ENOENT;
    }
    const Node& directory = nodes_[*place->node];
    if (!directory.is_directory) {
      return -ENOTDIR;
    }
    const auto found = directory.names.find(part);
    *place = {*place->node, part,
              found == directory.names.end() ? std::nullopt : std::optional(found->second)};
  }
  return 0;
}

void SimulatedDisk::Apply(Change change) {
  for (const Assignment& one : change) {
    if (one.node) {
      nodes_[one.directory].names[one.name] = *one.node;
    } else {
      nodes_[one.directory].names.erase(one.name);
    }
  }
  unflushed_.push_back(std::move(change));
}

int SimulatedDisk::Open(const std::string& path, Access access) {
  const std::lock_guard lock(mutex_);
  const bool makes = access == Access::kCreate || access == Access::kLock;
  if (const int fault = Fault(makes ? Operation::kCreate : Operation::kOpen, path); fault != 0) {
    return fault;
  }
  if (handles_.size() >= handle_limit_) {
    return -EMFILE;
  }
  Place place;
  if (const int found = Find(path, &place); found != 0) {
    return found;
  }
  if (!place.node && !makes) {
    return -ENOENT;
  }
  if (!place.node) {
    place.node = nodes_.size();
    nodes_.emplace_back();
    Apply({{place.directory, place.name, place.node}});
  }
  Node& node = nodes_[*place.node];
  if (node.is_directory != (access == Access::kDirectory) && (makes || !node.is_directory)) {
    return node.is_directory ? -EISDIR : -ENOTDIR;
  }
  if (access == Access::kCreate) {
    node.bytes.clear();
  }
  handles_[next_handle_] = {*place.node, path};
  if (access == Access::kAppend) {
    handles_[next_handle_].written = node.bytes.size();
  }
  most_open_handles_ = std::max(most_open_handles_, handles_.size());
  return next_handle_++;
}

void SimulatedDisk::Close(int handle) {
  const std::lock_guard lock(mutex_);
  handles_.erase(handle);
}

int64_t SimulatedDisk::Size(int handle) {
  const std::lock_guard lock(mutex_);
  const OpenFile& file = handles_.at(handle);
  if (const int fault = Fault(Operation::kSize, file.path); fault != 0) {
    return fault;
  }
  const Node& node = nodes_[file.node];
  return node.is_directory ? -EINVAL : std::ssize(node.bytes);
}

int64_t SimulatedDisk::ReadAt(int handle, int64_t offset, std::span<std::byte> out) {
  const std::lock_guard lock(mutex_);
  const OpenFile& file = handles_.at(handle);
  if (const int fault = Fault(Operation::kRead, file.path); fault != 0) {
    return fault;
  }
  const std::vector<std::byte>& bytes = nodes_[file.node].bytes;
  const auto start = static_cast<size_t>(std::clamp<int64_t>(offset, 0, std::ssize(bytes)));
  const size_t count = AtOnce(std::min(out.size(), bytes.size() - start));
  std::copy_n(bytes.begin() + static_cast<int64_t>(start), count, out.begin());
  return static_cast<int64_t>(count);
}

int64_t SimulatedDisk::Write(int handle, std::span<const std::byte> bytes) {
  const std::lock_guard lock(mutex_);
  OpenFile& file = handles_.at(handle);
  if (const int fault = Fault(Operation::kWrite, file.path); fault != 0) {
    return fault;
  }
  const size_t count = AtOnce(bytes.size());
  std::vector<std::byte>& all = nodes_[file.node].bytes;
  all.resize(std::max(all.size(), file.written + count));
  std::copy_n(bytes.begin(), count, all.begin() + static_cast<int64_t>(file.written));
  file.written += count;
  return static_cast<int64_t>(count);
}

int SimulatedDisk::Empty(int handle) {
  const std::lock_guard lock(mutex_);
  const OpenFile& file = handles_.at(handle);
  if (const int fault = Fault(Operation::kEmpty, file.path); fault != 0) {
    return fault;
  }
  nodes_[file.node].bytes.clear();
  return 0;
}

int SimulatedDisk::Flush(int handle) {
  const std::lock_guard lock(mutex_);
  const OpenFile& file = handles_.at(handle);
  Node& node = nodes_[file.node];
  const Operation operation = node.is_directory ? Operation::kFlushDirectory : Operation::kFlush;
  if (const int fault = Fault(operation, file.path); fault != 0) {
    return fault;
  }
  if (!node.is_directory) {
    node.flushed_bytes = node.bytes;
    return 0;
  }
  std::vector<Change> left;
  for (Change& change : unflushed_) {
    const bool here = std::any_of(change.begin(), change.end(), [&](const Assignment& one) {
      return one.directory == file.node;
    });
    if (!here) {
      left.push_back(std::move(change));
      continue;
    }
    for (const Assignment& one : change) {
      Names& names = nodes_[one.directory].flushed_names;
      names.erase(one.name);
      if (one.node) {
        names[one.name] = *one.node;
      }
    }
  }
  unflushed_ = std::move(left);
  return 0;
}

int SimulatedDisk::Lock(int handle) {
  const std::lock_guard lock(mutex_);
  OpenFile& file = handles_.at(handle);
  if (const int fault = Fault(Operation::kLock, file.path); fault != 0) {
    return fault;
  }
  for (const auto& [number, other] : handles_) {
    if (number != handle && other.node == file.node && other.locked) {
      return -EWOULDBLOCK;
    }
  }
  file.locked = true;
  return 0;
}

int SimulatedDisk::Rename(const std::string& from, const std::string& to) {
  const std::lock_guard lock(mutex_);
  if (const int fault = Fault(Operation::kRename, to); fault != 0) {
    return fault;
  }
  Place source;
  Place target;
  for (const auto& [path, place] : {std::pair(&from, &source), std::pair(&to, &target)}) {
    if (const int found = Find(*path, place); found != 0) {
      return found;
    }
  }
  if (!source.node) {
    return -ENOENT;
  }
  if (target.node) {
    const Node& replaced = nodes_[*target.node];
    if (replaced.is_directory != nodes_[*source.node].is_directory) {
      return replaced.is_directory ? -EISDIR : -ENOTDIR;
    }
    if (!replaced.names.empty()) {
      return -ENOTEMPTY;
    }
  }
  Apply({{source.directory, source.name, std::nullopt},
         {target.directory, target.name, source.node}});
  return 0;
}

int SimulatedDisk::Link(const std::string& from, const std::string& to) {
  const std::lock_guard lock(mutex_);
  if (const int fault = Fault(Operation::kLink, to); fault != 0) {
    return fault;
  }
  Place source;
  Place target;
  for (const auto& [path, place] : {std::pair(&from, &source), std::pair(&to, &target)}) {
    if (const int found = Find(*path, place); found != 0) {
      return found;
    }
  }
  if (!source.node) {
    return -ENOENT;
  }
  if (nodes_[*source.node].is_directory) {
    return -EPERM;
  }
  if (target.node) {
    return -EEXIST;
  }
  Apply({{target.directory, target.name, source.node}});
  return 0;
}

int SimulatedDisk::RemoveName(const std::string& path, bool is_directory) {
  Place place;
  if (const int found = Find(path, &place); found != 0) {
    return found;
  }
  if (!place.node) {
    return -ENOENT;
  }
  const Node& node = nodes_[*place.node];
  if (node.is_directory != is_directory) {
    return is_directory ? -ENOTDIR : -EISDIR;
  }
  if (!node.names.empty()) {
    return -ENOTEMPTY;
  }
  Apply({{place.directory, place.name, std::nullopt}});
  return 0;
}

int SimulatedDisk::Remove(const std::string& path) {
  const std::lock_guard lock(mutex_);
  const int fault = Fault(Operation::kRemove, path);
  return fault != 0 ? fault : RemoveName(path, false);
}

int SimulatedDisk::RemoveDirectory(const std::string& path) {
  const std::lock_guard lock(mutex_);
  const int fault = Fault(Operation::kRemoveDirectory, path);
  return fault != 0 ? fault : RemoveName(path, true);
}

int SimulatedDisk::MakeDirectory(const std::string& path) {
  const std::lock_guard lock(mutex_);
  if (const int fault = Fault(Operation::kMakeDirectory, path); fault != 0) {
    return fault;
  }
  Place place;
  if (const int found = Find(path, &place); found != 0) {
    return found;
  }
  if (place.node) {
    return -EEXIST;
  }
  place.node = nodes_.size();
  nodes_.emplace_back();
  nodes_.back().is_directory = true;
  Apply({{place.directory, place.name, place.node}});
  return 0;
}

int SimulatedDisk::List(const std::string& path, std::vector<store::DirectoryEntry>* entries) {
  const std::lock_guard lock(mutex_);
  if (const int fault = Fault(Operation::kList, path); fault != 0) {
    return fault;
  }
  Place place;
  if (const int found = Find(path, &place); found != 0) {
    return found;
  }
  if (!place.node) {
    return -ENOENT;
  }
  if (!nodes_[*place.node].is_directory) {
    return -ENOTDIR;
  }
  for (const auto& [name, node] : nodes_[*place.node].names) {
    entries->push_back({name, nodes_[node].is_directory});
  }
  return 0;
}

std::unique_ptr<SimulatedDisk> SimulatedDisk::AfterPowerCut(
    const std::function<bool(size_t)>& keeps_name, Kept kept) const {
  const std::lock_guard lock(mutex_);
  auto disk = std::make_unique<SimulatedDisk>();
  disk->nodes_ = nodes_;
  for (Node& node : disk->nodes_) {
    node.names = node.flushed_names;
    if (node.bytes == node.flushed_bytes || kept == Kept::kAll) {
      continue;
    }
    const size_t flushed = std::min(node.flushed_bytes.size(), node.bytes.size());
    switch (kept) {
      case Kept::kNone:
        node.bytes = node.flushed_bytes;
        break;
      case Kept::kHalf:
        node.bytes.resize(flushed + (node.bytes.size() - flushed) / 2);
        break;
      case Kept::kZeros:
        std::fill(node.bytes.begin() + static_cast<int64_t>(flushed), node.bytes.end(),
                  std::byte{0});
        break;
      case Kept::kAll:
        break;
    }
  }
  for (size_t i = 0; i < unflushed_.size(); ++i) {
    if (keeps_name(i)) {
      disk->Apply(unflushed_[i]);
    }
  }
  for (Node& node : disk->nodes_) {
    node.flushed_names = node.names;
    node.flushed_bytes = node.bytes;
  }
  disk->unflushed_.clear();
  return disk;
}

std::unique_ptr<SimulatedDisk> SimulatedDisk::AfterKill() const {
  const std::lock_guard lock(mutex_);
  auto disk = std::make_unique<SimulatedDisk>();
  disk->nodes_ = nodes_;
  disk->unflushed_ = unflushed_;
  return disk;
}

void SimulatedDisk::AddFiles(size_t node, const std::string& path,
                             std::map<std::string, std::vector<std::byte>>* files) const {
  for (const auto& [name, inside] : nodes_[node].names) {
    const std::string below = path.empty() ? name : path + "/" + name;
    if (nodes_[inside].is_directory) {
      AddFiles(inside, below, files);
    } else {
      (*files)[below] = nodes_[inside].bytes;
    }
  }
}

std::map<std::string, std::vector<std::byte>> SimulatedDisk::Files() const {
  const std::lock_guard lock(mutex_);
  std::map<std::string, std::vector<std::byte>> files;
  AddFiles(0, "", &files);
  return files;
}

}  // namespace fovea::testing
