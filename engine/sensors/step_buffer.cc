#include "engine/sensors/step_buffer.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <utility>

namespace fovea::sensors {
namespace {

struct Entry {
  uint64_t key;
  uint32_t reading;
};

/// By key, readings of one key in the order in which they came: a radix sort, 11 bits a pass.
std::vector<Entry> SortedByKey(std::span<const uint64_t> keys) {
  constexpr int kBits = 11;
  constexpr size_t kBuckets = size_t{1} << kBits;
  std::vector<Entry> entries(keys.size());
  uint64_t all = 0;
  for (size_t i = 0; i < keys.size(); ++i) {
    entries[i] = {keys[i], static_cast<uint32_t>(i)};
    all |= keys[i];
  }
  std::vector<Entry> other(keys.size());
  for (int shift = 0; shift < static_cast<int>(std::bit_width(all)); shift += kBits) {
    std::array<size_t, kBuckets> starts{};
    for (const Entry& entry : entries) {
      ++starts[(entry.key >> shift) & (kBuckets - 1)];
    }
    size_t sum = 0;
    for (size_t& start : starts) {
      sum += std::exchange(start, sum);
    }
    for (const Entry& entry : entries) {
      other[starts[(entry.key >> shift) & (kBuckets - 1)]++] = entry;
    }
    entries.swap(other);
  }
  return entries;
}

/// Of the readings of one voxel, leaves the last of each identity.
size_t DropDuplicates(std::span<Entry> run, std::span<const uint64_t> identities) {
  constexpr size_t kFew = 16;
  const auto identity = [&](const Entry& entry) { return identities[entry.reading]; };
  size_t kept = 0;
  if (run.size() <= kFew) {
    for (size_t i = 0; i < run.size(); ++i) {
      bool replaced = false;
      for (size_t j = i + 1; j < run.size(); ++j) {
        replaced = replaced || identity(run[j]) == identity(run[i]);
      }
      if (!replaced) {
        run[kept++] = run[i];
      }
    }
    return kept;
  }
  std::sort(run.begin(), run.end(), [&](const Entry& a, const Entry& b) {
    return std::pair(identity(a), a.reading) < std::pair(identity(b), b.reading);
  });
  for (size_t i = 0; i < run.size(); ++i) {
    if (i + 1 == run.size() || identity(run[i]) != identity(run[i + 1])) {
      run[kept++] = run[i];
    }
  }
  std::sort(run.begin(), run.begin() + static_cast<ptrdiff_t>(kept),
            [](const Entry& a, const Entry& b) { return a.reading < b.reading; });
  return kept;
}

}  // namespace

MeasuredVoxels StepBuffer::Measure() const {
  MeasuredVoxels voxels;
  voxels.values.resize(static_cast<size_t>(channels_));
  std::vector<Entry> entries = SortedByKey(keys_);
  for (size_t first = 0; first < entries.size();) {
    size_t end = first + 1;
    while (end < entries.size() && entries[end].key == entries[first].key) {
      ++end;
    }
    std::span<Entry> run(entries.data() + first, end - first);
    if (duplicates_ == Duplicates::kLast && run.size() > 1) {
      const size_t kept = DropDuplicates(run, identities_);
      voxels.duplicates += static_cast<int64_t>(run.size() - kept);
      run = run.first(kept);
    }
    voxels.keys.push_back(run.front().key);
    voxels.readings.push_back(static_cast<uint32_t>(run.size()));
    for (int channel = 0; channel < channels_; ++channel) {
      double sum = 0;
      for (const Entry& entry : run) {
        sum += values_[entry.reading * static_cast<size_t>(channels_) + channel];
      }
      voxels.values[channel].push_back(static_cast<float>(sum / static_cast<double>(run.size())));
    }
    first = end;
  }
  return voxels;
}

}  // namespace fovea::sensors
