#include "service/frames/leaf_planes.h"

#include <algorithm>
#include <array>

#include "engine/render/leaf_scale.h"

namespace fovea::frames {
namespace {

using render::FrameLevel;
using render::LeafNumbers;
using render::PixelKind;

constexpr size_t kChannels = 4;

/// Red and blue less green, green, transmittance.
struct Differences {
  std::array<int16_t, kChannels> d{};
  bool is_leaf = false;
};

Differences ToDifferences(const LeafNumbers& n) {
  return {{static_cast<int16_t>(n.red - n.green), static_cast<int16_t>(n.green),
           static_cast<int16_t>(n.blue - n.green), static_cast<int16_t>(n.transmittance)},
          true};
}

LeafNumbers FromDifferences(const Differences& from) {
  return {from.d[0] + from.d[1], from.d[1], from.d[2] + from.d[1], from.d[3]};
}

bool IsInRange(const LeafNumbers& n, int bits) {
  return std::min({n.red, n.green, n.blue, n.transmittance}) >= 0 &&
         std::max({n.red, n.green, n.blue}) <= render::kMostLeafNumber &&
         n.transmittance <= 1 << bits;
}

/// The median edge detector of lossless JPEG (LOCO-I).
int Median(int left, int above, int corner) {
  const int low = std::min(left, above);
  const int high = std::max(left, above);
  return corner >= high ? low : corner <= low ? high : left + above - corner;
}

/// The row being walked and the one before it; the pixel before the first is no leaf.
class Rows {
 public:
  explicit Rows(int64_t width)
      : row_(static_cast<size_t>(width) + 1), above_(static_cast<size_t>(width) + 1) {}

  void NextRow() { row_.swap(above_); }
  /// What pixel i of the row is expected to be.
  [[nodiscard]] std::array<int, kChannels> Predict(size_t i) const {
    const Differences& left = row_[i];
    const Differences& above = above_[i + 1];
    const Differences& corner = above_[i].is_leaf ? above_[i] : left;
    std::array<int, kChannels> predicted{};
    for (size_t k = 0; k < kChannels; ++k) {
      predicted[k] = !left.is_leaf    ? above.d[k]  // 0 if that is no leaf either
                     : !above.is_leaf ? left.d[k]
                                      : Median(left.d[k], above.d[k], corner.d[k]);
    }
    return predicted;
  }
  void Put(size_t i, const Differences& pixel) { row_[i + 1] = pixel; }

 private:
  std::vector<Differences> row_, above_;
};

/// Even numbers for residuals from 0 up, odd ones for those below; modulo 2^16.
uint16_t Folded(int residual) {
  const auto r = static_cast<int16_t>(residual);
  return static_cast<uint16_t>(r < 0 ? -2 * r - 1 : 2 * r);
}

int Unfolded(unsigned z) {
  return (z & 1) != 0 ? -static_cast<int>((z + 1) / 2) : static_cast<int>(z / 2);
}

/// Calls `leaf(predicted, index)` for each leaf of the level, which gives its differences. Stops
/// when one is no leaf.
template <typename Leaf>
bool ForLeaves(const FrameLevel& level, const Leaf& leaf) {
  const auto width = static_cast<size_t>(level.rect.Width());
  Rows rows(level.rect.Width());
  for (size_t begin = 0; begin < level.kinds.size(); begin += width) {
    rows.NextRow();
    for (size_t i = 0; i < width; ++i) {
      Differences pixel;
      if (level.kinds[begin + i] == PixelKind::kLeaf) {
        pixel = leaf(rows.Predict(i), begin + i);
        if (!pixel.is_leaf) {
          return false;
        }
      }
      rows.Put(i, pixel);
    }
  }
  return true;
}

}  // namespace

size_t CountLeaves(const LevelsOfFrame& levels) {
  size_t leaves = 0;
  for (const FrameLevel* level : levels) {
    leaves +=
        static_cast<size_t>(std::count(level->kinds.begin(), level->kinds.end(), PixelKind::kLeaf));
  }
  return leaves;
}

void WriteLeafPlanes(const LevelsOfFrame& levels, int bits, std::span<uint8_t> to) {
  const size_t leaves = to.size() / kLeafPlanes;
  uint8_t* high = to.data();
  uint8_t* low = high + kChannels * leaves;
  for (const FrameLevel* level : levels) {
    ForLeaves(*level, [&](const std::array<int, kChannels>& predicted, size_t at) {
      const Differences pixel = ToDifferences(render::ToNumbers(level->values[at], bits));
      for (size_t k = 0; k < kChannels; ++k) {
        const uint16_t z = Folded(pixel.d[k] - predicted[k]);
        high[k * leaves] = static_cast<uint8_t>(z >> 8);
        low[k * leaves] = static_cast<uint8_t>(z);
      }
      ++high;
      ++low;
      return pixel;
    });
  }
}

Status ReadLeafPlanes(std::span<const uint8_t> planes, int bits,
                      const std::vector<render::FrameLevel*>& levels) {
  const size_t leaves = planes.size() / kLeafPlanes;
  const uint8_t* high = planes.data();
  const uint8_t* low = high + kChannels * leaves;
  for (FrameLevel* level : levels) {
    const bool fits =
        ForLeaves(*level, [&](const std::array<int, kChannels>& predicted, size_t at) {
          Differences pixel;
          for (size_t k = 0; k < kChannels; ++k) {
            const unsigned z = (unsigned{high[k * leaves]} << 8) | low[k * leaves];
            pixel.d[k] = static_cast<int16_t>(predicted[k] + Unfolded(z));
          }
          ++high;
          ++low;
          const LeafNumbers numbers = FromDifferences(pixel);
          pixel.is_leaf = IsInRange(numbers, bits);
          level->values[at] = render::FromNumbers(numbers, bits);
          return pixel;
        });
    if (!fits) {
      return DataLoss("a FOVEATED frame has a leaf value outside its range");
    }
  }
  return absl::OkStatus();
}

}  // namespace fovea::frames
