#include "ingest/missing_files.h"

#include <algorithm>
#include <cstdint>
#include <string>

namespace fovea::ingest {
namespace {

/// "3, 5 to 7"; past a few runs of numbers only how many more there are.
class NumberList {
 public:
  /// The numbers from `first` to `last`, `stride` apart.
  void Add(int64_t first, int64_t last, int64_t stride) {
    constexpr int kMostRuns = 8;
    count_ += (last - first) / stride + 1;
    if (++runs_ <= kMostRuns) {
      text_ += (text_.empty() ? "" : ", ") + fmt::format("{}", first);
      text_ += last > first ? fmt::format(" to {}", last) : "";
    } else if (runs_ == kMostRuns + 1) {
      text_ += ", ...";
    }
  }
  [[nodiscard]] int64_t count() const { return count_; }
  [[nodiscard]] std::string Text() const {
    return fmt::format("{} {}", count_ == 1 ? "number" : "numbers", text_);
  }

 private:
  std::string text_;
  int64_t count_ = 0;
  int runs_ = 0;
};

/// The smallest distance between the numbers of a series, in its order; 0 if it has none.
int64_t Stride(const std::vector<ScannedFile>& files) {
  int64_t stride = 0;
  for (size_t i = 1; i < files.size(); ++i) {
    if (!files[i].file.frame_number || !files[i - 1].file.frame_number) {
      return 0;
    }
    const int64_t distance = *files[i].file.frame_number - *files[i - 1].file.frame_number;
    if (distance > 0) {
      stride = stride == 0 ? distance : std::min(stride, distance);
    }
  }
  return stride;
}

NumberList Held(const std::vector<ScannedFile>& files, int64_t stride) {
  NumberList held;
  for (size_t i = 0; i < files.size(); ++i) {
    if (!files[i].file.held) {
      continue;
    }
    const size_t first = i;
    while (i + 1 < files.size() && files[i + 1].file.held) {
      ++i;
    }
    held.Add(files[first].file.frame_number.value_or(0), files[i].file.frame_number.value_or(0),
             std::max<int64_t>(stride, 1));
  }
  return held;
}

NumberList Skipped(const std::vector<ScannedFile>& files, int64_t stride) {
  NumberList skipped;
  for (size_t i = 1; stride > 0 && i < files.size(); ++i) {
    const int64_t before = *files[i - 1].file.frame_number;
    const int64_t number = *files[i].file.frame_number;
    if (number - before > stride) {
      const int64_t missing = (number - before - 1) / stride;
      skipped.Add(before + stride, before + missing * stride, stride);
    }
  }
  return skipped;
}

}  // namespace

void NoteMissingFiles(OnMissing on_missing, const std::vector<ScannedFile>& files,
                      SeriesPlan* plan) {
  const int64_t stride = Stride(files);
  if (const NumberList held = Held(files, stride); held.count() > 0) {
    plan->warnings.push_back(
        fmt::format("there are no files of {}: the step before stands in", held.Text()));
  }
  if (on_missing != OnMissing::kSkip) {
    return;
  }
  if (const NumberList skipped = Skipped(files, stride); skipped.count() > 0) {
    plan->skipped_steps += skipped.count();
    plan->warnings.push_back(fmt::format("there are no files of {}: left out", skipped.Text()));
  }
}

}  // namespace fovea::ingest
