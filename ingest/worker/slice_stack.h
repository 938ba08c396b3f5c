#ifndef INGEST_WORKER_SLICE_STACK_H_
#define INGEST_WORKER_SLICE_STACK_H_

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "engine/base/status.h"
#include "engine/volume/geometry.h"
#include "ingest/sample_type.h"
#include "ingest/worker/slice_module.h"

namespace fovea::ingest {

/// The functions of the picture module; FAILED_PRECONDITION if it was not loaded.
struct SliceFunctions {
  FoveaOpenPictures open = nullptr;
  FoveaClosePictures close = nullptr;
  FoveaGoToPage go_to_page = nullptr;
  FoveaReadRows read_rows = nullptr;
};
[[nodiscard]] StatusOr<SliceFunctions> SliceModule();

/// A picture file that is open.
class PictureFile {
 public:
  [[nodiscard]] static StatusOr<PictureFile> Open(const std::string& path);
  /// Whether there is such a page, which is then the one in hand.
  [[nodiscard]] StatusOr<bool> GoTo(int number);
  [[nodiscard]] const FoveaPage& page() const { return page_; }
  /// Rows of the page in hand.
  [[nodiscard]] Status ReadRows(int64_t first_row, int64_t rows, int first_channel, int channels,
                                bool as_float, void* out);

 private:
  PictureFile(const std::string& path, const SliceFunctions& functions, void* handle)
      : path_(path), functions_(functions), handle_(handle, functions.close) {}

  std::string path_;
  SliceFunctions functions_;
  std::unique_ptr<void, FoveaClosePictures> handle_;
  FoveaPage page_;
};

/// What a page becomes: one channel of it in its own type, or its luminance as float32.
struct SliceChannel {
  bool luminance = false;
  int first = 0;  // of the three colours, or the channel
};

struct Slice {
  std::string path;
  int page = 0;
};

/// All the slices of a file set, looked at.
struct SliceStack {
  std::vector<Slice> slices;
  int64_t width = 0, height = 0;
  SampleType type = SampleType::kUint8;
  SliceChannel channel;
  int64_t steps = 1;
  Vec3 spacing{1, 1, 1};
  std::string unit;  // of the spacing
  int64_t file_bytes = 0;
  int64_t page_bytes = 0;  // of one page, all channels: what decoding it may take
  std::vector<std::string> warnings;

  [[nodiscard]] int64_t SlicesPerStep() const {
    return static_cast<int64_t>(slices.size()) / steps;
  }
};

/// Looks at every page of every file: sizes, types and channels must agree, and the error names the
/// file that differs. `asked` is the channel, by number or name, "luminance", or empty.
[[nodiscard]] StatusOr<SliceStack> LookAtSlices(const std::vector<std::string>& paths,
                                                const std::string& asked, int64_t slices_per_step);

}  // namespace fovea::ingest

#endif  // INGEST_WORKER_SLICE_STACK_H_
