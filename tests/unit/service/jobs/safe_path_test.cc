#include "service/jobs/safe_path.h"

#include <filesystem>
#include <fstream>

#include "tests/support/status_matchers.h"
#include "tests/support/temporary_folder.h"

namespace fovea::jobs {
namespace {

namespace fs = std::filesystem;
using ::fovea::testing::FailsWith;

class SafePathTest : public ::testing::Test {
 protected:
  void SetUp() override {
    fs::create_directories(folder_ / "root/inside");
    fs::create_directories(folder_ / "secret");
    std::ofstream(folder_ / "secret/file") << "x";
    std::ofstream(folder_ / "root/file") << "x";
    fs::create_directory_symlink(folder_ / "secret", folder_ / "root/out");
    fs::create_symlink(folder_ / "secret/file", folder_ / "root/out-file");
    fs::create_directory_symlink("inside", folder_ / "root/in");
    root_ = *CanonicalFolder(folder_ / "root", "--ingest-root");
  }
  testing::TemporaryFolder folder_;
  std::string root_;
};

TEST_F(SafePathTest, NamesBelowTheRootAreThere) {
  for (const char* name :
       {"file", "inside/x.raw", "in/x.raw", "new/folder/x.png", "a b/ü_##.vdb"}) {
    const auto path = PathBelow(root_, name);
    ASSERT_OK(path.status());
    EXPECT_EQ(*path, root_ + "/" + name);
  }
}

TEST_F(SafePathTest, NoNameLeadsOut) {
  for (const char* name :
       {"", "/", "/etc/passwd", "..", "../secret/file", "inside/../../secret/file", "inside/..",
        "./file", "a//b", "a/", ".hidden", "inside/.x", "out/file", "out/new/file", "a\nb"}) {
    EXPECT_THAT(PathBelow(root_, name), FailsWith(absl::StatusCode::kNotFound, "is not there"))
        << name;
  }
  EXPECT_THAT(PathBelow(root_, std::string(2000, 'a')),
              FailsWith(absl::StatusCode::kNotFound, "is not there"));
}

TEST_F(SafePathTest, FilesThatAreLinksOutAreNotThere) {
  EXPECT_OK(CheckBelow(root_, {root_ + "/file", root_ + "/in"}));
  for (const char* name : {"/out-file", "/out/file", "/none"}) {
    EXPECT_THAT(CheckBelow(root_, {root_ + "/file", root_ + name}),
                FailsWith(absl::StatusCode::kNotFound, name + 1));
  }
}

TEST_F(SafePathTest, RootsAreNotTold) {
  EXPECT_EQ(WithoutFolder("'" + root_ + "/a' and " + root_ + "/b/c: bad", root_),
            "'a' and b/c: bad");
  EXPECT_THAT(CanonicalFolder(folder_ / "none", "--export-root"),
              FailsWith(absl::StatusCode::kNotFound, "--export-root"));
  EXPECT_THAT(CanonicalFolder(folder_ / "secret/file", "--export-root"),
              FailsWith(absl::StatusCode::kFailedPrecondition, "--export-root"));
}

}  // namespace
}  // namespace fovea::jobs
