#include "ingest/sequence.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "ingest/name_pattern.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temporary_folder.h"

namespace fovea::ingest {
namespace {

using ::fovea::testing::FailsWith;
using ::fovea::testing::TemporaryFolder;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using Numbers = std::vector<std::optional<int64_t>>;

class SequenceTest : public ::testing::Test {
 protected:
  void Make(const std::vector<std::string>& names) {
    for (const std::string& name : names) {
      std::ofstream(folder_ / name) << "x";
    }
  }
  [[nodiscard]] StatusOr<std::vector<SequenceFile>> Resolve(
      std::vector<std::string> names, OnMissing on_missing = OnMissing::kError) const {
    for (std::string& name : names) {
      name = folder_ / name;
    }
    return ResolveInputs(names, on_missing);
  }
  static std::vector<std::string> Names(const std::vector<SequenceFile>& files) {
    std::vector<std::string> names;
    for (const SequenceFile& file : files) {
      names.push_back(std::filesystem::path(file.path).filename().string());
    }
    return names;
  }
  static Numbers NumbersOf(const std::vector<SequenceFile>& files) {
    Numbers numbers;
    for (const SequenceFile& file : files) {
      numbers.push_back(file.frame_number);
    }
    return numbers;
  }

  TemporaryFolder folder_;
};

TEST_F(SequenceTest, HashesTakePaddedNumbersInOrder) {
  Make({"s_0010.vdb", "s_0002.vdb", "s_0006.vdb", "s_06.vdb", "s_00010.vdb", "t_0001.vdb",
        "s_0001.txt"});
  ASSERT_OK_AND_ASSIGN(const auto files, Resolve({"s_####.vdb"}));
  EXPECT_THAT(Names(files), ElementsAre("s_0002.vdb", "s_0006.vdb", "s_0010.vdb"));
  EXPECT_EQ(NumbersOf(files), (Numbers{2, 6, 10}));
}

TEST_F(SequenceTest, NumbersMayOutgrowTheirWidth) {
  Make({"s_98.vdb", "s_99.vdb", "s_100.vdb"});
  ASSERT_OK_AND_ASSIGN(const auto files, Resolve({"s_##.vdb"}));
  EXPECT_EQ(NumbersOf(files), (Numbers{98, 99, 100}));
}

TEST_F(SequenceTest, PercentPatterns) {
  Make({"a.0001.raw", "a.0002.raw", "b7.raw", "b8.raw", "b9.raw", "b10.raw"});
  ASSERT_OK_AND_ASSIGN(const auto padded, Resolve({"a.%04d.raw"}));
  EXPECT_EQ(NumbersOf(padded), (Numbers{1, 2}));
  ASSERT_OK_AND_ASSIGN(const auto plain, Resolve({"b%d.raw"}));
  EXPECT_EQ(NumbersOf(plain), (Numbers{7, 8, 9, 10}));
  ASSERT_OK_AND_ASSIGN(const auto hash, Resolve({"b#.raw"}));
  EXPECT_EQ(hash, plain);
}

TEST_F(SequenceTest, GlobsAreInNaturalOrderAndNumbered) {
  Make({"f2_v1.vdb", "f10_v1.vdb", "f6_v1.vdb"});
  ASSERT_OK_AND_ASSIGN(const auto files, Resolve({"f*.vdb"}));
  EXPECT_THAT(Names(files), ElementsAre("f2_v1.vdb", "f6_v1.vdb", "f10_v1.vdb"));
  EXPECT_EQ(NumbersOf(files), (Numbers{2, 6, 10}));  // v1 is the same everywhere
}

TEST_F(SequenceTest, ListsWithoutACommonNumberKeepTheirOrder) {
  Make({"early.vdb", "late.vdb", "a_1.vdb", "b_1.vdb", "c_2.vdb"});
  ASSERT_OK_AND_ASSIGN(const auto plain, Resolve({"late.vdb", "early.vdb"}));
  EXPECT_THAT(Names(plain), ElementsAre("late.vdb", "early.vdb"));
  EXPECT_EQ(NumbersOf(plain), (Numbers{std::nullopt, std::nullopt}));
  ASSERT_OK_AND_ASSIGN(const auto twice, Resolve({"c_2.vdb", "a_1.vdb", "b_1.vdb"}));
  EXPECT_THAT(Names(twice), ElementsAre("c_2.vdb", "a_1.vdb", "b_1.vdb"));
  EXPECT_EQ(NumbersOf(twice), (Numbers{std::nullopt, std::nullopt, std::nullopt}));
}

TEST_F(SequenceTest, ASingleFileHasTheNumberThatEndsItsName) {
  Make({"smoke_0021.vdb", "ct_256_u8.raw", "7.vdb"});
  ASSERT_OK_AND_ASSIGN(const auto smoke, Resolve({"smoke_0021.vdb"}));
  EXPECT_EQ(NumbersOf(smoke), (Numbers{21}));
  ASSERT_OK_AND_ASSIGN(const auto ct, Resolve({"ct_256_u8.raw"}));
  EXPECT_EQ(NumbersOf(ct), (Numbers{std::nullopt}));
  ASSERT_OK_AND_ASSIGN(const auto seven, Resolve({"7.vdb"}));
  EXPECT_EQ(NumbersOf(seven), (Numbers{7}));
}

TEST_F(SequenceTest, FilesWhosePatternIsTheirNameAreFiles) {
  Make({"a_##.vdb", "b[1].vdb"});
  ASSERT_OK_AND_ASSIGN(const auto files, Resolve({"a_##.vdb", "b[1].vdb"}));
  EXPECT_THAT(Names(files), ElementsAre("a_##.vdb", "b[1].vdb"));
}

TEST_F(SequenceTest, AMissingStepIsNamed) {
  Make({"s_0001.vdb", "s_0005.vdb", "s_0013.vdb"});
  for (const std::string pattern : {"s_####.vdb", "s_*.vdb"}) {
    EXPECT_THAT(Resolve({pattern}), FailsWith(absl::StatusCode::kNotFound, "s_0009.vdb"))
        << pattern;
  }
  EXPECT_THAT(Resolve({"s_0013.vdb", "s_0001.vdb", "s_0005.vdb"}),
              FailsWith(absl::StatusCode::kNotFound, "--on-missing"));
}

TEST_F(SequenceTest, AMissingStepIsSkippedOrHeld) {
  Make({"s_1.vdb", "s_2.vdb", "s_5.vdb"});
  ASSERT_OK_AND_ASSIGN(const auto skipped, Resolve({"s_%d.vdb"}, OnMissing::kSkip));
  EXPECT_EQ(NumbersOf(skipped), (Numbers{1, 2, 5}));
  ASSERT_OK_AND_ASSIGN(const auto held, Resolve({"s_%d.vdb"}, OnMissing::kHold));
  EXPECT_EQ(NumbersOf(held), (Numbers{1, 2, 3, 4, 5}));
  EXPECT_THAT(Names(held), ElementsAre("s_1.vdb", "s_2.vdb", "s_2.vdb", "s_2.vdb", "s_5.vdb"));
  EXPECT_TRUE(held[2].held && held[3].held && !held[4].held);
}

TEST_F(SequenceTest, NothingFoundSaysWhatWasLookedForAndWhere) {
  Make({"smoke.0001.vdb"});
  EXPECT_THAT(Resolve({"smoke_####.vdb"}),
              FailsWith(absl::StatusCode::kNotFound, "smoke.0001.vdb"));
  EXPECT_THAT(Resolve({"smoke_####.vdb"}),
              FailsWith(absl::StatusCode::kNotFound, "'smoke_', 4 digits or more, '.vdb'"));
  EXPECT_THAT(Resolve({"*.exr"}), FailsWith(absl::StatusCode::kNotFound, "*.exr"));
  EXPECT_THAT(Resolve({"no.vdb"}), FailsWith(absl::StatusCode::kNotFound, "no.vdb"));
  EXPECT_THAT(Resolve({"nowhere/s_##.vdb"}), FailsWith(absl::StatusCode::kNotFound, "nowhere"));
  EXPECT_THAT(ResolveInputs({}, OnMissing::kError),
              FailsWith(absl::StatusCode::kInvalidArgument, "no input"));
}

TEST_F(SequenceTest, WhatCannotBeASeriesIsRefused) {
  Make({"a_01.vdb", "a_1.vdb", "b_1.vdb"});
  std::filesystem::create_directory(folder_ / "sub");
  EXPECT_THAT(Resolve({"sub"}), FailsWith(absl::StatusCode::kInvalidArgument, "is a folder"));
  EXPECT_THAT(Resolve({"a_##_##.vdb"}),
              FailsWith(absl::StatusCode::kInvalidArgument, "2 number patterns"));
  EXPECT_THAT(Resolve({"a_#.vdb"}), FailsWith(absl::StatusCode::kInvalidArgument, "same number"));
  EXPECT_THAT(Resolve({"b_1.vdb", "b_*.vdb"}),
              FailsWith(absl::StatusCode::kInvalidArgument, "named twice"));
  EXPECT_THAT(ResolveInputs({"/dev/null"}, OnMissing::kError),
              FailsWith(absl::StatusCode::kInvalidArgument, "not a regular file"));
}

TEST(NaturalLessTest, NumbersCompareAsNumbers) {
  std::vector<std::string> names{"a10", "a9", "a1b", "a01", "a", "b1", "a100", "a9b"};
  std::sort(names.begin(), names.end(), NaturalLess);
  EXPECT_THAT(names, ElementsAre("a", "a01", "a1b", "a9", "a9b", "a10", "a100", "b1"));
}

TEST(NamePatternTest, NumbersAreBounded) {
  ASSERT_OK_AND_ASSIGN(const auto pattern, NamePattern::Parse("f#"));
  ASSERT_TRUE(pattern.has_value());
  EXPECT_EQ(pattern->Match("f" + std::string(18, '9')), 999'999'999'999'999'999);
  EXPECT_EQ(pattern->Match("f" + std::string(19, '9')), std::nullopt);
  EXPECT_EQ(pattern->Match("f"), std::nullopt);
  EXPECT_EQ(pattern->Match("f-1"), std::nullopt);
}

TEST(NamePatternTest, PlainNamesAreNoPatterns) {
  for (const std::string name : {"smoke.vdb", "100%.vdb", "a%s.vdb", "%", "a%12345d"}) {
    ASSERT_OK_AND_ASSIGN(const auto pattern, NamePattern::Parse(name));
    EXPECT_FALSE(pattern.has_value()) << name;
  }
}

TEST(WithNumberTest, KeepsThePadding) {
  EXPECT_EQ(WithNumber("s_0005_v2.vdb", 5, 9), "s_0009_v2.vdb");
  EXPECT_EQ(WithNumber("s_5.vdb", 5, 10), "s_10.vdb");
}

}  // namespace
}  // namespace fovea::ingest
