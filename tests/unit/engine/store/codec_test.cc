#include "engine/store/codec.h"

#include <cmath>
#include <cstring>
#include <random>
#include <string_view>

#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"

namespace fovea::store {
namespace {

using ::fovea::testing::FailsWith;

std::span<const std::byte> BytesOf(std::string_view text) {
  return std::as_bytes(std::span(text));
}

std::vector<std::byte> SomeBytes(size_t count) {
  std::mt19937 random(7);
  std::vector<std::byte> bytes(count);
  for (std::byte& byte : bytes) {
    byte = static_cast<std::byte>(random() % 5);
  }
  return bytes;
}

TEST(Crc32c, IsTheOneOfRfc3720) {
  EXPECT_EQ(Crc32c(BytesOf("")), 0U);
  EXPECT_EQ(Crc32c(BytesOf("123456789")), 0xE3069283U);
  EXPECT_EQ(Crc32c(std::vector<std::byte>(32)), 0x8A9136AAU);
  EXPECT_EQ(Crc32c(std::vector<std::byte>(32, std::byte{0xFF})), 0x62A8AB43U);
}

TEST(Codec, GivesBackWhatItWasGiven) {
  for (const size_t size : {size_t{1}, size_t{28}, size_t{14336}, size_t{1000001}}) {
    const std::vector<std::byte> raw = SomeBytes(size);
    ASSERT_OK_AND_ASSIGN(const auto encoded, Encoder().Encode(raw));
    EXPECT_LE(static_cast<int64_t>(encoded.size()), MaxEncodedBytes(static_cast<int64_t>(size)));
    std::vector<std::byte> decoded(size);
    ASSERT_OK(Decoder().Decode(encoded, decoded));
    EXPECT_EQ(decoded, raw);
  }
}

TEST(Codec, FindsEveryFlippedBit) {
  const std::vector<std::byte> raw = SomeBytes(300);
  ASSERT_OK_AND_ASSIGN(std::vector<std::byte> encoded, Encoder().Encode(raw));
  std::vector<std::byte> decoded(raw.size());
  Decoder decoder;
  for (std::byte& byte : encoded) {
    for (int bit = 0; bit < 8; ++bit) {
      byte ^= static_cast<std::byte>(1 << bit);
      EXPECT_THAT(decoder.Decode(encoded, decoded),
                  FailsWith(absl::StatusCode::kDataLoss, "checksum"));
      byte ^= static_cast<std::byte>(1 << bit);
    }
  }
  EXPECT_OK(decoder.Decode(encoded, decoded));
}

/// What an attacker can do who computes checksums too.
TEST(Codec, RefusesAFrameOfAnotherSize) {
  const std::vector<std::byte> raw = SomeBytes(3000);
  ASSERT_OK_AND_ASSIGN(const auto encoded, Encoder().Encode(raw));
  std::vector<std::byte> smaller(2999);
  EXPECT_THAT(Decoder().Decode(encoded, smaller), FailsWith(absl::StatusCode::kDataLoss, "2999"));
  std::vector<std::byte> larger(3001);
  EXPECT_THAT(Decoder().Decode(encoded, larger), FailsWith(absl::StatusCode::kDataLoss, "3001"));
  for (const size_t kept : {size_t{0}, size_t{3}, size_t{5}, encoded.size() / 2}) {
    std::vector<std::byte> cut(encoded.begin(), encoded.begin() + static_cast<int64_t>(kept));
    AppendCrc32c(cut);
    std::vector<std::byte> decoded(raw.size());
    EXPECT_THAT(Decoder().Decode(cut, decoded), FailsWith(absl::StatusCode::kDataLoss, ""));
  }
}

TEST(Codec, CarriesTheChecksumOfZstdToo) {
  const std::vector<std::byte> raw = SomeBytes(3000);
  ASSERT_OK_AND_ASSIGN(std::vector<std::byte> encoded, Encoder().Encode(raw));
  encoded.resize(encoded.size() - 4);  // our own checksum
  encoded.back() ^= std::byte{1};      // the last byte of zstd's
  AppendCrc32c(encoded);
  std::vector<std::byte> decoded(raw.size());
  EXPECT_THAT(Decoder().Decode(encoded, decoded),
              FailsWith(absl::StatusCode::kDataLoss, "checksum"));
}

TEST(Codec, GivesBackCoefficientsAndFindsFlippedBits) {
  std::vector<float> values(343);
  for (size_t i = 0; i < values.size(); ++i) {
    values[i] = static_cast<float>(static_cast<int>(i * i % 101) - 50);
  }
  for (const Coding& coding : {Coding{"float32", 1}, Coding{"int16", 1}, Coding{"int32", 0.5F},
                               Coding{"int16", 1, true}, Coding{"int32", 0.5F, true}}) {
    ASSERT_OK_AND_ASSIGN(auto encoded, Encoder().EncodeValues(values, coding));
    EXPECT_LE(std::ssize(encoded), MaxEncodedBytes(std::ssize(values) * BytesOfType(coding.type)));
    std::vector<float> back(values.size());
    ASSERT_OK(Decoder().DecodeValues(encoded, coding, back));
    EXPECT_EQ(back, values);
    for (std::byte& byte : encoded) {
      byte ^= std::byte{4};
      EXPECT_THAT(Decoder().DecodeValues(encoded, coding, back),
                  FailsWith(absl::StatusCode::kDataLoss, "checksum"));
      byte ^= std::byte{4};
    }
  }
}

/// What folding is for: the high bytes of small numbers are noise, and then they are zeros.
TEST(Codec, FoldedNumbersAreSmaller) {
  std::vector<float> values(4096);
  uint32_t random = 1;
  for (float& value : values) {  // most are small, one in sixteen is not
    random = random * 1664525 + 1013904223;
    const auto number = static_cast<float>(random >> 20 & 7) - 3.5F;
    value = std::trunc((random >> 16 & 15) == 0 ? 40 * number : number);
  }
  ASSERT_OK_AND_ASSIGN(auto plain, Encoder().EncodeValues(values, {"int16", 1}));
  ASSERT_OK_AND_ASSIGN(auto folded, Encoder().EncodeValues(values, {"int16", 1, true}));
  EXPECT_LT(static_cast<double>(folded.size()), 0.8 * static_cast<double>(plain.size()));
}

/// Other libraries that read the store check no CRC32C: zstd's checksum is there for them.
TEST(Codec, CarriesTheChecksumOfZstdInBloscToo) {
  const std::vector<float> values(4096, 2.0F);
  for (const Coding& coding : {Coding{"float32", 1}, Coding{"int16", 1}}) {
    ASSERT_OK_AND_ASSIGN(std::vector<std::byte> encoded, Encoder().EncodeValues(values, coding));
    encoded.resize(encoded.size() - 4);  // our own checksum
    encoded.back() ^= std::byte{1};      // the last byte of zstd's
    AppendCrc32c(encoded);
    std::vector<float> back(values.size());
    EXPECT_THAT(Decoder().DecodeValues(encoded, coding, back),
                FailsWith(absl::StatusCode::kDataLoss, "checksum"));
  }
}

}  // namespace
}  // namespace fovea::store
