// Bytes and time of a frame as PNG, JPEG and FOVEATED, over an orbit, one thread:
//   frame_bytes_bench STORE.zarr [--step N] [--rate R] [--pixels SIDE] [--views N] [--rounds N]
//                     [--elevation DEGREES]
// PSNR is that of the 8-bit colours against the same picture in full precision (sRGB, not rounded).
// For each number of bits of FOVEATED: the least JPEG quality that is as close, if there is one.
// Times are the processor's, the least of the rounds, in turns; of what follows the expanded
// picture (PNG, JPEG: sRGB bytes and the encoder) or the pyramid (FOVEATED).
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <functional>
#include <string>
#include <vector>

#include "engine/fovea/reconstruct.h"
#include "engine/render/leaf_scale.h"
#include "service/frames/encode.h"
#include "service/frames/foveated_codec.h"
#include "service/frames/foveated_picture.h"
#include "service/frames/frames.h"
#include "tests/support/decode.h"

namespace fovea {
namespace {

struct Options {
  std::string store;
  int64_t step = 0;
  double rate = 40;
  int pixels = 1024;
  int views = 12;
  int rounds = 5;
  double elevation_deg = 20;
};

/// Colours times 255, not rounded.
std::vector<float> TrueBytes(const render::Image& image) {
  std::vector<float> bytes;
  bytes.reserve(3 * image.rgba.size() / 4);
  for (size_t i = 0; i < image.rgba.size(); ++i) {
    if (i % 4 != 3) {
      const double x = std::clamp<double>(image.rgba[i], 0, 1);
      const double srgb = x <= 0.0031308 ? 12.92 * x : 1.055 * std::pow(x, 1 / 2.4) - 0.055;
      bytes.push_back(static_cast<float>(255 * srgb));
    }
  }
  return bytes;
}

double Psnr(const std::vector<float>& truth, const std::function<double(size_t)>& got) {
  double sum = 0;
  for (size_t i = 0; i < truth.size(); ++i) {
    const double error = got(i) - truth[i];
    sum += error * error;
  }
  return 10 * std::log10(255.0 * 255.0 * static_cast<double>(truth.size()) / sum);
}

double PsnrOfRgba(const std::vector<float>& truth, const std::vector<uint8_t>& rgba) {
  return Psnr(truth, [&](size_t i) { return rgba[i / 3 * 4 + i % 3]; });
}

struct Sum {
  double bytes = 0, ms = 0, psnr = 0;
  int count = 0;
  void Add(double more_bytes, double more_ms, double more_psnr) {
    bytes += more_bytes;
    ms += more_ms;
    psnr += more_psnr;
    ++count;
  }
  void Print(const std::string& name) const {
    std::printf("%-28s %10.0f %8.2f %8.2f\n", name.c_str(), bytes / count, ms / count,
                psnr / count);
  }
};

double LeastMs(int rounds, const std::function<void()>& work) {
  double least = 1e9;
  for (int round = 0; round < rounds; ++round) {
    const std::clock_t before = std::clock();
    work();
    least = std::min(least, 1e3 * static_cast<double>(std::clock() - before) / CLOCKS_PER_SEC);
  }
  return least;
}

frames::FoveatedPicture Render(store::Dataset& dataset, const frames::FrameSpec& spec,
                               int64_t step) {
  const store::DatasetInfo info = dataset.info();
  const auto source = dataset.OpenStep(step, *spec.field, store::OnDamage::kFail).value();
  const SuperVoxels volume =
      Reconstruct(*source, RetainedSet::Make(info.hierarchy, frames::FoveaOf(spec)).value(), 1)
          .value();
  frames::FoveatedPicture picture;
  picture.frame =
      render::RenderFrame(volume, info.index_to_world, frames::RenderSettingsOf(spec, 1)).value();
  picture.smoothing = *spec.smoothing;
  picture.background = *spec.background;
  return picture;
}

constexpr int kFewestBits = 5;

struct Sums {
  Sum png, jpeg90, jpeg100, snap, decode, expand;
  Sum foveated[render::kMostLeafBits + 1];
  Sum jpeg[render::kMostLeafBits + 1];  // as close
  double least_share = 1, most_share = 0, most_time_share = 0;
};

class View {
 public:
  View(const frames::FoveatedPicture& picture, int rounds)
      : picture_(picture),
        rounds_(rounds),
        exact_(frames::ExpandImage(picture, 1)),
        truth_(TrueBytes(exact_)) {}

  void Measure(Sums* sums) const {
    frames::FoveatedPicture snapped = picture_;
    const double snap_ms = LeastMs(rounds_, [&] {
      snapped = picture_;
      frames::SnapLeaves(&snapped, 1);
    });
    const double copy_ms = LeastMs(rounds_, [&] { snapped = picture_; });
    frames::SnapLeaves(&snapped, 1);
    render::Image image;
    const double expand_ms = LeastMs(rounds_, [&] { image = frames::ExpandImage(snapped, 1); });
    std::string png;
    const double png_ms = LeastMs(rounds_, [&] { png = Encode(image, frames::Encoding::kPng, 0); });
    const double psnr = PsnrOfRgba(truth_, render::ToSrgb8(image, picture_.background));
    const auto png_bytes = static_cast<double>(png.size());
    sums->png.Add(png_bytes, png_ms, psnr);
    sums->snap.Add(0, snap_ms - copy_ms, psnr);
    sums->expand.Add(0, expand_ms, psnr);
    AddJpeg(image, 90, &sums->jpeg90);
    AddJpeg(image, 100, &sums->jpeg100);
    for (int bits = kFewestBits; bits <= render::kMostLeafBits; ++bits) {
      std::string bytes;
      const double ms =
          LeastMs(rounds_, [&] { bytes = frames::EncodeFoveated(picture_, bits).value(); });
      const render::Image got = frames::ExpandImage(frames::DecodeFoveated(bytes).value(), 1);
      const double closeness = PsnrOfRgba(truth_, render::ToSrgb8(got, picture_.background));
      sums->foveated[bits].Add(static_cast<double>(bytes.size()), ms, closeness);
      AddJpegAsClose(closeness, &sums->jpeg[bits]);
      if (bits == render::kLeafBits) {
        sums->decode.Add(0, LeastMs(rounds_, [&] { (void)frames::DecodeFoveated(bytes).ok(); }),
                         closeness);
        const double share = static_cast<double>(bytes.size()) / png_bytes;
        sums->least_share = std::min(sums->least_share, share);
        sums->most_share = std::max(sums->most_share, share);
        sums->most_time_share = std::max(sums->most_time_share, ms / png_ms);
      }
    }
  }

 private:
  [[nodiscard]] std::string Encode(const render::Image& image, frames::Encoding encoding,
                                   int quality) const {
    return frames::Encode(image, encoding, picture_.background, quality).value();
  }
  [[nodiscard]] double PsnrOfJpeg(const std::string& jpeg) const;

  void AddJpeg(const render::Image& image, int quality, Sum* sum) const {
    std::string jpeg;
    const double ms =
        LeastMs(rounds_, [&] { jpeg = Encode(image, frames::Encoding::kJpeg, quality); });
    sum->Add(static_cast<double>(jpeg.size()), ms, PsnrOfJpeg(jpeg));
  }
  void AddJpegAsClose(double psnr, Sum* sum) const {
    int low = 0;
    int high = 101;  // 101: none is
    while (high - low > 1) {
      const int middle = (low + high) / 2;
      (PsnrOfJpeg(Encode(exact_, frames::Encoding::kJpeg, middle)) >= psnr ? high : low) = middle;
    }
    if (high <= 100) {
      AddJpeg(exact_, high, sum);
    }
  }

  const frames::FoveatedPicture& picture_;
  int rounds_;
  render::Image exact_;
  std::vector<float> truth_;
};

double View::PsnrOfJpeg(const std::string& jpeg) const {
  const testing::Decoded decoded = testing::DecodeJpeg(jpeg);
  return Psnr(truth_, [&](size_t i) { return decoded.rgb[i]; });
}

void Run(const Options& options) {
  const auto dataset = store::Dataset::Open(options.store).value();
  const frames::FrameSpec defaults = frames::DefaultSpec(*dataset).value();
  Sums sums;
  for (int view = 0; view < options.views; ++view) {
    frames::FrameSpec spec;
    spec.rate = options.rate;
    spec.width_px = spec.height_px = options.pixels;
    spec.view.azimuth_deg = 360.0 * view / options.views;
    spec.view.elevation_deg = options.elevation_deg;
    const frames::FrameSpec resolved = frames::ResolveSpec(*dataset, spec, defaults).value();
    const frames::FoveatedPicture picture = Render(*dataset, resolved, options.step);
    View(picture, options.rounds).Measure(&sums);
  }
  std::printf("%s, step %lld, rate %g, %d x %d, means of %d views\n", options.store.c_str(),
              static_cast<long long>(options.step), options.rate, options.pixels, options.pixels,
              options.views);
  std::printf("%-28s %10s %8s %8s\n", "", "bytes", "ms", "PSNR");
  sums.png.Print("PNG");
  sums.jpeg90.Print("JPEG 90");
  sums.jpeg100.Print("JPEG 100");
  for (int bits = kFewestBits; bits <= render::kMostLeafBits; ++bits) {
    sums.foveated[bits].Print("FOVEATED, " + std::to_string(bits) + " bits");
    if (const Sum& jpeg = sums.jpeg[bits]; jpeg.count == options.views) {
      jpeg.Print("  JPEG as close");
    } else {
      std::printf("  JPEG as close: %d of %d views\n", jpeg.count, options.views);
    }
  }
  std::printf("rounding of leaf values, for PNG and JPEG too: %.2f ms\n",
              sums.snap.ms / sums.snap.count);
  std::printf("left to the client: decoding %.2f ms, smoothing and warp %.2f ms\n",
              sums.decode.ms / sums.decode.count, sums.expand.ms / sums.expand.count);
  std::printf("FOVEATED of PNG: %.3f to %.3f of the bytes, at most %.3f of the time\n",
              sums.least_share, sums.most_share, sums.most_time_share);
}

}  // namespace
}  // namespace fovea

int main(int argc, char** argv) {
  fovea::Options options;
  for (int i = 1; i < argc; ++i) {
    const std::string flag = argv[i];
    if (!flag.starts_with("--")) {
      options.store = flag;
      continue;
    }
    const double number = ++i < argc ? std::atof(argv[i]) : 0;
    if (flag == "--step") {
      options.step = static_cast<int64_t>(number);
    } else if (flag == "--rate") {
      options.rate = number;
    } else if (flag == "--pixels") {
      options.pixels = static_cast<int>(number);
    } else if (flag == "--views") {
      options.views = static_cast<int>(number);
    } else if (flag == "--rounds") {
      options.rounds = static_cast<int>(number);
    } else if (flag == "--elevation") {
      options.elevation_deg = number;
    } else {
      std::fprintf(stderr, "frame_bytes_bench: unknown flag '%s'\n", flag.c_str());
      return 2;
    }
  }
  if (options.store.empty() || options.views < 1 || options.rounds < 1) {
    std::fprintf(stderr, "frame_bytes_bench: name a store; views and rounds are at least 1\n");
    return 2;
  }
  fovea::Run(options);
  return 0;
}
