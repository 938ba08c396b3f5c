#include "service/cli/picture_source.h"

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <set>

#include "tests/support/status_matchers.h"
#include "tests/support/temporary_folder.h"

namespace fovea::cli {
namespace {

namespace fs = std::filesystem;
using ::fovea::testing::FailsWith;
using ::fovea::testing::TemporaryFolder;

TEST(IsDataset, IsAFolderThatEndsInZarrOrHoldsZarrJson) {
  const TemporaryFolder folder;
  fs::create_directories(folder / "a.zarr");
  fs::create_directories(folder / "b");
  fs::create_directories(folder / "c");
  std::ofstream(folder / "b/zarr.json") << "{}";
  std::ofstream(folder / "file.zarr") << "x";
  EXPECT_TRUE(IsDataset(folder / "a.zarr"));
  EXPECT_TRUE(IsDataset(folder / "a.zarr/"));
  EXPECT_TRUE(IsDataset(folder / "b"));
  EXPECT_FALSE(IsDataset(folder / "c"));
  EXPECT_FALSE(IsDataset(folder / "file.zarr"));
  EXPECT_FALSE(IsDataset(folder / "none.zarr"));
}

TEST(CacheName, ChangesWithFilesAndHowTheyAreRead) {
  const TemporaryFolder folder;
  ingest::IngestOptions options;
  for (const char* name : {"smoke_0001.raw", "smoke_0002.raw"}) {
    std::ofstream(folder / name) << "12345678";
    options.inputs.push_back(folder / name);
  }
  std::set<std::string> names;
  const auto add = [&](const ingest::IngestOptions& with) {
    const auto name = CacheName(with);
    ASSERT_OK(name);
    EXPECT_TRUE(name->starts_with("smoke-")) << *name;
    EXPECT_TRUE(names.insert(*name).second) << *name;
  };
  add(options);
  EXPECT_EQ(*CacheName(options), *names.begin());
  ingest::IngestOptions other = options;
  other.raw = *ingest::ParseRawFormat("2x2x2:uint8");
  add(other);
  other.raw->header_bytes = 1;
  add(other);
  other = options;
  other.grids = {"density"};
  add(other);
  other = options;
  other.inputs.pop_back();
  add(other);
  std::ofstream(folder / "smoke_0002.raw") << "longer than it was";
  add(options);
  const fs::path touched = folder / "smoke_0001.raw";
  fs::last_write_time(touched, fs::last_write_time(touched) + std::chrono::seconds(5));
  add(options);
  options.inputs = {folder / "none_####.vdb"};
  EXPECT_THAT(CacheName(options), FailsWith(absl::StatusCode::kNotFound, "none_####.vdb"));
}

TEST(CacheFolder, FollowsTheFlagThenTheEnvironment) {
  EXPECT_EQ(*CacheFolder("given"), "given");
  const char* old_home = std::getenv("HOME");
  const std::string home = old_home == nullptr ? "" : old_home;
  const char* old_xdg = std::getenv("XDG_CACHE_HOME");
  const std::string xdg = old_xdg == nullptr ? "" : old_xdg;
  ::setenv("XDG_CACHE_HOME", "/x", 1);
  EXPECT_EQ(*CacheFolder(""), "/x/fovea");
  ::setenv("XDG_CACHE_HOME", "relative", 1);  // to be ignored, says its specification
  ::setenv("HOME", "/h", 1);
  EXPECT_EQ(*CacheFolder(""), "/h/.cache/fovea");
  ::unsetenv("HOME");
  EXPECT_THAT(CacheFolder(""), FailsWith(absl::StatusCode::kFailedPrecondition, "--cache"));
  ::setenv("HOME", home.c_str(), 1);
  old_xdg == nullptr ? ::unsetenv("XDG_CACHE_HOME") : ::setenv("XDG_CACHE_HOME", xdg.c_str(), 1);
}

}  // namespace
}  // namespace fovea::cli
