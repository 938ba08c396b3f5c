#include "engine/store/file.h"

#include <cerrno>
#include <filesystem>
#include <iterator>
#include <span>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "engine/store/dataset.h"
#include "engine/store/verify.h"
#include "tests/support/simulated_disk.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/engine/store/store_test_util.h"

namespace fovea::store {
namespace {

using ::fovea::testing::FailsWith;
using ::fovea::testing::SimulatedDisk;
using Kept = SimulatedDisk::Kept;
using Operation = SimulatedDisk::Operation;

std::vector<std::byte> Bytes(const std::string& text) {
  const auto bytes = std::as_bytes(std::span(text));
  return {bytes.begin(), bytes.end()};
}

StatusOr<std::string> ReadText(FileSystem& files, const std::string& path) {
  FOVEA_ASSIGN_OR_RETURN(const std::vector<std::byte> bytes, ReadWholeFile(files, path, 1000));
  return std::string(reinterpret_cast<const char*>(bytes.data()), bytes.size());
}

Status WriteFile(FileSystem& files, const std::string& path, const std::string& text) {
  FOVEA_ASSIGN_OR_RETURN(WritableFile file, WritableFile::Create(files, path));
  return file.Append(Bytes(text));
}

/// The same of the machine's files and of those that only seem to be.
void ExpectFileLife(FileSystem& files, const std::string& root) {
  const std::string folder = root + "/folder";
  ASSERT_OK(MakeDirectory(files, folder));
  EXPECT_THAT(MakeDirectory(files, folder), FailsWith(absl::StatusCode::kAlreadyExists, folder));
  ASSERT_OK(WriteFile(files, folder + "/a", "12345"));
  ASSERT_OK(WriteFile(files, folder + "/a", "123"));
  EXPECT_THAT(ReadText(files, folder + "/a"), ::testing::Eq(StatusOr<std::string>("123")));
  EXPECT_THAT(ReadWholeFile(files, folder + "/a", 2),
              FailsWith(absl::StatusCode::kDataLoss, "has 3 bytes"));
  EXPECT_THAT(ReadText(files, folder + "/b"), FailsWith(absl::StatusCode::kNotFound, "/b"));
  EXPECT_THAT(ReadText(files, folder),
              FailsWith(absl::StatusCode::kFailedPrecondition, "not a regular file"));
  EXPECT_THAT(WriteFile(files, folder, "x"),
              FailsWith(absl::StatusCode::kFailedPrecondition, folder));
  FileBatch batch(files);
  ASSERT_OK(batch.Write(folder + "/a", Bytes("new")));
  ASSERT_OK(batch.Write(folder + "/c", Bytes("c")));
  ASSERT_OK(batch.Flush());
  EXPECT_EQ(*ReadText(files, folder + "/a"), "123");
  ASSERT_OK(batch.Publish());
  EXPECT_EQ(*ReadText(files, folder + "/a"), "new");
  ASSERT_OK_AND_ASSIGN(auto names, ListDirectory(files, folder));
  EXPECT_THAT(names, ::testing::UnorderedElementsAre("a", "c"));
  ASSERT_OK(RemoveTree(files, folder));
  EXPECT_THAT(ListDirectory(files, folder), FailsWith(absl::StatusCode::kNotFound, folder));
}

TEST(Files, TheSimulatedDiskIsLikeTheMachines) {
  const testing::TemporaryFolder folder;
  ExpectFileLife(RealFileSystem(), folder.Path(""));
  SimulatedDisk disk;
  ExpectFileLife(disk, "");
  EXPECT_EQ(disk.open_handles(), 0U);
}

TEST(Files, OpenDirectoriesAreLikePaths) {
  const testing::TemporaryFolder folder;
  const std::string root = folder.Path("root");
  const auto open = RealFileSystem().WithOpenDirectories();
  ASSERT_NE(open, nullptr);
  ASSERT_OK(MakeDirectory(*open, root));
  ExpectFileLife(*open, root);
}

TEST(Files, ManyDirectoriesDoNotTakeAllDescriptors) {
  const testing::TemporaryFolder folder;
  const auto open = RealFileSystem().WithOpenDirectories();
  FileBatch batch(*open);
  for (int i = 0; i < 200; ++i) {
    const std::string directory = folder.Path(std::to_string(i));
    ASSERT_OK(MakeDirectory(*open, directory));
    ASSERT_OK(batch.Write(directory + "/a", Bytes(std::to_string(i))));
  }
  const auto handles = std::filesystem::directory_iterator("/proc/self/fd");
  EXPECT_LT(std::distance(begin(handles), end(handles)), 100);
  ASSERT_OK(batch.Flush());
  ASSERT_OK(batch.Publish());
  for (int i = 0; i < 200; ++i) {
    EXPECT_EQ(*ReadText(RealFileSystem(), folder.Path(std::to_string(i)) + "/a"),
              std::to_string(i));
  }
}

TEST(Files, AnOpenDirectoryIsMeantWhateverItIsCalled) {
  const testing::TemporaryFolder folder;
  const auto open = RealFileSystem().WithOpenDirectories();
  const std::string path = folder.Path("old");
  ASSERT_OK(MakeDirectory(*open, path));
  FileBatch batch(*open);
  ASSERT_OK(batch.Write(path + "/a", Bytes("1")));
  std::filesystem::rename(path, folder.Path("new"));
  ASSERT_OK(MakeDirectory(*open, path));
  ASSERT_OK(batch.Write(path + "/b", Bytes("2")));
  ASSERT_OK(batch.Flush());
  ASSERT_OK(batch.Publish());
  EXPECT_EQ(*ReadText(RealFileSystem(), folder.Path("new") + "/a"), "1");
  EXPECT_EQ(*ReadText(RealFileSystem(), folder.Path("new") + "/b"), "2");
}

constexpr int kMany = 300;  // so many that all threads have some

/// Many files without an order, and one behind them.
Status WriteMany(FileBatch* batch) {
  for (int i = 0; i < kMany; ++i) {
    FOVEA_RETURN_IF_ERROR(batch->Write("d/" + std::to_string(i), Bytes(std::to_string(i))));
  }
  batch->EndUnordered();
  return batch->Write("d/last", Bytes("last"));
}

TEST(Files, EveryOneOfManyIsFlushedAndRenamed) {
  SimulatedDisk disk;
  ASSERT_OK(MakeDirectory(disk, "d"));
  ASSERT_OK(FlushDirectory(disk, ""));
  FileBatch batch(disk);
  ASSERT_OK(WriteMany(&batch));
  ASSERT_OK(batch.Flush());
  ASSERT_OK(batch.Publish());
  const auto files = disk.AfterPowerCut([](size_t) { return false; }, Kept::kNone)->Files();
  EXPECT_EQ(files.size(), static_cast<size_t>(kMany) + 1);
  for (int i = 0; i < kMany; ++i) {
    EXPECT_EQ(files.at("d/" + std::to_string(i)), Bytes(std::to_string(i)));
  }
}

TEST(Files, OfManyNoneFollowsOneThatFails) {
  for (const Operation operation : {Operation::kFlush, Operation::kRename}) {
    for (const std::string name : {"d/0", "d/150", "d/299"}) {
      SimulatedDisk disk;
      ASSERT_OK(MakeDirectory(disk, "d"));
      FileBatch batch(disk);
      ASSERT_OK(WriteMany(&batch));
      disk.set_fault([&](const SimulatedDisk::Call& call) {
        const std::string at = operation == Operation::kRename ? name : TemporaryName(name);
        return call.operation == operation && call.path == at ? -EIO : 0;
      });
      Status status = batch.Flush();
      status = status.ok() ? batch.Publish() : status;
      EXPECT_THAT(status, FailsWith(absl::StatusCode::kDataLoss, name.substr(2)));
      batch.Discard();
      const auto files = disk.AfterKill()->Files();
      EXPECT_FALSE(files.contains("d/last"));
      for (const auto& [path, bytes] : files) {
        EXPECT_FALSE(IsTemporaryName(path.substr(2))) << path;
      }
    }
  }
}

TEST(Files, OneHoldsTheLock) {
  const testing::TemporaryFolder folder;
  SimulatedDisk disk;
  for (FileSystem* files : {static_cast<FileSystem*>(&disk), &RealFileSystem()}) {
    const std::string path = files == &disk ? "" : folder.Path("");
    {
      const auto lock = WriterLock::Take(*files, path);
      ASSERT_OK(lock.status());
      EXPECT_THAT(WriterLock::Take(*files, path).status(),
                  FailsWith(absl::StatusCode::kFailedPrecondition, "is being written by process"));
    }
    EXPECT_OK(WriterLock::Take(*files, path).status());
  }
}

TEST(Files, OnlyWhatWasFlushedIsSureToSurviveAPowerCut) {
  SimulatedDisk disk;
  ASSERT_OK(MakeDirectory(disk, "d"));
  ASSERT_OK(FlushDirectory(disk, ""));
  FileBatch batch(disk);
  ASSERT_OK(batch.Write("d/first", Bytes("1234")));
  ASSERT_OK(batch.Flush());
  const auto none = [](size_t) { return false; };
  const auto all = [](size_t) { return true; };
  EXPECT_TRUE(disk.AfterPowerCut(none, Kept::kAll)->Files().empty()) << "its name is not flushed";
  EXPECT_EQ(disk.AfterPowerCut(all, Kept::kNone)->Files().at("d/.first.tmp"), Bytes("1234"));
  ASSERT_OK(batch.Publish());
  EXPECT_EQ(disk.UnflushedNames(), 0U);
  ASSERT_OK(WriteFile(disk, "d/first", "abcdefgh"));
  EXPECT_EQ(disk.AfterPowerCut(none, Kept::kNone)->Files().at("d/first"), Bytes("1234"));
  EXPECT_EQ(disk.AfterPowerCut(none, Kept::kHalf)->Files().at("d/first"), Bytes("abcdef"));
  EXPECT_EQ(disk.AfterPowerCut(none, Kept::kZeros)->Files().at("d/first"),
            Bytes(std::string("abcd\0\0\0\0", 8)));
  ASSERT_EQ(disk.Rename("d/first", "d/second"), 0);
  EXPECT_TRUE(disk.AfterPowerCut(none, Kept::kAll)->Files().contains("d/first"));
  EXPECT_TRUE(disk.AfterPowerCut(all, Kept::kAll)->Files().contains("d/second"));
  EXPECT_TRUE(disk.AfterKill()->Files().contains("d/second"));
}

TEST(Files, ShortReadsAndWritesAreGoneOnWith) {
  SimulatedDisk disk;
  disk.set_most_at_once(3);
  const std::string path = "a.zarr";
  ASSERT_OK(testing::MakeStore(path, testing::MakeInfo({20, 20, 20}, 8), 2, disk));
  ASSERT_OK_AND_ASSIGN(const VerifyReport report, Verify(path, 1, nullptr, disk));
  EXPECT_THAT(report.problems, ::testing::IsEmpty());
  EXPECT_EQ(report.steps, 2);
}

TEST(Files, ErrorsOfTheDiskHaveTheirCodes) {
  SimulatedDisk disk;
  ASSERT_OK(WriteFile(disk, "a", "text"));
  const std::vector<std::pair<int, absl::StatusCode>> codes = {
      {-EIO, absl::StatusCode::kDataLoss},
      {-ENOSPC, absl::StatusCode::kResourceExhausted},
      {-EMFILE, absl::StatusCode::kResourceExhausted},
      {-EACCES, absl::StatusCode::kFailedPrecondition}};
  for (const auto& [error, code] : codes) {
    for (const Operation operation :
         {Operation::kOpen, Operation::kSize, Operation::kRead, Operation::kWrite,
          Operation::kCreate, Operation::kFlush, Operation::kRename}) {
      disk.set_fault([&, fails = error](const SimulatedDisk::Call& call) {
        return call.operation == operation ? fails : 0;
      });
      FileBatch batch(disk);
      Status status = ReadText(disk, "a").status();
      status.Update(batch.Write("b", Bytes("b")));
      status.Update(batch.Flush());
      status.Update(batch.Publish());
      EXPECT_THAT(status, FailsWith(code, "")) << error;
      disk.set_fault(nullptr);
    }
  }
  disk.set_handle_limit(0);
  EXPECT_THAT(ReadText(disk, "a"), FailsWith(absl::StatusCode::kResourceExhausted, "a"));
}

}  // namespace
}  // namespace fovea::store
