#include "tests/bench/scenes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <iterator>

#include "engine/wavelet/haar.h"

namespace fovea::bench {
namespace {

struct Source {
  std::string_view name;
  std::string_view file;
  Int3 dims;
  Vec3 fovea;
};

constexpr Source kSources[] = {
    {"brain", "brain_volpack_128x128x84_u8.raw", {128, 128, 84}, {64, 64, 42}},
    {"bonsai", "bonsai_ct_256x256x256_u8.raw", {256, 256, 256}, {136, 124, 128}},
    {"colin27", "colin27_mri_181x217x181_u8.raw", {181, 217, 181}, {90, 108, 90}},
};

void FillVoxels(Volume* volume) {
  volume->voxels = Grid(Box3::OfSize(volume->dims));
  std::transform(volume->bytes.begin(), volume->bytes.end(), volume->voxels.values.begin(),
                 [](uint8_t byte) { return static_cast<float>(byte); });
}

/// Where each of `to` cell centres falls among `from` cell centres: the lower neighbour, and how
/// far towards the upper one.
struct Tap {
  int64_t low, high;
  float part;
};

std::vector<Tap> TapsOf(int64_t from, int64_t to) {
  std::vector<Tap> taps;
  for (int64_t i = 0; i < to; ++i) {
    const double at =
        (static_cast<double>(i) + 0.5) * static_cast<double>(from) / static_cast<double>(to) - 0.5;
    const double floor_at = std::floor(at);
    const auto low = static_cast<int64_t>(floor_at);
    taps.push_back({std::clamp<int64_t>(low, 0, from - 1),
                    std::clamp<int64_t>(low + 1, 0, from - 1), static_cast<float>(at - floor_at)});
  }
  return taps;
}

/// Trilinear, cell centre to cell centre, so that the longest axis has `longest` voxels.
Volume Enlarged(const Volume& small, int64_t longest) {
  Volume large;
  large.name = small.name + std::to_string(longest);
  std::array<std::vector<Tap>, 3> taps;
  for (int axis = 0; axis < 3; ++axis) {
    large.dims[axis] = small.dims[axis] * longest / small.dims.Max();
    large.fovea[axis] = small.fovea[axis] * static_cast<double>(large.dims[axis]) /
                        static_cast<double>(small.dims[axis]);
    taps[axis] = TapsOf(small.dims[axis], large.dims[axis]);
  }
  large.bytes.reserve(static_cast<size_t>(large.dims.Product()));
  std::vector<float> row(static_cast<size_t>(small.dims.x));
  for (const Tap& z : taps[2]) {
    for (const Tap& y : taps[1]) {
      const float* rows[4] = {small.voxels.Row(y.low, z.low), small.voxels.Row(y.high, z.low),
                              small.voxels.Row(y.low, z.high), small.voxels.Row(y.high, z.high)};
      for (size_t x = 0; x < row.size(); ++x) {
        const float near = rows[0][x] + y.part * (rows[1][x] - rows[0][x]);
        const float far = rows[2][x] + y.part * (rows[3][x] - rows[2][x]);
        row[x] = near + z.part * (far - near);
      }
      for (const Tap& x : taps[0]) {
        large.bytes.push_back(
            static_cast<uint8_t>(row[x.low] + x.part * (row[x.high] - row[x.low]) + 0.5F));
      }
    }
  }
  FillVoxels(&large);
  return large;
}

/// Waves along one axis, so that a voxel costs no sine.
std::vector<float> Waves(int64_t size, double length, double phase) {
  std::vector<float> waves;
  for (int64_t i = 0; i < size; ++i) {
    waves.push_back(static_cast<float>(std::sin((static_cast<double>(i) + 0.5) / length + phase)));
  }
  return waves;
}

/// A rough solid ball (values near 220) in a cloud of uneven density (up to 190) in empty space.
Volume Procedural(int64_t n) {
  Volume volume;
  volume.name = "procedural" + std::to_string(n);
  volume.dims = {n, n, n};
  // On the ball's surface, where the view from above meets it.
  volume.fovea = {0.5 * static_cast<double>(n), 0.5 * static_cast<double>(n),
                  0.65 * static_cast<double>(n)};
  volume.bytes.reserve(static_cast<size_t>(volume.dims.Product()));
  const double unit = static_cast<double>(n) / 256;
  const std::vector<float> fine = Waves(n, 2.6, 0.3);
  const std::vector<float> coarse = Waves(n, 11 * unit, 1.1);
  for (int64_t z = 0; z < n; ++z) {
    for (int64_t y = 0; y < n; ++y) {
      for (int64_t x = 0; x < n; ++x) {
        const auto offset = [n](int64_t i) {
          return (static_cast<float>(i) + 0.5F) * 2 / static_cast<float>(n) - 1;
        };
        const float squared =
            offset(x) * offset(x) + offset(y) * offset(y) + 1.6F * offset(z) * offset(z);
        const float bumps = coarse[x] * coarse[y] + coarse[z] * coarse[x];
        const float grain = fine[x] * fine[y] * fine[z];
        float value = 0;
        if (squared + 0.03F * bumps < 0.16F) {
          value = 220 + 20 * grain + 10 * bumps;
        } else if (squared < 0.7F) {
          value = std::max(0.0F, (0.7F - squared) * 200 * (1 + 0.5F * bumps) + 8 * grain);
        }
        volume.bytes.push_back(static_cast<uint8_t>(std::clamp(value, 0.0F, 255.0F)));
      }
    }
  }
  FillVoxels(&volume);
  return volume;
}

StatusOr<Volume> LoadShared(const Source& source) {
  const char* folder = std::getenv("FOVEA_TEST_DATA");
  if (folder == nullptr) {
    return InvalidArgument(
        "'{}' is a shared volume: set FOVEA_TEST_DATA to the folder that holds "
        "volumes/{}, or take procedural256 or procedural512",
        source.name, source.file);
  }
  FOVEA_ASSIGN_OR_RETURN(Volume volume,
                         LoadRaw(fmt::format("{}/volumes/{}", folder, source.file), source.dims));
  volume.name = std::string(source.name);
  volume.fovea = source.fovea;
  return volume;
}

}  // namespace

StatusOr<Volume> LoadRaw(const std::string& path, const Int3& dims) {
  std::ifstream file(path, std::ios::binary);
  if (!file) {
    return NotFound("{} cannot be opened", path);
  }
  Volume volume;
  volume.name = path;
  volume.dims = dims;
  volume.fovea = 0.5 * Vec3{static_cast<double>(dims.x), static_cast<double>(dims.y),
                            static_cast<double>(dims.z)};
  volume.bytes.assign(std::istreambuf_iterator<char>(file), {});
  if (static_cast<int64_t>(volume.bytes.size()) != dims.Product()) {
    return InvalidArgument("{} has {} bytes, {}x{}x{} voxels of 8 bits are {}", path,
                           volume.bytes.size(), dims.x, dims.y, dims.z, dims.Product());
  }
  FillVoxels(&volume);
  return volume;
}

StatusOr<Volume> LoadVolume(const std::string& name) {
  if (name == "procedural256" || name == "procedural512") {
    return Procedural(name == "procedural256" ? 256 : 512);
  }
  for (const Source& source : kSources) {
    if (name == source.name) {
      return LoadShared(source);
    }
    if (name == std::string(source.name) + "512") {
      FOVEA_ASSIGN_OR_RETURN(const Volume small, LoadShared(source));
      return Enlarged(small, 512);
    }
  }
  return InvalidArgument(
      "no volume '{}': there are brain, bonsai, colin27 (each also with 512 "
      "behind it), procedural256 and procedural512",
      name);
}

render::TransferFunction TransferFor(std::string_view volume, bool opaque) {
  // Where the object begins and where it is densest, in grey levels, and opacity there.
  struct Look {
    std::string_view volume;
    double foot, top;
    float most;  // semi-transparent
  };
  constexpr Look kLooks[] = {{"bonsai", 27, 140, 0.05F},
                             {"brain", 24, 130, 0.08F},
                             {"colin27", 40, 150, 0.03F},
                             {"", 20, 220, 0.06F}};
  const Look& look = *std::find_if(std::begin(kLooks), std::end(kLooks), [&](const Look& each) {
    return volume.starts_with(each.volume);
  });
  // In 512 voxels the same object is twice as many voxels long.
  const float semi = volume.ends_with("512") ? look.most / 2 : look.most;
  const float most = opaque ? 0.9F : semi;
  const double edge = look.foot + (opaque ? 0.15 : 0.5) * (look.top - look.foot);
  return {{{look.foot, {0.30F, 0.08F, 0.03F}, 0},
           {edge, {0.85F, 0.45F, 0.15F}, opaque ? most : most / 2},
           {look.top, {1.0F, 0.95F, 0.85F}, most}}};
}

StatusOr<CoefficientSet> Transform(const Volume& volume) {
  BrickGrid bricks(volume.dims, 16, 1, 0.0F);
  bricks.CopyIn(volume.voxels.box, volume.voxels.values);
  FOVEA_ASSIGN_OR_RETURN(const Hierarchy hierarchy, Hierarchy::Make(volume.dims));
  return wavelet::ForwardHaar(bricks, hierarchy, 0);
}

render::RenderSettings SettingsFor(const Int3& dims, double degrees,
                                   const render::TransferFunction& transfer, int threads) {
  render::RenderSettings settings;
  settings.view = {180, degrees - 90, {}, static_cast<double>(dims.Max())};
  settings.transfer = transfer;
  settings.width_px = settings.height_px = static_cast<int>(dims.Max());
  settings.threads = threads;
  return settings;
}

double Median(std::vector<double> values) {
  if (values.empty()) {
    return 0;
  }
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

double Psnr(const render::Image& a, const render::Image& b) {
  double sum = 0;
  size_t count = 0;
  for (size_t i = 0; i < std::min(a.rgba.size(), b.rgba.size()); ++i) {
    if (i % 4 != 3) {
      const double difference = a.rgba[i] - b.rgba[i];
      sum += difference * difference;
      ++count;
    }
  }
  return sum > 0 ? 10 * std::log10(static_cast<double>(count) / sum) : 999;
}

Status WritePpm(const render::Image& image, const std::string& path) {
  const std::vector<uint8_t> pixels = render::ToSrgb8(image, {});
  std::ofstream file(path, std::ios::binary);
  file << fmt::format("P6\n{} {}\n255\n", image.width, image.height);
  for (size_t i = 0; i < pixels.size(); i += 4) {
    file.write(reinterpret_cast<const char*>(&pixels[i]), 3);
  }
  return file ? absl::OkStatus() : Internal("{} cannot be written", path);
}

}  // namespace fovea::bench
