#include "ingest/worker/dense_reader.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <functional>
#include <memory>
#include <new>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "ingest/worker/array_bytes.h"
#include "ingest/worker/dense_sender.h"
#include "ingest/worker/header_reader.h"
#include "ingest/worker/headers/text.h"
#include "ingest/worker/limits.h"

namespace fovea::ingest {
namespace {

/// A header with the files that hold its array, and which of its channels is wanted.
struct DenseFile {
  DenseHeader header;
  std::vector<std::string> needs;  // not in the set; with any of these the rest is empty
  int64_t file_bytes = 0;
  int64_t channel = 0;
  std::unique_ptr<ArrayBytes> bytes;
  int64_t next_step = 0;        // that `bytes` are at
  std::vector<std::byte> held;  // a step, or all of them, as BytesHeld says
};

/// "a/b.raw" of a header in folder F: F/a/b.raw.
std::string Beside(const std::string& header, const std::string& name) {
  return (std::filesystem::path(header).parent_path() / name).lexically_normal().string();
}

/// The data files of a header in the set, in the set's spelling; what lacks goes to `needs`.
std::vector<std::string> FindDataFiles(const DenseHeader& header,
                                       const std::vector<std::string>& set,
                                       std::vector<std::string>* needs) {
  if (header.data_files.empty()) {
    return {set.front()};
  }
  std::vector<std::pair<std::string, std::string>> known;  // normal form, path
  for (const std::string& path : set) {
    known.emplace_back(std::filesystem::path(path).lexically_normal().string(), path);
  }
  std::sort(known.begin(), known.end());
  std::vector<std::string> found;
  for (const std::string& name : header.data_files) {
    const std::pair<std::string, std::string> wanted(Beside(set.front(), name), "");
    const auto place = std::lower_bound(known.begin(), known.end(), wanted);
    if (place == known.end() || place->first != wanted.first) {
      needs->push_back(name);
    } else {
      found.push_back(place->second);
    }
  }
  return found;
}

StatusOr<int64_t> ChooseChannel(const DenseHeader& header, const std::string& asked) {
  const int64_t channels = header.SizeOf(AxisRole::kChannel);
  if (channels == 1) {
    return 0;
  }
  const auto number = IntegerOf(asked, "--channel");
  if (asked.empty() || !number.ok() || *number < 0 || *number >= channels) {
    return InvalidArgument("has {} values in each voxel: choose one with --channel 0 to {}",
                           channels, channels - 1);
  }
  return *number;
}

StatusOr<DenseFile> OpenDense(const std::vector<std::string>& paths, const ReaderHints& hints,
                              FileFormat format) {
  DenseFile file;
  FOVEA_ASSIGN_OR_RETURN(file.header, ReadHeader(paths, hints, format));
  FOVEA_RETURN_IF_ERROR(CheckDenseHeader(file.header));
  FOVEA_ASSIGN_OR_RETURN(file.channel, ChooseChannel(file.header, hints.channel));
  const std::vector<std::string> data = FindDataFiles(file.header, paths, &file.needs);
  if (!file.needs.empty()) {
    return file;
  }
  FOVEA_ASSIGN_OR_RETURN(file.bytes,
                         OpenArray(file.header, data, &file.file_bytes, &file.header.warnings));
  return file;
}

/// Whether the steps lie one after another, so that one of them can be read without the others.
bool StepsAreApart(const DenseHeader& header) {
  return header.SizeOf(AxisRole::kStep) == 1 || header.axes.back().role == AxisRole::kStep;
}

bool IsStreamed(const DenseHeader& header) {
  return header.IsInOrder() && StepsAreApart(header) && header.SizeOf(AxisRole::kChannel) == 1;
}

/// What has to be in memory at a time: nothing, or a step, or all of them.
int64_t BytesHeld(const DenseHeader& header) {
  if (IsStreamed(header)) {
    return 0;
  }
  const int64_t all = header.Samples() * BytesOf(header.type);
  return StepsAreApart(header) ? all / header.SizeOf(AxisRole::kStep) : all;
}

class StreamedSamples : public DenseSamples {
 public:
  explicit StreamedSamples(ArrayBytes* bytes) : bytes_(bytes) {}
  Status ReadNext(std::span<std::byte> out) override { return bytes_->Read(out); }

 private:
  ArrayBytes* bytes_;
};

/// Samples that lie in any other order, picked out of memory.
class GatheredSamples : public DenseSamples {
 public:
  GatheredSamples(const DenseHeader& header, std::span<const std::byte> held, int64_t first)
      : dims_(header.Dims()),
        strides_{header.StrideOf(AxisRole::kX), header.StrideOf(AxisRole::kY),
                 header.StrideOf(AxisRole::kZ)},
        sample_bytes_(static_cast<size_t>(BytesOf(header.type))),
        held_(held),
        first_(first) {}

  Status ReadNext(std::span<std::byte> out) override {
    for (; !out.empty(); out = out.subspan(sample_bytes_)) {
      const int64_t sample = first_ + at_.x * strides_.x + at_.y * strides_.y + at_.z * strides_.z;
      std::memcpy(out.data(), held_.data() + static_cast<size_t>(sample) * sample_bytes_,
                  sample_bytes_);
      if (++at_.x == dims_.x) {
        at_.x = 0;
        if (++at_.y == dims_.y) {
          at_.y = 0;
          ++at_.z;
        }
      }
    }
    return absl::OkStatus();
  }

 private:
  Int3 dims_, strides_, at_;
  size_t sample_bytes_;
  std::span<const std::byte> held_;
  int64_t first_;  // sample of the step and channel
};

/// The file that was read last, so that the next step need not be looked for from the start.
struct LastFile {
  std::vector<std::string> paths;
  ReaderHints hints;
  DenseFile file;
};

StatusOr<DenseFile*> Reopen(const ReadRequest& request, FileFormat format,
                            std::optional<LastFile>* last) {
  const bool goes_on = *last && (*last)->paths == request.paths &&
                       (*last)->hints == request.hints &&
                       (*last)->file.next_step <= request.step_in_file;
  if (!goes_on) {
    last->reset();
    FOVEA_ASSIGN_OR_RETURN(DenseFile file, OpenDense(request.paths, request.hints, format));
    if (!file.needs.empty()) {
      return NotFound("its data file '{}' is not there", Shown(file.needs.front()));
    }
    last->emplace(LastFile{request.paths, request.hints, std::move(file)});
  }
  return &(*last)->file;
}

Status SendStep(const ReadRequest& request, DenseFile* file, Channel* channel) {
  const DenseHeader& header = file->header;
  const DenseFormat format{header.Dims(), header.type, header.big_endian, header.slope,
                           header.intercept};
  const int64_t step_bytes =
      header.Samples() / header.SizeOf(AxisRole::kStep) * BytesOf(header.type);
  const bool apart = StepsAreApart(header);
  if (apart) {
    FOVEA_RETURN_IF_ERROR(file->bytes->Skip((request.step_in_file - file->next_step) * step_bytes));
    file->next_step = request.step_in_file + 1;
  }
  if (IsStreamed(header)) {
    StreamedSamples samples(file->bytes.get());
    return SendDense(format, request.extent, &samples, channel);
  }
  if (apart || file->held.empty()) {
    file->held.resize(static_cast<size_t>(BytesHeld(header)));
    FOVEA_RETURN_IF_ERROR(file->bytes->Read(file->held));
  }
  const int64_t step = apart ? 0 : request.step_in_file * header.StrideOf(AxisRole::kStep);
  GatheredSamples samples(header, file->held,
                          file->channel * header.StrideOf(AxisRole::kChannel) + step);
  return SendDense(format, request.extent, &samples, channel);
}

Status Guarded(const std::function<Status()>& body) {
  try {
    return body();
  } catch (const std::bad_alloc&) {
    return OutOfMemory();
  }
}

}  // namespace

Status ScanDense(const ScanRequest& request, FileFormat format, Channel* channel) {
  return Guarded([&]() -> Status {
    FOVEA_ASSIGN_OR_RETURN(const DenseFile file, OpenDense(request.paths, request.hints, format));
    const DenseHeader& header = file.header;
    FileInfo about;
    about.file_bytes = file.file_bytes;
    about.world_unit = header.world_unit;
    about.is_dense = true;
    about.steps = header.SizeOf(AxisRole::kStep);
    about.times_s = header.times_s;
    about.needs = file.needs;
    about.warnings = header.warnings;
    FOVEA_RETURN_IF_ERROR(channel->Send(Encode(about), Channel::kNoDeadline));
    if (!file.needs.empty()) {
      return absl::OkStatus();
    }
    GridInfo grid;
    const bool is_sample = header.slope == 1 && header.intercept == 0;
    grid.type = is_sample ? std::string(NameOf(header.type)) : "float32";
    grid.box = Box3::OfSize(header.Dims());
    grid.index_to_world = header.index_to_world;
    grid.declared_bytes = BytesHeld(header);
    grid.value_unit = header.value_unit;
    return channel->Send(Encode(grid), Channel::kNoDeadline);
  });
}

Status ReadDense(const ReadRequest& request, FileFormat format, Channel* channel) {
  return Guarded([&]() -> Status {
    static std::optional<LastFile> last;
    FOVEA_ASSIGN_OR_RETURN(DenseFile* const file, Reopen(request, format, &last));
    if (request.grids.size() != 1 || request.step_in_file < 0 ||
        request.step_in_file >= file->header.SizeOf(AxisRole::kStep)) {
      return InvalidArgument("a request that does not fit the file");
    }
    const Status status = SendStep(request, file, channel);
    if (!status.ok()) {
      last.reset();  // it stopped anywhere
    }
    return status;
  });
}

}  // namespace fovea::ingest
