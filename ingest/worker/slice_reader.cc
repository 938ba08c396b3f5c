#include "ingest/worker/slice_reader.h"

#include <algorithm>
#include <cstring>
#include <functional>
#include <new>
#include <optional>
#include <utility>
#include <vector>

#include "ingest/worker/dense_sender.h"
#include "ingest/worker/headers/dense_header.h"
#include "ingest/worker/limits.h"
#include "ingest/worker/slice_stack.h"

namespace fovea::ingest {
namespace {

constexpr int64_t kRowsBytes = 4 << 20;  // read at a time, or one row

/// Rec. 709 luma of three colours as they are stored.
float Luminance(const float* rgb) {
  return static_cast<float>(0.2126 * static_cast<double>(rgb[0]) +
                            0.7152 * static_cast<double>(rgb[1]) +
                            0.0722 * static_cast<double>(rgb[2]));
}

/// The samples of one step, a few rows at a time.
class SliceSamples : public DenseSamples {
 public:
  SliceSamples(const SliceStack& stack, int64_t step)
      : stack_(stack), slice_(static_cast<size_t>(step * stack.SlicesPerStep())) {}

  Status ReadNext(std::span<std::byte> out) override {
    while (!out.empty()) {
      if (used_ == rows_.size()) {
        FOVEA_RETURN_IF_ERROR(ReadRows());
      }
      const size_t count = std::min(out.size(), rows_.size() - used_);
      std::memcpy(out.data(), rows_.data() + used_, count);
      used_ += count;
      out = out.subspan(count);
    }
    return absl::OkStatus();
  }

 private:
  Status ReadRows() {
    if (row_ == stack_.height) {
      row_ = 0;
      ++slice_;
    }
    if (slice_ >= stack_.slices.size()) {
      return Internal("reading beyond the slices");
    }
    if (row_ == 0) {
      FOVEA_RETURN_IF_ERROR(GoToSlice());
    }
    const int64_t row_bytes = stack_.width * BytesOf(stack_.type);
    const int64_t rows = std::clamp<int64_t>(kRowsBytes / row_bytes, 1, stack_.height - row_);
    rows_.resize(static_cast<size_t>(rows * row_bytes));
    used_ = 0;
    if (stack_.channel.luminance) {
      std::vector<float> colors(static_cast<size_t>(rows * stack_.width * 3));
      FOVEA_RETURN_IF_ERROR(
          file_->ReadRows(row_, rows, stack_.channel.first, 3, true, colors.data()));
      for (size_t i = 0; i < colors.size() / 3; ++i) {
        const float value = Luminance(&colors[3 * i]);
        std::memcpy(rows_.data() + i * sizeof(float), &value, sizeof(float));
      }
    } else {
      FOVEA_RETURN_IF_ERROR(
          file_->ReadRows(row_, rows, stack_.channel.first, 1, false, rows_.data()));
    }
    row_ += rows;
    return absl::OkStatus();
  }

  /// Opens the slice in hand, which must be as it was when it was scanned.
  Status GoToSlice() {
    const Slice& slice = stack_.slices[slice_];
    if (!file_ || path_ != slice.path) {
      FOVEA_ASSIGN_OR_RETURN(PictureFile file, PictureFile::Open(slice.path));
      file_.emplace(std::move(file));
      path_ = slice.path;
    }
    FOVEA_ASSIGN_OR_RETURN(const bool there, file_->GoTo(slice.page));
    const FoveaPage& page = file_->page();
    const bool same = there && page.width == stack_.width && page.height == stack_.height &&
                      page.channels > stack_.channel.first + (stack_.channel.luminance ? 2 : 0) &&
                      (stack_.channel.luminance || SampleTypeOf(page.type) == stack_.type);
    return same ? absl::OkStatus() : DataLoss("{}: changed while it was read", slice.path);
  }

  const SliceStack& stack_;
  size_t slice_;     // in hand
  int64_t row_ = 0;  // the next of it
  std::optional<PictureFile> file_;
  std::string path_;  // of file_
  std::vector<std::byte> rows_;
  size_t used_ = 0;  // bytes of rows_
};

Status Guarded(const std::function<Status()>& body) {
  try {
    return body();
  } catch (const std::bad_alloc&) {
    return OutOfMemory();
  }
}

/// The stack that was read last: looking at every file for each step would take long.
struct LastStack {
  std::vector<std::string> paths;
  ReaderHints hints;
  SliceStack stack;
};

}  // namespace

Status ScanSlices(const ScanRequest& request, Channel* channel) {
  return Guarded([&]() -> Status {
    FOVEA_ASSIGN_OR_RETURN(
        const SliceStack stack,
        LookAtSlices(request.paths, request.hints.channel, request.hints.slices_per_step));
    FileInfo about;
    about.file_bytes = stack.file_bytes;
    about.world_unit = stack.unit;
    about.is_dense = true;
    about.steps = stack.steps;
    about.warnings = stack.warnings;
    FOVEA_RETURN_IF_ERROR(channel->Send(Encode(about), Channel::kNoDeadline));
    GridInfo grid;
    grid.type = std::string(NameOf(stack.type));
    grid.box = Box3::OfSize({stack.width, stack.height, stack.SlicesPerStep()});
    grid.index_to_world = SpacingMatrix(stack.spacing);
    grid.declared_bytes = stack.page_bytes;
    return channel->Send(Encode(grid), Channel::kNoDeadline);
  });
}

Status ReadSlices(const ReadRequest& request, Channel* channel) {
  return Guarded([&]() -> Status {
    static std::optional<LastStack> last;
    if (!last || last->paths != request.paths || last->hints != request.hints) {
      last.reset();
      FOVEA_ASSIGN_OR_RETURN(SliceStack stack, LookAtSlices(request.paths, request.hints.channel,
                                                            request.hints.slices_per_step));
      last.emplace(LastStack{request.paths, request.hints, std::move(stack)});
    }
    const SliceStack& stack = last->stack;
    if (request.grids.size() != 1 || request.step_in_file < 0 ||
        request.step_in_file >= stack.steps) {
      return InvalidArgument("a request that does not fit the slices");
    }
    SliceSamples samples(stack, request.step_in_file);
    DenseFormat format;
    format.dims = {stack.width, stack.height, stack.SlicesPerStep()};
    format.type = stack.type;
    return SendDense(format, request.extent, &samples, channel);
  });
}

}  // namespace fovea::ingest
