#include "engine/store/removal.h"

#include <atomic>
#include <cerrno>
#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include <gtest/gtest.h>

#include "tests/support/crash_everywhere.h"
#include "tests/support/simulated_disk.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/engine/store/store_test_util.h"

namespace fovea::store {
namespace {

namespace fs = std::filesystem;
using ::fovea::testing::CrashEverywhere;
using ::fovea::testing::FailsWith;
using ::fovea::testing::SimulatedDisk;

constexpr char kPath[] = "root/plume.zarr";
constexpr Int3 kDims{12, 10, 9};

Status RemoveAll(const std::string& path, FileSystem& files) {
  FOVEA_ASSIGN_OR_RETURN(StoreRemoval removal, StoreRemoval::Begin(path, files));
  return removal.Finish();
}

/// Folders below "root" that IsRemovedName.
std::vector<std::string> Left(FileSystem& files) {
  std::vector<std::string> left;
  const auto names = ListDirectory(files, "root");
  EXPECT_OK(names.status());
  for (const std::string& name : names.value_or(std::vector<std::string>())) {
    if (IsRemovedName(name)) {
      left.push_back("root/" + name);
    }
  }
  return left;
}

TEST(StoreRemoval, NoCrashLeavesPartOfAStoreUnderItsName) {
  SimulatedDisk disk;
  ASSERT_OK(MakeDirectory(disk, "root"));
  ASSERT_OK(testing::MakeStore(kPath, testing::MakeInfo(kDims, 8), 2, disk));
  const auto whole = disk.AfterPowerCut([](size_t) { return true; }, SimulatedDisk::Kept::kAll);
  const size_t files = whole->Files().size();
  CrashEverywhere([&] { return whole->AfterKill(); },
                  [](SimulatedDisk* at) { return RemoveAll(kPath, *at); },
                  [&](SimulatedDisk* at) {
                    const auto there = Dataset::Open(kPath, *at);
                    if (there.ok()) {
                      EXPECT_EQ(at->Files().size(), files);
                    } else {
                      EXPECT_TRUE(absl::IsNotFound(there.status()));
                      ASSERT_LE(Left(*at).size(), 1U);
                      for (const std::string& path : Left(*at)) {
                        ASSERT_OK_AND_ASSIGN(StoreRemoval removal, StoreRemoval::TakeUp(path, *at));
                        EXPECT_OK(removal.Finish());
                      }
                      EXPECT_EQ(at->Files().size(), 0U);
                      EXPECT_TRUE(Left(*at).empty());
                    }
                  });
}

TEST(StoreRemoval, AWriterHoldsIt) {
  testing::TemporaryFolder folder;
  const std::string path = folder.Path("plume.zarr");
  ASSERT_OK(testing::MakeStore(path, testing::MakeInfo(kDims, 8), 1));
  {
    ASSERT_OK_AND_ASSIGN(const auto writer, DatasetWriter::Append(path));
    EXPECT_THAT(StoreRemoval::Begin(path).status(),
                FailsWith(absl::StatusCode::kFailedPrecondition, "is being written by"));
    EXPECT_OK(Dataset::Open(path).status());
  }
  ASSERT_OK_AND_ASSIGN(StoreRemoval removal, StoreRemoval::Begin(path));
  EXPECT_FALSE(fs::exists(path));
  EXPECT_THAT(StoreRemoval::Begin(path).status(), FailsWith(absl::StatusCode::kNotFound, path));
  // Another server that starts meanwhile leaves it alone.
  std::string left;
  for (const auto& entry : fs::directory_iterator(folder.Path(""))) {
    left = entry.path().string();
  }
  EXPECT_THAT(StoreRemoval::TakeUp(left).status(),
              FailsWith(absl::StatusCode::kFailedPrecondition, "is being written by"));
  EXPECT_OK(removal.Finish());
  EXPECT_TRUE(fs::is_empty(folder.Path("")));
}

TEST(RemoveHeldStore, NoCrashLeavesPartOfAStoreUnderItsName) {
  SimulatedDisk disk;
  ASSERT_OK(MakeDirectory(disk, "root"));
  ASSERT_OK(testing::MakeStore(kPath, testing::MakeInfo(kDims, 8), 0, disk));
  const auto whole = disk.AfterPowerCut([](size_t) { return true; }, SimulatedDisk::Kept::kAll);
  const auto work = [](SimulatedDisk* at) -> Status {
    FOVEA_ASSIGN_OR_RETURN(const auto writer, DatasetWriter::Append(kPath, *at));
    return RemoveHeldStore(kPath, *at);
  };
  CrashEverywhere([&] { return whole->AfterKill(); }, work,
                  [&](SimulatedDisk* at) {
                    const auto there = Dataset::Open(kPath, *at);
                    if (there.ok()) {
                      return;
                    }
                    EXPECT_TRUE(absl::IsNotFound(there.status())) << there.status();
                    for (const std::string& path : Left(*at)) {
                      ASSERT_OK_AND_ASSIGN(StoreRemoval removal, StoreRemoval::TakeUp(path, *at));
                      EXPECT_OK(removal.Finish());
                    }
                    EXPECT_EQ(at->Files().size(), 0U);
                  });
}

TEST(RemoveHeldStore, AReaderFindsAllOrNothing) {
  testing::TemporaryFolder folder;
  const std::string path = folder.Path("plume.zarr");
  std::atomic<bool> done = false;
  std::atomic<int> found = 0, damaged = 0;
  std::thread reader([&] {
    while (!done) {
      const Status opened = Dataset::Open(path).status();
      found += opened.ok() ? 1 : 0;
      damaged += absl::IsDataLoss(opened) ? 1 : 0;
    }
  });
  for (int i = 0; i < 50; ++i) {
    const auto writer = DatasetWriter::Create(path, testing::MakeInfo(kDims, 8));
    EXPECT_OK(writer.status());
    const int before = found;
    for (int wait = 0; wait < 1000 && found == before; ++wait) {
      std::this_thread::yield();
    }
    EXPECT_OK(RemoveHeldStore(path));
  }
  done = true;
  reader.join();
  EXPECT_EQ(damaged, 0);
  EXPECT_TRUE(fs::is_empty(folder.Path("")));
}

TEST(StoreRemoval, StoresOfOneFolderCanGoAtOnce) {
  testing::TemporaryFolder folder;
  for (const char* name : {"a.zarr", "b.zarr"}) {
    ASSERT_OK(testing::MakeStore(folder.Path(name), testing::MakeInfo(kDims, 8), 1));
  }
  ASSERT_OK_AND_ASSIGN(StoreRemoval a, StoreRemoval::Begin(folder.Path("a.zarr")));
  ASSERT_OK_AND_ASSIGN(StoreRemoval b, StoreRemoval::Begin(folder.Path("b.zarr")));
  EXPECT_OK(a.Finish());
  EXPECT_OK(b.Finish());
  EXPECT_TRUE(fs::is_empty(folder.Path("")));
}

}  // namespace
}  // namespace fovea::store
