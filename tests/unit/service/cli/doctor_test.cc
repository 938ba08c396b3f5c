#include "service/cli/doctor_checks.h"

#include <unistd.h>

#include <algorithm>
#include <filesystem>

#include <gtest/gtest.h>

#include "tests/support/temporary_folder.h"

namespace fovea::cli {
namespace {

Verdict WorstOf(const std::vector<Finding>& findings) {
  Verdict worst = Verdict::kGood;
  for (const Finding& finding : findings) {
    worst = std::max(worst, finding.verdict);
    EXPECT_FALSE(finding.about.empty());
    EXPECT_FALSE(finding.found.empty()) << finding.about;
    EXPECT_EQ(finding.advice.empty(), finding.verdict == Verdict::kGood) << finding.about;
  }
  return worst;
}

TEST(DoctorTest, WhatRunsTheTestsHasWhatIsNeeded) {
  EXPECT_NE(WorstOf(CheckMachine()), Verdict::kMissing);
}

TEST(DoctorTest, AFolderIsTriedOutAndLeftAsItWas) {
  const fovea::testing::TemporaryFolder folder;
  const std::vector<Finding> findings = CheckFolder(folder.path(), true);
  EXPECT_NE(WorstOf(findings), Verdict::kMissing);
  EXPECT_EQ(findings.size(), 5U);
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

TEST(DoctorTest, AFolderThatIsNotThereIsMissing) {
  EXPECT_EQ(WorstOf(CheckFolder("/nowhere/at/all", false)), Verdict::kMissing);
}

TEST(DoctorTest, AFolderThatCannotBeWrittenToMattersIfItWasNamed) {
  const std::string folder = "/proc/self";  // not even root's
  EXPECT_EQ(WorstOf(CheckFolder(folder, true)), Verdict::kMissing);
  EXPECT_EQ(WorstOf(CheckFolder(folder, false)), Verdict::kLacking);
}

TEST(DoctorTest, LimitsOfControlGroupsOfBothVersions) {
  EXPECT_EQ(ParseMemoryLimit("max\n"), -1);
  EXPECT_EQ(ParseMemoryLimit("536870912\n"), 536870912);
  EXPECT_EQ(ParseMemoryLimit("9223372036854771712\n"), -1);
  EXPECT_EQ(ParseMemoryLimit(""), -1);
  EXPECT_EQ(ParseMemoryLimit("12 MB"), -1);
  EXPECT_GT(UsableMemoryBytes(), 0);
}

}  // namespace
}  // namespace fovea::cli
