#include "ingest/grid_choice.h"

#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"

namespace fovea::ingest {
namespace {

using ::fovea::testing::FailsWith;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

GridInfo Scalar(const std::string& name) {
  return {name, "float", "", {{0, 0, 0}, {9, 9, 9}}, {}, 0};
}

GridInfo Vector(const std::string& name) {
  return {name, "vec3s", "type vec3s is not a scalar", {}, {}, 0};
}

ScannedFile File(const std::string& path, std::vector<GridInfo> grids) {
  return {{path, std::nullopt, false}, {1, ""}, std::move(grids)};
}

TEST(FieldNameTest, IsUsableAsAFolder) {
  EXPECT_EQ(FieldNameOf("density"), "density");
  EXPECT_EQ(FieldNameOf("density[2]"), "density.2");
  EXPECT_EQ(FieldNameOf("a b/c"), "a_b_c");
  EXPECT_EQ(FieldNameOf("..\x1B"), "_._");
  EXPECT_EQ(FieldNameOf("[0]"), "unnamed.0");
  EXPECT_EQ(FieldNameOf(""), "unnamed");
  EXPECT_EQ(FieldNameOf("time"), "time_");
  EXPECT_EQ(FieldNameOf("a[b]"), "a_b_");
  EXPECT_LE(FieldNameOf(std::string(9999, 'x')).size(), 120U);
}

TEST(ChooseGridsTest, TakesEveryScalarGridOfAnyFileAndSaysWhatIsLeftOut) {
  const std::vector<ScannedFile> files{
      File("1.vdb", {Scalar("density"), Vector("velocity")}),
      File("2.vdb", {Scalar("flame"), Scalar("density"), Vector("velocity")})};
  ASSERT_OK_AND_ASSIGN(const GridChoice choice, ChooseGrids({}, files));
  EXPECT_THAT(choice.grids,
              ElementsAre(ChosenGrid{"density", "density"}, ChosenGrid{"flame", "flame"}));
  EXPECT_THAT(choice.warnings, ElementsAre(HasSubstr("velocity")));
}

TEST(ChooseGridsTest, TakesWhatIsAskedForInThatOrder) {
  const std::vector<ScannedFile> files{File("1.vdb", {Scalar("a"), Scalar("b"), Vector("v")})};
  ASSERT_OK_AND_ASSIGN(const GridChoice choice, ChooseGrids({"b", "a"}, files));
  EXPECT_THAT(choice.grids, ElementsAre(ChosenGrid{"b", "b"}, ChosenGrid{"a", "a"}));
  EXPECT_THAT(choice.warnings, IsEmpty());
}

TEST(ChooseGridsTest, RefusesWhatIsNotThereOrNotAScalar) {
  const std::vector<ScannedFile> files{File("1.vdb", {Scalar("a"), Vector("velocity")})};
  EXPECT_THAT(ChooseGrids({"b"}, files),
              FailsWith(absl::StatusCode::kNotFound, "there are: a (float), velocity (vec3s)"));
  EXPECT_THAT(ChooseGrids({"velocity"}, files), FailsWith(kInvalid, "vec3s"));
  EXPECT_THAT(ChooseGrids({"a", "a"}, files), FailsWith(kInvalid, "twice"));
  EXPECT_THAT(ChooseGrids({}, {File("1.vdb", {Vector("v")})}), FailsWith(kInvalid, "v (vec3s)"));
  EXPECT_THAT(ChooseGrids({}, {File("1.vdb", {})}), FailsWith(kInvalid, "no grids at all"));
}

TEST(ChooseGridsTest, TwoGridsOfOneNameAreToldApart) {
  const std::vector<ScannedFile> files{File("1.vdb", {Scalar("density[0]"), Scalar("density[1]")})};
  ASSERT_OK_AND_ASSIGN(const GridChoice all, ChooseGrids({}, files));
  EXPECT_THAT(all.grids, ElementsAre(ChosenGrid{"density[0]", "density.0"},
                                     ChosenGrid{"density[1]", "density.1"}));
  EXPECT_EQ(all.warnings.size(), 2U);
  for (const std::string name : {"density[1]", "density.1"}) {
    ASSERT_OK_AND_ASSIGN(const GridChoice one, ChooseGrids({name}, files));
    EXPECT_THAT(one.grids, ElementsAre(ChosenGrid{"density[1]", "density.1"}));
  }
  EXPECT_THAT(ChooseGrids({"density"}, files), FailsWith(kInvalid, "density[0]"));
}

TEST(ChooseGridsTest, NamesThatCannotBeToldApartAreRefused) {
  EXPECT_THAT(ChooseGrids({}, {File("1.vdb", {Scalar("a"), Scalar("a")})}),
              FailsWith(kInvalid, "1.vdb: two grids are called 'a'"));
  EXPECT_THAT(ChooseGrids({}, {File("1.vdb", {Scalar("a b"), Scalar("a_b")})}),
              FailsWith(kInvalid, "field 'a_b'"));
}

}  // namespace
}  // namespace fovea::ingest
