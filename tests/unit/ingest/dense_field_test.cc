#include "ingest/dense_field.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cstring>
#include <limits>
#include <memory>
#include <vector>

#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"

namespace fovea::ingest {
namespace {

using ::fovea::testing::FailsWith;
constexpr auto kInternal = absl::StatusCode::kInternal;
const Box3 kExtent{{-3, 0, 5}, {9, 10, 12}};  // 12 x 10 x 7
const Box3 kInside{{-1, 2, 6}, {7, 9, 11}};   // 8 x 7 x 5
constexpr int64_t kPlenty = int64_t{1} << 30;

/// The program's end of the slabs, and a worker's mapping of the same memory.
class DenseFieldTest : public ::testing::Test {
 protected:
  void SetUp() override {
    ASSERT_OK_AND_ASSIGN(slabs_, SlabRing::Make());
    void* memory = ::mmap(nullptr, kSlabs * kSlabBytes, PROT_READ | PROT_WRITE, MAP_SHARED,
                          slabs_->descriptor(), 0);
    ASSERT_NE(memory, MAP_FAILED);
    worker_ = static_cast<std::byte*>(memory);
  }
  void TearDown() override { ::munmap(worker_, kSlabs * kSlabBytes); }

  [[nodiscard]] DenseField Field(const Box3& extent, int64_t slices) const {
    return DenseField(extent, slices, kPlenty);
  }
  [[nodiscard]] Status Feed(DenseField* field, const FrameView& frame) {
    return field->Consume(frame, slabs_.get(), [&](DenseSlices slices) -> Status {
      counts_.push_back(slices.count);
      std::visit([&](const auto& values) { all_.insert(all_.end(), values.begin(), values.end()); },
                 slices.values);
      kept_.push_back(std::move(slices));
      return absl::OkStatus();
    });
  }
  /// Sends all rows of `box`, whose value at i is values[i], `rows` at a time.
  template <typename T>
  Status Send(const Box3& box, const std::vector<T>& values, int64_t rows, DenseField* field) {
    const int64_t width = box.Size().x;
    uint32_t slab = 0;
    for (int64_t row = 0, all = std::ssize(values) / width; row < all; row += rows) {
      const int64_t some = std::min(rows, all - row);
      std::memcpy(worker_ + slab * kSlabBytes, values.data() + row * width,
                  static_cast<size_t>(some * width) * sizeof(T));
      FOVEA_RETURN_IF_ERROR(Feed(field, Encode(SlabRows{slab, some})));
      std::memset(worker_ + slab * kSlabBytes, 0xFF, kSlabBytes);  // as soon as it may
      slab = (slab + 1) % kSlabs;
    }
    return absl::OkStatus();
  }

  std::unique_ptr<SlabRing> slabs_;
  std::byte* worker_ = nullptr;
  std::vector<int64_t> counts_;  // slices of each piece
  std::vector<double> all_;      // their values
  std::vector<DenseSlices> kept_;
};

template <typename T>
std::vector<T> Numbers(int64_t count) {
  std::vector<T> values(static_cast<size_t>(count));
  for (size_t i = 0; i < values.size(); ++i) {
    values[i] = static_cast<T>(1 + i % 120);
  }
  return values;
}

TEST_F(DenseFieldTest, APartOfTheExtentIsSurroundedByZeros) {
  const std::vector<int16_t> values = Numbers<int16_t>(kInside.Volume());
  for (const int64_t rows : {1, 5, 35}) {
    all_.clear();
    counts_.clear();
    DenseField field = Field(kExtent, 3);
    ASSERT_OK(Feed(&field, Encode(DenseStart{0, DenseType::kInt16, kInside})));
    ASSERT_OK(Send(kInside, values, rows, &field));
    ASSERT_OK(Feed(&field, Encode(FieldEnd{kInside, 4})));
    ASSERT_OK_AND_ASSIGN(const DenseEnd end, field.Finish());
    EXPECT_EQ(counts_, (std::vector<int64_t>{3, 3, 1}));
    ASSERT_EQ(std::ssize(all_), kExtent.Volume());
    size_t next = 0;
    size_t at = 0;
    for (int64_t z = kExtent.lo.z; z < kExtent.hi.z; ++z) {
      for (int64_t y = kExtent.lo.y; y < kExtent.hi.y; ++y) {
        for (int64_t x = kExtent.lo.x; x < kExtent.hi.x; ++x) {
          const bool is_inside = kInside.Contains({{x, y, z}, {x + 1, y + 1, z + 1}});
          EXPECT_EQ(all_[at++], is_inside ? values[next++] : 0);
        }
      }
    }
    EXPECT_EQ(end.rounded, 4U);
    EXPECT_EQ(end.stats.minimum, 0);
    EXPECT_EQ(end.stats.maximum, 120);
    EXPECT_EQ(end.stats.histogram[0], static_cast<uint64_t>(kExtent.Volume() - kInside.Volume()));
  }
}

TEST_F(DenseFieldTest, NanAndInfinityBecomeZero) {
  std::vector<float> values = Numbers<float>(kExtent.Volume());
  values[7] = std::numeric_limits<float>::quiet_NaN();
  values[300] = -std::numeric_limits<float>::infinity();
  DenseField field = Field(kExtent, 32);
  ASSERT_OK(Feed(&field, Encode(DenseStart{0, DenseType::kFloat32, kExtent})));
  ASSERT_OK(Send(kExtent, values, 70, &field));
  ASSERT_OK(Feed(&field, Encode(FieldEnd{kExtent, 0})));
  ASSERT_OK_AND_ASSIGN(const DenseEnd end, field.Finish());
  EXPECT_EQ(end.nonfinite, 2U);
  EXPECT_EQ(end.stats.minimum, 0);
  EXPECT_EQ(all_[7], 0);
  EXPECT_EQ(all_[300], 0);
  EXPECT_EQ(all_[301], values[301]);
}

TEST_F(DenseFieldTest, WhatTheWorkerWritesLaterChangesNothing) {
  const std::vector<uint8_t> values = Numbers<uint8_t>(kExtent.Volume());
  DenseField field = Field(kExtent, 7);
  ASSERT_OK(Feed(&field, Encode(DenseStart{0, DenseType::kUint8, kExtent})));
  ASSERT_OK(Send(kExtent, values, 10, &field));
  ASSERT_OK(Feed(&field, Encode(FieldEnd{kExtent, 0})));
  std::memset(worker_, 0xAB, kSlabs * kSlabBytes);
  ASSERT_EQ(kept_.size(), 1U);
  const auto piece = std::get<std::span<const uint8_t>>(kept_.front().values);
  EXPECT_TRUE(std::equal(piece.begin(), piece.end(), values.begin(), values.end()));
}

TEST_F(DenseFieldTest, WhatDoesNotFollowTheProtocolIsRefused) {
  const auto run = [&](const std::vector<Frame>& frames) -> Status {
    DenseField field = Field(kExtent, 4);
    for (const Frame& frame : frames) {
      FOVEA_RETURN_IF_ERROR(Feed(&field, frame));
    }
    return field.Finish().status();
  };
  const Frame start = Encode(DenseStart{0, DenseType::kFloat32, kExtent});
  const Frame end = Encode(FieldEnd{kExtent, 0});
  const Frame all = Encode(SlabRows{3, 70});
  EXPECT_OK(run({start, all, end}));
  EXPECT_THAT(run({}), FailsWith(kInternal, "without an end"));
  EXPECT_THAT(run({start, all}), FailsWith(kInternal, "without an end"));
  EXPECT_THAT(run({start, end}), FailsWith(kInternal, "0 of 70 rows"));
  EXPECT_THAT(run({all}), FailsWith(kInternal, "out of turn"));
  EXPECT_THAT(run({start, all, end, all}), FailsWith(kInternal, "out of turn"));
  EXPECT_THAT(run({start, all, end, start}), FailsWith(kInternal, "out of turn"));
  EXPECT_THAT(run({start, start}), FailsWith(kInternal, "malformed"));
  EXPECT_THAT(run({start, Encode(Tile{kExtent, 1})}), FailsWith(kInternal, "malformed"));
  EXPECT_THAT(run({start, Encode(SlabRows{0, 71})}), FailsWith(kInternal, "71 rows"));
  EXPECT_THAT(run({start, Encode(SlabRows{0, 0})}), FailsWith(kInternal, "slab"));
  EXPECT_THAT(run({start, Encode(SlabRows{0, std::numeric_limits<int64_t>::max()})}),
              FailsWith(kInternal, "rows"));
  EXPECT_THAT(run({start, Encode(SlabRows{kSlabs, 1})}), FailsWith(kInternal, "slab"));
  EXPECT_THAT(run({Encode(DenseStart{1, DenseType::kUint8, kExtent})}),
              FailsWith(kInternal, "another field"));
  EXPECT_THAT(run({Encode(DenseStart{0, static_cast<DenseType>(5), kExtent})}),
              FailsWith(kInternal, "type"));
  Box3 outside = kExtent;
  ++outside.hi.z;
  EXPECT_THAT(run({Encode(DenseStart{0, DenseType::kUint8, outside})}),
              FailsWith(kInternal, "outside the extent"));
}

TEST_F(DenseFieldTest, MoreRowsThanASlabHoldsAreRefused) {
  const Box3 large{{0, 0, 0}, {1024, 1024, 8}};
  DenseField field = Field(large, 4);
  ASSERT_OK(Feed(&field, Encode(DenseStart{0, DenseType::kFloat32, large})));
  EXPECT_OK(Feed(&field, Encode(SlabRows{kSlabs - 1, 1024})));
  EXPECT_THAT(Feed(&field, Encode(SlabRows{kSlabs - 1, 1025})), FailsWith(kInternal, "1025 rows"));
}

TEST_F(DenseFieldTest, MemoryIsCountedBeforeItIsTaken) {
  const Box3 huge{{0, 0, 0}, {65536, 65536, 65536}};
  DenseField field = Field(huge, 32);
  EXPECT_THAT(Feed(&field, Encode(DenseStart{0, DenseType::kFloat32, huge})),
              FailsWith(absl::StatusCode::kResourceExhausted, "65536"));
}

TEST_F(DenseFieldTest, SharedMemoryCanBeNeitherCutNorGrown) {
  EXPECT_NE(::ftruncate(slabs_->descriptor(), 0), 0);
  EXPECT_NE(::ftruncate(slabs_->descriptor(), 2 * kSlabs * kSlabBytes), 0);
  EXPECT_NE(::fcntl(slabs_->descriptor(), F_ADD_SEALS, F_SEAL_WRITE), 0);
}

}  // namespace
}  // namespace fovea::ingest
