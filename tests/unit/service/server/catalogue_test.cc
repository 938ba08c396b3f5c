#include "service/server/catalogue.h"

#include <sys/stat.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"
#include "tests/unit/engine/store/store_test_util.h"

namespace fovea::server {
namespace {

namespace fs = std::filesystem;
using ::fovea::testing::FailsWith;
using std::chrono::milliseconds;
using store::testing::MakeInfo;
using store::testing::MakeStore;
using ::testing::ElementsAre;

constexpr Int3 kDims{12, 10, 9};

bool All(const std::string& /*name*/) {
  return true;
}

class CatalogueTest : public ::testing::Test {
 protected:
  void SetUp() override { fs::create_directories(Root()); }

  std::string Root() const { return folder_.Path("root"); }
  std::string Below(const std::string& name) const { return Root() + "/" + name; }
  void AddStore(const std::string& path, int64_t steps = 1) {
    fs::create_directories(fs::path(path).parent_path());
    ASSERT_OK(MakeStore(path, MakeInfo(kDims, 8), steps));
  }
  std::unique_ptr<Catalogue> OpenRoot(milliseconds interval = milliseconds(0)) {
    auto catalogue = Catalogue::Open(Root(), interval);
    EXPECT_OK(catalogue.status());
    return *std::move(catalogue);
  }
  static std::vector<std::string> Names(const Catalogue::Page& page) {
    std::vector<std::string> names;
    for (const auto& dataset : page.datasets) {
      names.push_back(dataset->name());
    }
    return names;
  }

  store::testing::TemporaryFolder folder_;
};

TEST_F(CatalogueTest, FindsDatasetsAtAnyDepth) {
  AddStore(Below("plume.zarr"));
  AddStore(Below("lab/plume.zarr"));
  AddStore(Below("lab/2024/run 1.zarr"));
  AddStore(Below(".hidden/x.zarr"));
  const auto catalogue = OpenRoot();
  EXPECT_THAT(Names(catalogue->List("", 10, All)),
              ElementsAre("lab/2024/run 1", "lab/plume", "plume"));
  ASSERT_OK_AND_ASSIGN(const auto dataset, catalogue->Find("lab/plume"));
  EXPECT_EQ(dataset->dataset().info().committed_steps, 1);
}

TEST_F(CatalogueTest, ListsInPages) {
  for (const char* name : {"a", "b", "c"}) {
    AddStore(Below(std::string(name) + ".zarr"));
  }
  const auto catalogue = OpenRoot();
  const Catalogue::Page first = catalogue->List("", 2, All);
  EXPECT_THAT(Names(first), ElementsAre("a", "b"));
  EXPECT_TRUE(first.more);
  const Catalogue::Page second = catalogue->List("b", 2, All);
  EXPECT_THAT(Names(second), ElementsAre("c"));
  EXPECT_FALSE(second.more);
}

TEST_F(CatalogueTest, NamesAreNotPaths) {
  AddStore(Below("in.zarr"));
  AddStore(folder_.Path("out.zarr"));
  const auto catalogue = OpenRoot();
  for (const std::string name :
       {"../out", "in/../in", "./in", "/in", "in.zarr", "", "..", "in\n", "lab//in"}) {
    EXPECT_THAT(catalogue->Find(name), FailsWith(absl::StatusCode::kNotFound, "no dataset"))
        << name;
  }
}

TEST_F(CatalogueTest, LinksAreFollowedInsideTheRootOnly) {
  AddStore(Below("a/in.zarr"));
  AddStore(folder_.Path("elsewhere/out.zarr"));
  fs::create_directory_symlink(folder_.Path("elsewhere/out.zarr"), Below("link.zarr"));
  fs::create_directory_symlink(folder_.Path("elsewhere"), Below("b"));
  fs::create_directory_symlink(Below("a/in.zarr"), Below("latest.zarr"));
  fs::create_directory_symlink(Root(), Below("a/loop"));
  fs::create_directory_symlink("nowhere", Below("broken.zarr"));
  EXPECT_THAT(Names(OpenRoot()->List("", 10, All)), ElementsAre("a/in", "latest"));
}

TEST_F(CatalogueTest, DamagedStoresDoNotStopTheOthers) {
  AddStore(Below("good.zarr"));
  AddStore(Below("bad.zarr"));
  fs::create_directories(Below("empty.zarr"));
  std::ofstream(Below("bad.zarr/zarr.json")) << "{ not json";
  std::ofstream(Below("file.zarr")) << "not even a directory";
  const auto catalogue = OpenRoot();
  EXPECT_THAT(Names(catalogue->List("", 10, All)), ElementsAre("good"));
  const auto bad = catalogue->Find("bad");
  EXPECT_FALSE(bad.ok());
  EXPECT_NE(bad.status().code(), absl::StatusCode::kNotFound);
  EXPECT_THAT(MessageOf(bad.status()), ::testing::HasSubstr("dataset 'bad'"));
  // Nobody needs to know where the root is.
  EXPECT_THAT(std::string(MessageOf(catalogue->WithoutRoot(bad.status()))),
              ::testing::Not(::testing::HasSubstr(folder_.Path(""))));
}

TEST_F(CatalogueTest, NoticesNewDatasetsAndNewSteps) {
  AddStore(Below("first.zarr"));
  const auto catalogue = OpenRoot();
  AddStore(Below("second.zarr"));
  EXPECT_OK(catalogue->Find("second").status());
  AddStore(Below("third.zarr"));
  EXPECT_THAT(Names(catalogue->List("", 10, All)), ElementsAre("first", "second", "third"));

  ASSERT_OK_AND_ASSIGN(auto writer, store::DatasetWriter::Append(Below("first.zarr")));
  ASSERT_OK(store::testing::WriteSteps(writer.get(), 1));
  ASSERT_OK_AND_ASSIGN(const auto dataset, catalogue->Find("first"));
  EXPECT_EQ(dataset->dataset().info().committed_steps, 2);
}

TEST_F(CatalogueTest, NoticesWhatIsGoneRepairedOrReplaced) {
  AddStore(Below("gone.zarr"));
  AddStore(Below("replaced.zarr"), 1);
  AddStore(Below("repaired.zarr"));
  const std::string metadata = Below("repaired.zarr/zarr.json");
  fs::rename(metadata, metadata + ".away");
  const auto catalogue = OpenRoot();
  ASSERT_OK_AND_ASSIGN(const auto held, catalogue->Find("gone"));
  EXPECT_FALSE(catalogue->Find("repaired").ok());

  fs::remove_all(Below("gone.zarr"));
  fs::rename(metadata + ".away", metadata);
  AddStore(Below("new"), 3);
  fs::rename(Below("replaced.zarr"), Below("old"));
  fs::rename(Below("new"), Below("replaced.zarr"));
  EXPECT_THAT(catalogue->Find("gone"), FailsWith(absl::StatusCode::kNotFound, "'gone'"));
  EXPECT_OK(catalogue->Find("repaired").status());
  ASSERT_OK_AND_ASSIGN(const auto replaced, catalogue->Find("replaced"));
  EXPECT_EQ(replaced->dataset().info().committed_steps, 3);
  EXPECT_EQ(held->name(), "gone");  // whoever holds it still can
}

TEST_F(CatalogueTest, LooksAtTheDiskOnlyOnceAnInterval) {
  AddStore(Below("first.zarr"));
  const auto catalogue = OpenRoot(std::chrono::hours(1));
  AddStore(Below("second.zarr"));
  EXPECT_THAT(catalogue->Find("second"), FailsWith(absl::StatusCode::kNotFound, "'second'"));
}

TEST_F(CatalogueTest, TheRootMustBeADirectoryOfDatasets) {
  EXPECT_THAT(Catalogue::Open(Below("none"), milliseconds(0)),
              FailsWith(absl::StatusCode::kNotFound, "none"));
  std::ofstream(Below("file")) << "x";
  EXPECT_THAT(Catalogue::Open(Below("file"), milliseconds(0)),
              FailsWith(absl::StatusCode::kFailedPrecondition, "not a directory"));
  AddStore(Below("plume.zarr"));
  EXPECT_THAT(Catalogue::Open(Below("plume.zarr"), milliseconds(0)),
              FailsWith(absl::StatusCode::kFailedPrecondition, "itself a dataset"));
}

TEST_F(CatalogueTest, DefaultsFollowTheSteps) {
  AddStore(Below("plume.zarr"), 1);
  const auto catalogue = OpenRoot();
  ASSERT_OK_AND_ASSIGN(const auto dataset, catalogue->Find("plume"));
  ASSERT_OK_AND_ASSIGN(const wire::DatasetSummary one, dataset->Summary(true));
  EXPECT_EQ(one.default_spec.field, "density");
  EXPECT_EQ(one.first_time_ns, one.last_time_ns);
  ASSERT_OK_AND_ASSIGN(auto writer, store::DatasetWriter::Append(Below("plume.zarr")));
  ASSERT_OK(store::testing::WriteSteps(writer.get(), 1));
  ASSERT_OK(dataset->Refresh(true));
  ASSERT_OK_AND_ASSIGN(const wire::DatasetSummary two, dataset->Summary(true));
  EXPECT_EQ(two.info.committed_steps, 2);
  EXPECT_GT(two.last_time_ns, two.first_time_ns);
  EXPECT_TRUE(two.default_spec.transfer.has_value());
}

TEST_F(CatalogueTest, NewDatasetsBelongBelowTheRoot) {
  const auto catalogue = OpenRoot();
  ASSERT_OK_AND_ASSIGN(const std::string path, catalogue->PathOfNew("lab/new"));
  EXPECT_EQ(path, fs::canonical(Root()).string() + "/lab/new.zarr");
  EXPECT_TRUE(fs::is_directory(Below("lab")));
  EXPECT_THAT(catalogue->PathOfNew("../new"),
              FailsWith(absl::StatusCode::kInvalidArgument, "cannot be the name"));
  fs::create_directories(folder_.Path("elsewhere"));
  fs::create_directory_symlink(folder_.Path("elsewhere"), Below("away"));
  EXPECT_THAT(catalogue->PathOfNew("away/new"),
              FailsWith(absl::StatusCode::kFailedPrecondition, "outside of the root"));
}

TEST_F(CatalogueTest, FindNowSeesWhatFindWouldSeeLater) {
  AddStore(Below("plume.zarr"), 1);
  const auto catalogue = OpenRoot(milliseconds(3'600'000));
  auto writer = store::DatasetWriter::Append(Below("plume.zarr"));
  ASSERT_OK(writer.status());
  ASSERT_OK(store::testing::WriteSteps(writer->get(), 1));
  ASSERT_OK_AND_ASSIGN(auto dataset, catalogue->Find("plume"));
  EXPECT_EQ(dataset->dataset().info().committed_steps, 1);
  ASSERT_OK_AND_ASSIGN(dataset, catalogue->FindNow("plume"));
  EXPECT_EQ(dataset->dataset().info().committed_steps, 2);
  AddStore(Below("later.zarr"));
  EXPECT_TRUE(absl::IsNotFound(catalogue->Find("later").status()));
  EXPECT_OK(catalogue->FindNow("later").status());
}

}  // namespace
}  // namespace fovea::server
