#include "engine/store/blosc.h"

#include <algorithm>
#include <cstring>
#include <random>
#include <string>

#include <blosc.h>
#include <gtest/gtest.h>

#include "engine/store/shuffle.h"
#include "engine/store/stored_type.h"
#include "tests/support/status_matchers.h"

namespace fovea::store {
namespace {

using ::fovea::testing::FailsWith;
using Bytes = std::vector<std::byte>;

/// Little-endian values of `type_bytes`: small ones of either sign, like coefficients; `spread`
/// says how small.
Bytes Coefficients(size_t count, int type_bytes, double spread) {
  std::mt19937 random(7);
  std::normal_distribution<double> normal(0, spread);
  Bytes bytes;
  for (size_t i = 0; i < count; ++i) {
    const auto value = static_cast<int64_t>(normal(random));
    const auto* first = reinterpret_cast<const std::byte*>(&value);
    bytes.insert(bytes.end(), first, first + type_bytes);
  }
  return bytes;
}

Bytes Noise(size_t count) {
  std::mt19937 random(8);
  Bytes bytes(count);
  std::generate(bytes.begin(), bytes.end(), [&] { return static_cast<std::byte>(random()); });
  return bytes;
}

TEST(Shuffle, PutsLikeBytesAndBitsSideBySide) {
  for (const int width : {1, 2, 4}) {
    for (const size_t count : {8UL, 16UL, 24UL, 72UL, 1000UL, 4096UL}) {
      const auto w = static_cast<size_t>(width);
      const Bytes values = Noise(count * w);
      Bytes planes(values.size()), scratch(values.size()), back(values.size());
      ShuffleBytes(values.data(), count, width, planes.data());
      for (size_t i = 0; i < values.size(); ++i) {
        ASSERT_EQ(planes[i % w * count + i / w], values[i]) << width << " " << count << " " << i;
      }
      UnshuffleBytes(planes.data(), count, width, back.data());
      EXPECT_EQ(back, values);
      planes.assign(planes.size(), std::byte{0});
      for (size_t bit = 0; bit < 8 * w; ++bit) {
        for (size_t i = 0; i < count; ++i) {
          const auto one = values[i * w + bit / 8] >> (bit % 8) & std::byte{1};
          planes[bit * (count / 8) + i / 8] |= one << (i % 8);
        }
      }
      back.assign(back.size(), std::byte{0});
      UnshuffleBits(planes.data(), count, width, scratch.data(), back.data());
      EXPECT_EQ(back, values);
    }
  }
}

/// Noise in which runs of values are 0, so many of 16.
Bytes WithGaps(size_t count, int type_bytes, size_t zeros) {
  const auto width = static_cast<size_t>(type_bytes);
  Bytes bytes = Noise(count * width);
  for (size_t i = 0; i < count; ++i) {
    if (i % 16 < zeros) {
      std::fill_n(bytes.begin() + static_cast<int64_t>(i * width), width, std::byte{0});
    }
  }
  return bytes;
}

struct Case {
  Bytes values;
  int width;
};

std::vector<Case> Cases() {
  std::vector<Case> cases;
  for (const int width : {1, 2, 4}) {
    const auto w = static_cast<size_t>(width);
    for (const size_t count : {1UL, 8UL, 343UL, 3584UL, 28672UL}) {  // 343: no multiple of 8
      cases.push_back({Coefficients(count, width, 3), width});
      cases.push_back({Noise(count * w), width});
      cases.push_back({Bytes(count * w), width});
      cases.push_back({WithGaps(count, width, 5), width});
      cases.push_back({WithGaps(count, width, 13), width});
    }
  }
  return cases;
}

TEST(Blosc, GivesBackWhatItWasGiven) {
  BloscEncoder encoder;
  BloscDecoder decoder;
  for (const auto& [values, width] : Cases()) {
    ASSERT_OK_AND_ASSIGN(const auto chunk, encoder.Encode(values, width, ValueKind::kFloat));
    EXPECT_LE(chunk.size(), values.size() + kBloscHeaderBytes);
    Bytes back(values.size());
    ASSERT_OK(decoder.Decode(chunk, width, back));
    EXPECT_EQ(back, values) << width;
  }
}

TEST(Blosc, FloatsWithGapsLieAsTheyAreAndTakeNoMoreThanTheirPlanes) {
  constexpr size_t kFlags = 2;  // where in a chunk they are
  constexpr std::byte kShuffled{BLOSC_DOSHUFFLE};
  BloscEncoder encoder;
  for (const size_t zeros : {2UL, 8UL, 13UL, 15UL}) {
    const Bytes values = WithGaps(28672, 4, zeros);
    ASSERT_OK_AND_ASSIGN(const auto chunk, encoder.Encode(values, 4, ValueKind::kFloat));
    EXPECT_EQ((chunk[kFlags] & kShuffled) == std::byte{0}, zeros >= 8) << zeros;
    if (zeros >= 8) {
      EXPECT_LT(chunk.size(), values.size() * (16 - zeros) / 16 + 4000) << zeros;
    }
  }
  // As many zeros, but no gaps that are worth a match: planes get smaller than that.
  Bytes scattered = Noise(4 * 28672);
  std::mt19937 random(9);
  for (size_t i = 0; i < scattered.size(); i += 4) {
    if (random() % 100 < 35) {
      std::fill_n(scattered.begin() + static_cast<int64_t>(i), 4, std::byte{0});
    }
  }
  ASSERT_OK_AND_ASSIGN(const auto chunk, encoder.Encode(scattered, 4, ValueKind::kFloat));
  EXPECT_NE(chunk[kFlags] & kShuffled, std::byte{0});
}

/// What a CT scan gives: much of it is 0, and the low bytes of the rest are.
TEST(Blosc, FloatsOfSmallWholeNumbersAreSmallerAsPlanes) {
  std::mt19937 random(10);
  std::vector<float> values(28672);
  for (size_t i = 0; i < values.size(); ++i) {
    values[i] = i % 16 < 9 ? 0.0F : static_cast<float>(random() % 512) / 8 - 32;
  }
  BloscEncoder encoder;
  const auto bytes = std::as_bytes(std::span(values));
  ASSERT_OK_AND_ASSIGN(const auto chunk, encoder.Encode(bytes, 4, ValueKind::kFloat));
  EXPECT_NE(chunk[2] & std::byte{BLOSC_DOSHUFFLE}, std::byte{0});
}

/// The library that all others take for Blosc.
TEST(Blosc, IsWhatTheBloscLibraryReads) {
  BloscEncoder encoder;
  for (const auto& [values, width] : Cases()) {
    ASSERT_OK_AND_ASSIGN(const auto chunk, encoder.Encode(values, width, ValueKind::kFloat));
    size_t said = 0;
    ASSERT_EQ(blosc_cbuffer_validate(chunk.data(), chunk.size(), &said), 0);
    ASSERT_EQ(said, values.size());
    Bytes back(values.size());
    ASSERT_EQ(blosc_decompress_ctx(chunk.data(), back.data(), back.size(), 1),
              static_cast<int>(back.size()));
    EXPECT_EQ(back, values) << width;
  }
}

/// What the library makes of them, in one block.
Bytes FromLibrary(const Bytes& values, int width, int shuffle) {
  Bytes chunk(values.size() + BLOSC_MAX_OVERHEAD);
  const int size =
      blosc_compress_ctx(5, shuffle, static_cast<size_t>(width), values.size(), values.data(),
                         chunk.data(), chunk.size(), "zstd", values.size(), 1);
  chunk.resize(static_cast<size_t>(std::max(size, 0)));
  return chunk;
}

TEST(Blosc, ReadsWhatTheBloscLibraryWritesInOneBlock) {
  BloscDecoder decoder;
  for (const int shuffle : {BLOSC_SHUFFLE, BLOSC_BITSHUFFLE}) {
    for (const auto& [values, width] : Cases()) {
      if (values.size() / static_cast<size_t>(width) % 8 != 0 && shuffle == BLOSC_BITSHUFFLE) {
        continue;  // it shuffles as many as come in eights
      }
      const Bytes chunk = FromLibrary(values, width, shuffle);
      ASSERT_FALSE(chunk.empty());
      Bytes back(values.size());
      ASSERT_OK(decoder.Decode(chunk, width, back));
      EXPECT_EQ(back, values) << width;
    }
  }
}

TEST(Blosc, MakesCoefficientsSmall) {
  Bytes values = Coefficients(28672, 2, 3);  // 3.6 bits each (entropy of the distribution)
  FoldSigns(values, "int16", values);
  BloscEncoder encoder;
  ASSERT_OK_AND_ASSIGN(const auto chunk, encoder.Encode(values, 2, ValueKind::kWhole));
  EXPECT_LT(static_cast<double>(chunk.size()), 28672 * 3.6 / 8 * 1.05);
}

/// What an attacker can do who computes checksums: no byte of a chunk may make the decoder read or
/// write where it must not. AddressSanitizer watches.
TEST(Blosc, SurvivesEveryChangedByteAndEveryLength) {
  BloscEncoder encoder;
  BloscDecoder decoder;
  const Bytes values = Coefficients(512, 2, 30);
  ASSERT_OK_AND_ASSIGN(const auto encoded, encoder.Encode(values, 2, ValueKind::kWhole));
  for (Bytes chunk :
       {Bytes(encoded.begin(), encoded.end()), FromLibrary(values, 2, BLOSC_BITSHUFFLE)}) {
    Bytes back(values.size());
    for (std::byte& byte : chunk) {
      const std::byte good = byte;
      for (const unsigned other : {0x00U, 0x01U, 0x7FU, 0x80U, 0xFFU}) {
        byte = static_cast<std::byte>(other);
        const Status status = decoder.Decode(chunk, 2, back);
        EXPECT_TRUE(status.ok() || absl::IsDataLoss(status)) << status;
      }
      byte = good;
    }
    for (size_t size = 0; size < chunk.size(); ++size) {
      EXPECT_THAT(decoder.Decode(std::span(chunk).first(size), 2, back),
                  FailsWith(absl::StatusCode::kDataLoss, "Blosc"));
    }
    EXPECT_OK(decoder.Decode(chunk, 2, back));
  }
}

TEST(Blosc, RefusesNoValues) {
  const auto chunk = BloscEncoder().Encode({}, 4, ValueKind::kFloat);
  EXPECT_THAT(chunk, FailsWith(absl::StatusCode::kInternal, "0 bytes"));
  const std::vector<std::byte> header(kBloscHeaderBytes);
  EXPECT_THAT(BloscDecoder().Decode(header, 4, {}),
              FailsWith(absl::StatusCode::kDataLoss, "no values"));
}

TEST(Blosc, RefusesAChunkOfOtherValues) {
  BloscEncoder encoder;
  const Bytes values = Coefficients(512, 2, 30);
  ASSERT_OK_AND_ASSIGN(const auto chunk, encoder.Encode(values, 2, ValueKind::kWhole));
  Bytes larger(2 * values.size());
  EXPECT_THAT(BloscDecoder().Decode(chunk, 2, larger),
              FailsWith(absl::StatusCode::kDataLoss, "2048 bytes"));
  EXPECT_THAT(BloscDecoder().Decode(chunk, 4, larger),
              FailsWith(absl::StatusCode::kDataLoss, "values of 4 bytes"));
}

}  // namespace
}  // namespace fovea::store
