#include "ingest/worker/slice_stack.h"

#include <algorithm>
#include <array>
#include <filesystem>
#include <utility>

#include <dlfcn.h>

#include "engine/volume/hierarchy.h"
#include "ingest/protocol.h"
#include "ingest/worker/headers/text.h"
#include "ingest/worker/input_file.h"
#include "ingest/worker/picture_encoder.h"

namespace fovea::ingest {
namespace {

constexpr size_t kErrorBytes = 512;
constexpr int kMaxPages = 1'000'000;

std::vector<std::string> Split(const std::string& text) {
  std::vector<std::string> parts;
  for (size_t begin = 0; begin <= text.size();) {
    const size_t end = std::min(text.find(',', begin), text.size());
    parts.push_back(text.substr(begin, end - begin));
    begin = end + 1;
  }
  return parts;
}

/// The value of `key=` in ImageJ's description; empty if there is none.
std::string ImageJ(const FoveaPage& page, const std::string& key) {
  std::string_view rest = page.description;
  if (!rest.starts_with("ImageJ=")) {
    return {};
  }
  bool ended = false;
  while (!rest.empty()) {
    const std::string_view line = TakeLine(&rest, &ended);
    if (line.starts_with(key + "=")) {
      return std::string(line.substr(key.size() + 1));
    }
  }
  return {};
}

/// Voxels as ImageJ says, or as TIFF's resolution does (the slices then as far apart as the
/// pixels are wide).
void SetSpacing(const FoveaPage& page, SliceStack* stack) {
  const auto size = [](double resolution) { return resolution > 0 ? 1 / resolution : 0; };
  const Vec3 pixel{size(page.x_resolution), size(page.y_resolution), 0};
  const bool is_imagej = std::string_view(page.description).starts_with("ImageJ=");
  const std::string unit(Trimmed(is_imagej ? ImageJ(page, "unit") : page.resolution_unit));
  const double scale = is_imagej ? 1 : unit == "cm" ? 10 : unit == "in" ? 25.4 : 0;
  if (scale > 0 && pixel.x > 0 && pixel.y > 0) {
    stack->spacing = {pixel.x * scale, pixel.y * scale, pixel.x * scale};
    stack->unit = !is_imagej                                                      ? "mm"
                  : unit == "\\u00B5m" || unit == "\xC2\xB5m" || unit == "micron" ? "um"
                                                                                  : unit;
    if (stack->unit == "pixel" || stack->unit == "pixels") {
      stack->unit.clear();
    }
  }
  const auto between = RealOf(ImageJ(page, "spacing"), "spacing");
  if (is_imagej && between.ok() && *between > 0 && *between < 1e12) {
    stack->spacing.z = *between;
  } else if (scale > 0 && stack->unit == "mm") {
    stack->warnings.push_back(
        "the files say how large a pixel is, but not how far apart the slices are: taken as far "
        "apart as pixels are wide (--spacing says otherwise)");
  }
}

/// Which channel of a page is wanted.
StatusOr<SliceChannel> Choose(const FoveaPage& page, const std::string& asked,
                              std::vector<std::string>* warnings) {
  const std::vector<std::string> names = Split(page.channel_names);
  const auto find = [&](const std::string& name) {
    const auto found = std::find(names.begin(), names.end(), name);
    return found == names.end() ? -1 : static_cast<int>(found - names.begin());
  };
  const int red = find("R");
  const bool is_color = red >= 0 && find("G") == red + 1 && find("B") == red + 2;
  if (asked == "luminance" && is_color) {
    return SliceChannel{true, red};
  }
  if (asked.empty() || asked == "luminance") {
    if (page.channels == 1) {
      return SliceChannel{};
    }
    if (is_color) {
      warnings->push_back(
          "the pictures have colours: their luminance is taken (--channel R, G or "
          "B takes one of them)");
      return SliceChannel{true, red};
    }
    if (page.channels == 2) {
      warnings->push_back(
          fmt::format("the pictures have two channels: {} is taken (--channel 1 "
                      "takes the other)",
                      names.front()));
      return SliceChannel{};
    }
    return InvalidArgument("has {} channels, {}: choose one with --channel", page.channels,
                           Shown(page.channel_names));
  }
  const auto number = IntegerOf(asked, "channel");
  const int64_t index = number.ok() ? *number : find(asked);
  if (index < 0 || index >= page.channels) {
    return InvalidArgument("has no channel '{}'; there are {}, by number from 0", Shown(asked),
                           Shown(page.channel_names));
  }
  return SliceChannel{false, static_cast<int>(index)};
}

/// What one file adds to the stack; `pages` gets how many it has.
Status AddFile(const std::string& path, const std::string& asked, SliceStack* stack,
               FoveaPage* first, int* pages) {
  FOVEA_ASSIGN_OR_RETURN(const InputFile on_disk, InputFile::Open(path));
  stack->file_bytes += on_disk.size();
  FOVEA_ASSIGN_OR_RETURN(PictureFile file, PictureFile::Open(path));
  for (*pages = 0; *pages < kMaxPages; ++*pages) {
    FOVEA_ASSIGN_OR_RETURN(const bool there, file.GoTo(*pages));
    if (!there) {
      break;
    }
    const FoveaPage& page = file.page();
    if (stack->slices.empty()) {
      *first = page;
      const auto type = SampleTypeOf(page.type);
      constexpr int kMaxChannels = 1024;
      if (!type || page.width < 1 || page.width > kMaxDimension || page.height < 1 ||
          page.height > kMaxDimension || page.channels < 1 || page.channels > kMaxChannels) {
        return InvalidArgument(
            "a picture of {} x {} pixels with {} channels of type '{}' cannot be "
            "read",
            page.width, page.height, page.channels, page.type);
      }
      stack->page_bytes = page.width * page.height * page.channels * BytesOf(*type);
      FOVEA_ASSIGN_OR_RETURN(stack->channel, Choose(page, asked, &stack->warnings));
      stack->type = stack->channel.luminance ? SampleType::kFloat32 : *type;
      stack->width = page.width;
      stack->height = page.height;
    } else if (page.width != first->width || page.height != first->height) {
      return InvalidArgument(
          "has {} x {} pixels, but '{}' has {} x {}: the slices of a volume are "
          "of one size",
          page.width, page.height, stack->slices.front().path, first->width, first->height);
    } else if (page.channels != first->channels || std::string_view(page.type) != first->type) {
      return InvalidArgument(
          "has {} channels of {}, but '{}' has {} of {}: the slices of a volume "
          "are of one kind",
          page.channels, page.type, stack->slices.front().path, first->channels, first->type);
    }
    stack->slices.push_back({path, *pages});
  }
  const auto images = IntegerOf(ImageJ(*first, "images"), "images");
  if (*pages == 1 && images.ok() && *images > 1) {
    return InvalidArgument(
        "is an ImageJ stack of {} slices that lists only its first: save it again as a TIFF "
        "sequence, or read it with --raw",
        *images);
  }
  return *pages > 0 ? absl::OkStatus() : DataLoss("holds no picture");
}

}  // namespace

StatusOr<SliceFunctions> SliceModule() {
  FOVEA_ASSIGN_OR_RETURN(void* const module, PictureModuleHandle());
  SliceFunctions functions{
      reinterpret_cast<FoveaOpenPictures>(::dlsym(module, kFoveaOpenPictures)),
      reinterpret_cast<FoveaClosePictures>(::dlsym(module, kFoveaClosePictures)),
      reinterpret_cast<FoveaGoToPage>(::dlsym(module, kFoveaGoToPage)),
      reinterpret_cast<FoveaReadRows>(::dlsym(module, kFoveaReadRows))};
  if (functions.open == nullptr || functions.close == nullptr || functions.go_to_page == nullptr ||
      functions.read_rows == nullptr) {
    return FailedPrecondition("the module that reads pictures is of another version");
  }
  return functions;
}

StatusOr<PictureFile> PictureFile::Open(const std::string& path) {
  FOVEA_ASSIGN_OR_RETURN(const SliceFunctions functions, SliceModule());
  std::array<char, kErrorBytes> error{};
  void* handle = functions.open(path.c_str(), error.data(), error.size());
  if (handle == nullptr) {
    return DataLoss("OpenImageIO cannot read it: {}", Printable(error.data()));
  }
  return PictureFile(path, functions, handle);
}

StatusOr<bool> PictureFile::GoTo(int number) {
  std::array<char, kErrorBytes> error{};
  const int result =
      functions_.go_to_page(handle_.get(), number, &page_, error.data(), error.size());
  if (result < 0 || (result == 0 && number == 0)) {
    return DataLoss("OpenImageIO cannot read page {}: {}", number, Printable(error.data()));
  }
  return result == 1;
}

Status PictureFile::ReadRows(int64_t first_row, int64_t rows, int first_channel, int channels,
                             bool as_float, void* out) {
  std::array<char, kErrorBytes> error{};
  if (!functions_.read_rows(handle_.get(), first_row, rows, first_channel, channels, as_float, out,
                            error.data(), error.size())) {
    return DataLoss("{}: cut short or damaged: {}",
                    std::filesystem::path(path_).filename().string(), Printable(error.data()));
  }
  return absl::OkStatus();
}

StatusOr<SliceStack> LookAtSlices(const std::vector<std::string>& paths, const std::string& asked,
                                  int64_t slices_per_step) {
  SliceStack stack;
  FoveaPage first;
  std::vector<int> pages;
  for (const std::string& path : paths) {
    const Status status = AddFile(path, asked, &stack, &first, &pages.emplace_back());
    if (!status.ok()) {
      return path == paths.front() ? status : Annotate(status, path);
    }
  }
  const auto total = static_cast<int64_t>(stack.slices.size());
  const auto is_single = [](int count) { return count == 1; };
  if (slices_per_step > 0) {
    if (total % slices_per_step != 0) {
      return InvalidArgument("{} slices cannot be steps of --slices {}", total, slices_per_step);
    }
    stack.steps = total / slices_per_step;
  } else if (pages.size() > 1 && std::none_of(pages.begin(), pages.end(), is_single)) {
    for (size_t i = 0; i < pages.size(); ++i) {
      if (pages[i] != pages.front()) {
        return InvalidArgument(
            "{}: has {} slices, but '{}' has {}: the steps of a series are of "
            "one size (--slices says how many make a step)",
            paths[i], pages[i], paths.front(), pages.front());
      }
    }
    stack.steps = static_cast<int64_t>(pages.size());
  }
  if (stack.SlicesPerStep() > kMaxDimension) {
    return InvalidArgument("{} slices: at most {} make a step (--slices says how many)",
                           stack.SlicesPerStep(), kMaxDimension);
  }
  SetSpacing(first, &stack);
  return stack;
}

}  // namespace fovea::ingest
