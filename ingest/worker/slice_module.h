#ifndef INGEST_WORKER_SLICE_MODULE_H_
#define INGEST_WORKER_SLICE_MODULE_H_

#include <cstddef>
#include <cstdint>

/// Reading pictures through the module that holds OpenImageIO (picture_module.h). Every function
/// that can fail puts the reason, zero-terminated, into `error`.
extern "C" {

/// A page of a picture file.
struct FoveaPage {
  int64_t width = 0, height = 0;
  int channels = 0;
  char type[16] = "";            // of its samples, as SampleType names it; empty: another type
  char channel_names[512] = "";  // with a comma between them
  char description[2048] = "";   // TIFF's ImageDescription, where ImageJ writes its spacing
  double x_resolution = 0, y_resolution = 0;  // pixels a unit; 0: not said
  char resolution_unit[16] = "";
};

/// A file, or null.
using FoveaOpenPictures = void* (*)(const char* path, char* error, size_t error_bytes);
using FoveaClosePictures = void (*)(void* pictures);
/// Goes to a page, from 0. Returns 1 and fills `page`, or 0: there is no such page, or -1: failed.
using FoveaGoToPage = int (*)(void* pictures, int number, FoveaPage* page, char* error,
                              size_t error_bytes);
/// Rows of some channels of the page, in its own type (`as_float`: as float32, integers as they
/// are), one row after another.
using FoveaReadRows = bool (*)(void* pictures, int64_t first_row, int64_t rows, int first_channel,
                               int channels, bool as_float, void* out, char* error,
                               size_t error_bytes);
}

inline constexpr char kFoveaOpenPictures[] = "fovea_open_pictures";
inline constexpr char kFoveaClosePictures[] = "fovea_close_pictures";
inline constexpr char kFoveaGoToPage[] = "fovea_go_to_page";
inline constexpr char kFoveaReadRows[] = "fovea_read_rows";

#endif  // INGEST_WORKER_SLICE_MODULE_H_
