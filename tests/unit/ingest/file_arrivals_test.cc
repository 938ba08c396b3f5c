#include "ingest/file_arrivals.h"

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"
#include "tests/support/temporary_folder.h"

namespace fovea::ingest {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

class FileArrivalsTest : public ::testing::Test {
 protected:
  FileArrivals Start() { return {folder_ / "in", *NamePattern::Parse("a_##.vdb").value()}; }
  [[nodiscard]] std::string Path(const std::string& name) const { return folder_ / ("in/" + name); }
  static std::vector<int64_t> Numbers(const FileArrivals& arrivals) {
    std::vector<int64_t> numbers;
    for (const auto& [number, name] : arrivals.finished()) {
      numbers.push_back(number);
    }
    return numbers;
  }

  fovea::testing::TemporaryFolder folder_;
  bool made_ = fs::create_directory(folder_ / "in");
};

TEST_F(FileArrivalsTest, WhatWasThereIsFinishedIfItStaysAsItIs) {
  std::ofstream(Path("a_02.vdb")) << "two";
  std::ofstream(Path("a_10.vdb")) << "ten";
  std::ofstream(Path("a_11.vdb")).close();  // nothing in it: not finished
  std::ofstream(Path("b_03.vdb")) << "another series";
  fs::create_directory(Path("a_04.vdb"));
  FileArrivals arrivals = Start();
  ASSERT_OK(arrivals.Wait(0, true));
  EXPECT_THAT(Numbers(arrivals), IsEmpty());
  std::ofstream growing(Path("a_10.vdb"), std::ios::app);
  growing << "and more" << std::flush;
  ASSERT_OK(arrivals.Wait(0, true));
  EXPECT_THAT(Numbers(arrivals), ElementsAre(2));
  for (int look = 0; look < 10; ++look) {  // the kernel would tell of its end: that is waited for
    EXPECT_THAT(Numbers(arrivals), ElementsAre(2));
    ASSERT_OK(arrivals.Wait(0, true));
  }
  EXPECT_THAT(Numbers(arrivals), ElementsAre(2, 10));
  EXPECT_EQ(arrivals.finished().at(2), "a_02.vdb");
}

TEST_F(FileArrivalsTest, TheKernelTellsOfFilesThatAreClosedOrMovedThere) {
  FileArrivals arrivals = Start();
  if (!arrivals.is_told()) {
    GTEST_SKIP() << "no inotify here";
  }
  ASSERT_OK(arrivals.Wait(0, true));
  std::ofstream open(Path("a_01.vdb"));
  open << "half" << std::flush;
  ASSERT_OK(arrivals.Wait(0, false));
  EXPECT_THAT(Numbers(arrivals), IsEmpty());
  open.close();
  ASSERT_OK(arrivals.Wait(10, false));
  EXPECT_THAT(Numbers(arrivals), ElementsAre(1));
  std::ofstream(folder_ / "moved") << "all of it";
  fs::rename(folder_ / "moved", Path("a_02.vdb"));
  std::ofstream(Path("other")) << "no number";
  ASSERT_OK(arrivals.Wait(10, false));
  EXPECT_THAT(Numbers(arrivals), ElementsAre(1, 2));
}

TEST_F(FileArrivalsTest, ALateFileOfWhichTheKernelDoesNotTellMustBeQuietForLonger) {
  FileArrivals arrivals = Start();
  if (!arrivals.is_told()) {
    GTEST_SKIP() << "no inotify here";
  }
  ASSERT_OK(arrivals.Wait(0, true));
  std::ofstream open(Path("a_01.vdb"));
  open << "a writer that pauses" << std::flush;
  for (int look = 0; look < 10; ++look) {
    ASSERT_OK(arrivals.Wait(0, true));
    EXPECT_THAT(Numbers(arrivals), IsEmpty()) << look;
  }
  ASSERT_OK(arrivals.Wait(0, true));
  EXPECT_THAT(Numbers(arrivals), ElementsAre(1));
}

TEST_F(FileArrivalsTest, AFolderThatGoesIsAnError) {
  FileArrivals arrivals = Start();
  fs::remove_all(folder_ / "in");
  EXPECT_THAT(arrivals.Wait(0, true), fovea::testing::FailsWith(absl::StatusCode::kNotFound, "in"));
}

}  // namespace
}  // namespace fovea::ingest
