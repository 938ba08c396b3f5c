#include "ingest/worker/slice_module.h"

#include <algorithm>
#include <exception>
#include <memory>
#include <string>
#include <vector>

#include <OpenImageIO/imageio.h>

namespace {

struct Pictures {
  std::unique_ptr<OIIO::ImageInput> input;
  int page = 0;
};

void Copy(const std::string& text, char* to, size_t bytes) {
  const size_t count = std::min(text.size(), bytes - 1);
  std::copy_n(text.begin(), count, to);
  to[count] = '\0';
}

const char* TypeName(const OIIO::TypeDesc& type) {
  switch (type.basetype) {
    case OIIO::TypeDesc::UINT8:
      return "uint8";
    case OIIO::TypeDesc::INT8:
      return "int8";
    case OIIO::TypeDesc::UINT16:
      return "uint16";
    case OIIO::TypeDesc::INT16:
      return "int16";
    case OIIO::TypeDesc::UINT32:
      return "uint32";
    case OIIO::TypeDesc::INT32:
      return "int32";
    case OIIO::TypeDesc::UINT64:
      return "uint64";
    case OIIO::TypeDesc::INT64:
      return "int64";
    case OIIO::TypeDesc::HALF:
      return "float16";
    case OIIO::TypeDesc::FLOAT:
      return "float32";
    case OIIO::TypeDesc::DOUBLE:
      return "float64";
    default:
      return "";
  }
}

/// What 1.0 of OpenImageIO's floats is in samples of that type: it normalises unsigned and signed
/// integers to their greatest value.
float GreatestOf(const OIIO::TypeDesc& type) {
  switch (type.basetype) {
    case OIIO::TypeDesc::UINT8:
      return 255.0F;
    case OIIO::TypeDesc::INT8:
      return 127.0F;
    case OIIO::TypeDesc::UINT16:
      return 65535.0F;
    case OIIO::TypeDesc::INT16:
      return 32767.0F;
    case OIIO::TypeDesc::UINT32:
      return 4294967295.0F;
    case OIIO::TypeDesc::INT32:
      return 2147483647.0F;
    default:
      return 1.0F;
  }
}

void Describe(const OIIO::ImageSpec& spec, FoveaPage* page) {
  *page = {};
  page->width = spec.width;
  page->height = spec.height;
  page->channels = spec.nchannels;
  Copy(spec.channelformats.empty() ? TypeName(spec.format) : "", page->type, sizeof(page->type));
  std::string names;
  for (const std::string& name : spec.channelnames) {
    names += (names.empty() ? "" : ",") + name;
  }
  Copy(names, page->channel_names, sizeof(page->channel_names));
  Copy(spec.get_string_attribute("ImageDescription"), page->description, sizeof(page->description));
  page->x_resolution = spec.get_float_attribute("XResolution");
  page->y_resolution = spec.get_float_attribute("YResolution");
  Copy(spec.get_string_attribute("ResolutionUnit"), page->resolution_unit,
       sizeof(page->resolution_unit));
}

}  // namespace

extern "C" {

void* fovea_open_pictures(const char* path, char* error, size_t error_bytes) {
  try {
    OIIO::attribute("threads", 1);
    OIIO::ImageSpec hints;
    hints.attribute("oiio:UnassociatedAlpha", 1);  // values as they are in the file
    auto input = OIIO::ImageInput::open(path, &hints);
    if (input == nullptr) {
      Copy(OIIO::geterror(), error, error_bytes);
      return nullptr;
    }
    return new Pictures{std::move(input), 0};
  } catch (const std::exception& exception) {
    Copy(exception.what(), error, error_bytes);
    return nullptr;
  }
}

void fovea_close_pictures(void* pictures) {
  try {
    delete static_cast<Pictures*>(pictures);
  } catch (const std::exception&) {  // it is closed either way
  }
}

int fovea_go_to_page(void* pictures, int number, FoveaPage* page, char* error, size_t error_bytes) {
  auto* self = static_cast<Pictures*>(pictures);
  try {
    if (!self->input->seek_subimage(number, 0)) {
      Copy(self->input->geterror(), error, error_bytes);
      return 0;
    }
    self->page = number;
    Describe(self->input->spec(), page);
    return 1;
  } catch (const std::exception& exception) {
    Copy(exception.what(), error, error_bytes);
    return -1;
  }
}

bool fovea_read_rows(void* pictures, int64_t first_row, int64_t rows, int first_channel,
                     int channels, bool as_float, void* out, char* error, size_t error_bytes) {
  auto* self = static_cast<Pictures*>(pictures);
  try {
    const OIIO::ImageSpec& spec = self->input->spec();
    const int begin = spec.y + static_cast<int>(first_row);
    const OIIO::TypeDesc type = as_float ? OIIO::TypeDesc::FLOAT : spec.format;
    const int end = begin + static_cast<int>(rows);
    bool done = false;
    if (spec.tile_width > 0) {
      // Tiles are read whole; rows are picked out of them.
      const int tile = spec.tile_height;
      const int low = spec.y + (begin - spec.y) / tile * tile;
      const int high =
          std::min(spec.y + spec.height, spec.y + ((end - spec.y - 1) / tile + 1) * tile);
      const size_t row =
          static_cast<size_t>(spec.width) * static_cast<size_t>(channels) * type.size();
      std::vector<char> band(row * static_cast<size_t>(high - low));
      done = self->input->read_tiles(self->page, 0, spec.x, spec.x + spec.width, low, high, 0, 1,
                                     first_channel, first_channel + channels, type, band.data());
      std::copy_n(band.data() + row * static_cast<size_t>(begin - low),
                  row * static_cast<size_t>(rows), static_cast<char*>(out));
    } else {
      done = self->input->read_scanlines(self->page, 0, begin, end, 0, first_channel,
                                         first_channel + channels, type, out);
    }
    if (!done) {
      Copy(self->input->geterror(), error, error_bytes);
      return false;
    }
    if (as_float) {
      const float greatest = GreatestOf(spec.format);
      auto* values = static_cast<float*>(out);
      const int64_t count = rows * spec.width * channels;
      for (int64_t i = 0; greatest != 1.0F && i < count; ++i) {
        values[i] *= greatest;
      }
    }
    return true;
  } catch (const std::exception& exception) {
    Copy(exception.what(), error, error_bytes);
    return false;
  }
}

}  // extern "C"
