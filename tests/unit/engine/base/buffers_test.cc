#include "engine/base/buffers.h"

#include <cstdint>
#include <cstring>
#include <vector>

#include <gtest/gtest.h>

namespace fovea {
namespace {

TEST(BuffersTest, WhatIsGivenBackServesTheNextOfItsSize) {
  auto first = TakeBuffer<float>(1000);
  float* const values = first.get();
  EXPECT_EQ(reinterpret_cast<uintptr_t>(values) % 64, 0U);
  std::memset(values, 1, 4000);
  const auto copy = first;
  first.reset();
  EXPECT_NE(TakeBuffer<float>(1000).get(), values) << "a copy still holds it";
}

TEST(BuffersTest, FreedMemoryIsUsedAgain) {
  const std::byte* const memory = TakeBytes(5000).get();
  EXPECT_EQ(TakeBytes(6000).get(), memory);
  EXPECT_NE(TakeBytes(9000).get(), memory);
  EXPECT_NE(TakeBytes(0), nullptr);
}

TEST(BuffersTest, MoreThanTheMostIsNotKept) {
  constexpr size_t kEach = kMostKept / 4;
  std::vector<std::shared_ptr<std::byte>> many;
  for (int i = 0; i < 8; ++i) {
    many.push_back(TakeBytes(kEach));
    std::memset(many.back().get(), 1, kEach);  // must be there for all of them
  }
  many.clear();
  for (int i = 0; i < 8; ++i) {
    many.push_back(TakeBytes(kEach));
    std::memset(many.back().get(), 2, kEach);
  }
}

}  // namespace
}  // namespace fovea
