#include "service/coefficients/block.h"

#include <cmath>
#include <cstring>
#include <limits>
#include <random>

#include <gmock/gmock.h>

#include "service/frames/deflate.h"
#include "tests/support/status_matchers.h"

namespace fovea::coefficients {
namespace {

using ::fovea::testing::FailsWith;

Hierarchy Volume() {
  return Hierarchy::Make({70, 61, 53}).value();  // L = 3; coarse 9 x 8 x 7
}

/// Boxes of every kind, 1 + 7 * 24 + 7 * 2 values and so not a multiple of 8.
BlockHeader Header(const std::string& type, bool differences) {
  BlockHeader header;
  header.type = type;
  header.field = 1;
  header.step = 9;
  header.base_step = differences ? 8 : 9;
  const float scale = type == "float32" ? 1 : 0.25F;
  header.boxes = {{kCoarse, {{3, 2, 1}, {4, 3, 2}}, differences, scale},
                  {2, {{30, 20, 10}, {34, 23, 12}}, false, scale},
                  {0, {{0, 0, 0}, {1, 2, 1}}, differences, scale}};
  return header;
}

std::vector<std::byte> RandomNumbers(const BlockHeader& header, unsigned seed) {
  std::mt19937 random(seed);
  const auto count = static_cast<size_t>(header.Values());
  std::vector<float> values(count);
  for (float& value : values) {
    value = random() % 3 == 0 ? 0 : std::floor(static_cast<float>(random() % 4001) - 2000);
    value = header.type == "float32" ? value / 7 : value;
  }
  if (header.type == "float32") {
    values[1] = -0.0F;  // not 0: a bit is set
    values[2] = std::numeric_limits<float>::denorm_min();
  }
  std::vector<std::byte> numbers(count * static_cast<size_t>(store::BytesOfType(header.type)));
  EXPECT_OK(store::ToStored(values, {header.type, 1}, numbers));
  return numbers;
}

class BlockTest : public ::testing::TestWithParam<std::tuple<const char*, bool>> {};

TEST_P(BlockTest, ComesBackAsItWas) {
  const auto& [type, differences] = GetParam();
  const BlockHeader header = Header(type, differences);
  const auto numbers = RandomNumbers(header, 1);
  const auto base = RandomNumbers(header, 2);
  ASSERT_OK_AND_ASSIGN(const std::string bytes, EncodeBlock(header, Volume(), numbers, base));
  ASSERT_OK_AND_ASSIGN(const ReceivedBlock block, ParseBlock(bytes, Volume()));
  EXPECT_EQ(block.header, header);
  ASSERT_OK_AND_ASSIGN(const auto back, DecodeNumbers(block, base));
  EXPECT_TRUE(back == numbers);
  if (differences) {
    EXPECT_THAT(DecodeNumbers(block, RandomNumbers(header, 3)),
                FailsWith(absl::StatusCode::kFailedPrecondition, "step 8"));
    EXPECT_THAT(DecodeNumbers(block, {}), FailsWith(absl::StatusCode::kInternal, "base"));
  }
}

INSTANTIATE_TEST_SUITE_P(Types, BlockTest,
                         ::testing::Combine(::testing::Values("float32", "int16", "int32"),
                                            ::testing::Bool()));

/// The page's own description, followed by hand: what other languages will write and read.
TEST(BlockBytesTest, AreThoseOfThePage) {
  BlockHeader header;
  header.type = "int16";
  header.field = 1;
  header.step = 0x0102030405060708;
  header.base_step = 7;
  header.boxes = {{kCoarse, {{1, 2, 3}, {3, 3, 4}}, false, 0.5F},
                  {1, {{5, 6, 7}, {6, 7, 8}}, true, 0.5F}};
  const int16_t numbers[9] = {-1, 300, 10, 0, 5, -32767, 7, 1, 0};
  const int16_t base[9] = {0, 0, 10, 0, 7, 32767, 8, 1, 256};
  ASSERT_OK_AND_ASSIGN(const std::string bytes,
                       EncodeBlock(header, Volume(), std::as_bytes(std::span(numbers)),
                                   std::as_bytes(std::span(base))));
  std::string expected("FVCB\x01\x01\x01\x00", 8);
  const auto append = [&](auto value) {
    expected.append(reinterpret_cast<const char*>(&value), sizeof(value));
  };
  append(uint64_t{0x0102030405060708});
  append(uint64_t{7});
  append(uint32_t{2});
  append(frames::Crc32({reinterpret_cast<const char*>(numbers), sizeof(numbers)}));
  append(uint32_t{0x00000000});  // coarse, no difference
  append(0.5F);
  for (const uint32_t n : {1, 2, 3, 2, 1, 1}) {
    append(n);
  }
  append(uint32_t{0x00000102});  // level 1 of 3 refines 4 voxels; a difference
  append(0.5F);
  for (const uint32_t n : {5, 6, 7, 1, 1, 1}) {
    append(n);
  }
  ASSERT_GT(bytes.size(), expected.size() + 4);
  EXPECT_EQ(bytes.substr(0, expected.size()), expected);
  // zigzag: -1 -> 1, 300 -> 600; then 10 - 10 = 0, 0, -2 -> 3, -65534 = 2 modulo 2^16 -> 4,
  // -1 -> 1, 0, -256 -> 511.
  const std::string stream = bytes.substr(expected.size(), bytes.size() - expected.size() - 4);
  ASSERT_OK_AND_ASSIGN(frames::Inflater inflater, frames::Inflater::Make(stream));
  std::vector<uint8_t> sent(2 + 2 * 6);
  ASSERT_OK(inflater.Read(sent));
  EXPECT_OK(inflater.Finish());
  EXPECT_THAT(sent, ::testing::ElementsAre(0b01110011, 0b1, 1, 600 & 255, 3, 4, 1, 255,  //
                                           0, 600 >> 8, 0, 0, 0, 1));
  uint32_t crc = 0;
  std::memcpy(&crc, bytes.data() + bytes.size() - 4, 4);
  EXPECT_EQ(crc, frames::Crc32(bytes.substr(0, bytes.size() - 4)));
}

TEST(BlockBytesTest, NoiseStaysWithinTheLargestMessage) {
  for (const char* type : {"float32", "int16", "int32"}) {
    BlockHeader header;
    header.type = type;
    const int64_t each = store::BytesOfType(type);
    // As many boxes and numbers as there may be.
    int64_t left = kMaxNumberBytes / each / 7 - static_cast<int64_t>(kMaxBoxes - 1);
    const Hierarchy hierarchy = Hierarchy::Make({2048, 2048, 64}).value();
    header.boxes.push_back({6, {{0, 0, 0}, {left / 20, 20, 1}}, false, 1});
    for (size_t i = 1; i < kMaxBoxes; ++i) {
      header.boxes.push_back(
          {6, {{static_cast<int64_t>(i), 30, 1}, {static_cast<int64_t>(i) + 1, 31, 2}}, false, 1});
    }
    std::mt19937 random(5);
    std::vector<std::byte> numbers(static_cast<size_t>(header.Values() * each));
    if (each == 2) {
      for (std::byte& one : numbers) {
        one = static_cast<std::byte>(random());
      }
    } else {
      for (size_t i = 0; i < numbers.size(); i += 4) {
        const uint32_t bits = random() % 0x7f000000 + 1;
        std::memcpy(numbers.data() + i, &bits, 4);
      }
    }
    ASSERT_OK_AND_ASSIGN(const std::string bytes, EncodeBlock(header, hierarchy, numbers, {}));
    EXPECT_LE(bytes.size(), kMaxBlockBytes) << type;
  }
}

/// A block whose bytes were changed by `change`, with a checksum that holds again.
template <typename Change>
Status Changed(const Change& change, const char* type = "float32") {
  const BlockHeader header = Header(type, false);
  std::string bytes = EncodeBlock(header, Volume(), RandomNumbers(header, 1), {}).value();
  change(bytes);
  const uint32_t crc = frames::Crc32(std::string_view(bytes).substr(0, bytes.size() - 4));
  std::memcpy(bytes.data() + bytes.size() - 4, &crc, 4);
  const auto block = ParseBlock(bytes, Volume());
  return block.ok() ? DecodeNumbers(*block, {}).status() : block.status();
}

TEST(BlockBytesTest, WhatIsNoBlockIsRefused) {
  constexpr auto kLoss = absl::StatusCode::kDataLoss;
  const auto set = [](size_t at, int value) {
    return [=](std::string& bytes) { bytes[at] = static_cast<char>(value); };
  };
  EXPECT_OK(Changed([](std::string&) {}));
  EXPECT_THAT(Changed(set(0, 'X')), FailsWith(kLoss, "no block"));
  EXPECT_THAT(Changed(set(4, 2)), FailsWith(kLoss, "version 2"));
  EXPECT_THAT(Changed(set(5, 3)), FailsWith(kLoss, "type 3"));
  EXPECT_THAT(Changed(set(6, 2)), FailsWith(kLoss, "field 2"));
  EXPECT_THAT(Changed(set(7, 1)), FailsWith(kLoss, ""));
  EXPECT_THAT(Changed(set(16, 8)), FailsWith(kLoss, "base step"));
  EXPECT_THAT(Changed(set(24, 0)), FailsWith(kLoss, "0 boxes"));
  EXPECT_THAT(Changed(set(25, 3)), FailsWith(kLoss, "boxes"));
  EXPECT_THAT(Changed(set(28, 1)), FailsWith(kLoss, "checksum of its numbers"));
  EXPECT_THAT(Changed(set(32, 4)), FailsWith(kLoss, "not there"));
  EXPECT_THAT(Changed(set(33, 2)), FailsWith(kLoss, "flags 2"));
  EXPECT_THAT(Changed(set(33, 1)), FailsWith(kLoss, "base step"));
  EXPECT_THAT(Changed(set(34, 1)), FailsWith(kLoss, ""));
  EXPECT_THAT(Changed(set(38, 0)), FailsWith(kLoss, "scale"));
  EXPECT_THAT(Changed(set(39, 0x7f), "int16"),
              FailsWith(kLoss, ""));  // another box's place is fine
  EXPECT_THAT(Changed(set(40, 9)), FailsWith(kLoss, "within its level"));
  EXPECT_THAT(Changed(set(52, 0)), FailsWith(kLoss, "empty"));
  EXPECT_THAT(Changed(set(55, 0x7f)), FailsWith(kLoss, "within its level"));
  EXPECT_THAT(Changed([](std::string& b) { b.insert(b.size() - 4, "x"); }),
              FailsWith(kLoss, "zlib"));
  EXPECT_THAT(Changed([](std::string& b) { b.erase(b.size() - 8, 4); }), FailsWith(kLoss, "zlib"));
  EXPECT_THAT(Changed([](std::string& b) { b.resize(35); }), FailsWith(kLoss, "no block"));
  EXPECT_THAT(Changed([](std::string& b) { b.resize(kMaxBlockBytes + 1); }),
              FailsWith(kLoss, "no block"));
  const BlockHeader header = Header("float32", false);
  std::string bytes = EncodeBlock(header, Volume(), RandomNumbers(header, 1), {}).value();
  bytes.back() = static_cast<char>(bytes.back() ^ 1);
  EXPECT_THAT(ParseBlock(bytes, Volume()), FailsWith(kLoss, "checksum"));
}

TEST(BlockBytesTest, WhatOverlapsOrCannotBeCoefficientsIsRefused) {
  BlockHeader header = Header("float32", false);
  auto numbers = RandomNumbers(header, 1);
  const float bad = std::numeric_limits<float>::infinity();
  std::memcpy(numbers.data() + 8, &bad, 4);
  ASSERT_OK_AND_ASSIGN(const std::string bytes, EncodeBlock(header, Volume(), numbers, {}));
  ASSERT_OK_AND_ASSIGN(const ReceivedBlock block, ParseBlock(bytes, Volume()));
  EXPECT_THAT(DecodeNumbers(block, {}), FailsWith(absl::StatusCode::kDataLoss, "finite"));
  header.boxes.push_back({2, {{33, 22, 11}, {35, 24, 13}}, false, 1});
  EXPECT_THAT(EncodeBlock(header, Volume(), RandomNumbers(header, 1), {}),
              FailsWith(absl::StatusCode::kInternal, "overlap"));
}

}  // namespace
}  // namespace fovea::coefficients
