#include <sys/resource.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstring>
#include <filesystem>

#include "service/export/manifest.h"
#include "service/export/npy.h"
#include "service/export/output_file.h"
#include "service/export/picture_file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temporary_folder.h"

namespace fovea::exports {
namespace {

namespace fs = std::filesystem;
using ::fovea::testing::FailsWith;
using ::fovea::testing::ReadFile;
using ::fovea::testing::TemporaryFolder;

size_t FilesIn(const std::string& folder) {
  return static_cast<size_t>(std::distance(fs::directory_iterator(folder), {}));
}

TEST(OutputFile, AppearsOnlyWithCommitAndMakesItsFolder) {
  const TemporaryFolder folder;
  const std::string path = folder / "a/b/file";
  {
    ASSERT_OK_AND_ASSIGN(OutputFile file, OutputFile::Create(path));
    ASSERT_OK(file.Write("half"));
    EXPECT_FALSE(fs::exists(path));
  }
  EXPECT_EQ(FilesIn(folder / "a/b"), 0U);
  ASSERT_OK(WriteWholeFile(path, "whole"));
  EXPECT_EQ(ReadFile(path), "whole");
  ASSERT_OK(WriteWholeFile(path, "again"));
  EXPECT_EQ(ReadFile(path), "again");
  EXPECT_EQ(FilesIn(folder / "a/b"), 1U);
}

TEST(OutputFile, SaysWhereItCannotWrite) {
  const TemporaryFolder folder;
  ASSERT_OK(WriteWholeFile(folder / "file", "x"));
  const auto below_a_file = WriteWholeFile(folder / "file/inside", "x");
  EXPECT_THAT(below_a_file, FailsWith(absl::StatusCode::kFailedPrecondition, "cannot write"));
  EXPECT_THAT(WriteWholeFile(folder.path(), "x"),
              FailsWith(absl::StatusCode::kFailedPrecondition, "it is a folder"));
}

TEST(OutputFile, AFullDiskLeavesNothingBehind) {
  const TemporaryFolder folder;
  rlimit before{};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &before), 0);
  const auto old_handler = std::signal(SIGXFSZ, SIG_IGN);
  const rlimit small{4096, before.rlim_max};
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &small), 0);
  const Status status = WriteWholeFile(folder / "big", std::string(10000, 'x'));
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &before), 0);
  std::signal(SIGXFSZ, old_handler);
  EXPECT_THAT(status, FailsWith(absl::StatusCode::kResourceExhausted, "big"));
  EXPECT_EQ(FilesIn(folder.path()), 0U);
}

TEST(Npy, HeaderIsAlignedAndNamesShapeAndType) {
  const std::string header = NpyHeader({3, 20, 100});
  EXPECT_EQ(header.size() % 64, 0U);
  EXPECT_EQ(header.substr(0, 8), std::string("\x93NUMPY\x01\x00", 8));
  const size_t length =
      static_cast<unsigned char>(header[8]) + 256 * size_t{static_cast<unsigned char>(header[9])};
  EXPECT_EQ(length, header.size() - 10);
  EXPECT_NE(header.find("'shape': (3,20,100,)"), std::string::npos);
  EXPECT_NE(header.find("'<f4'"), std::string::npos);
  EXPECT_EQ(header.back(), '\n');
}

TEST(PictureFile, TheNameChoosesTheFormat) {
  EXPECT_EQ(*PictureFormatOf("a.PNG"), PictureFormat::kPng);
  EXPECT_EQ(*PictureFormatOf("a.b/c.jpeg"), PictureFormat::kJpeg);
  EXPECT_EQ(*PictureFormatOf("x.tif"), PictureFormat::kTiff);
  EXPECT_EQ(EncodingFor(PictureFormat::kExr), frames::Encoding::kRawRgbaF32);
  for (const char* name : {"a", "a.bmp", "png", ".png", "a.png/"}) {
    EXPECT_THAT(PictureFormatOf(name), FailsWith(absl::StatusCode::kInvalidArgument, name));
  }
}

TEST(PictureFile, NpyHoldsTheFloats) {
  const TemporaryFolder folder;
  frames::Frame frame;
  frame.width_px = 2;
  frame.height_px = 1;
  const float values[8] = {0, 1, 2, 3, 4, 5, 6, 7};
  frame.pixels.assign(reinterpret_cast<const char*>(values), sizeof(values));
  ASSERT_OK(WritePicture(folder / "f.npy", PictureFormat::kNpy, frame));
  const std::string bytes = ReadFile(folder / "f.npy");
  EXPECT_NE(bytes.find("(1,2,4,)"), std::string::npos);
  EXPECT_EQ(bytes.substr(bytes.size() - sizeof(values)), frame.pixels);
}

TEST(Manifest, KnowsItsSettingsAndWhatIsNotOlder) {
  const TemporaryFolder folder;
  const Manifest manifest(folder / "f.png", "settings");
  EXPECT_EQ(manifest.Check(), Manifest::State::kNone);
  ASSERT_OK(manifest.Write());
  EXPECT_EQ(manifest.path(), folder / ".f.png.fovea-export.json");
  EXPECT_EQ(manifest.Check(), Manifest::State::kSame);
  EXPECT_EQ(Manifest(folder / "f.png", "others").Check(), Manifest::State::kChanged);
  EXPECT_EQ(Manifest(folder / "f.exr", "settings").Check(), Manifest::State::kNone);

  const std::string frame = folder / "f.0001.png";
  EXPECT_FALSE(manifest.IsDone(frame));
  ASSERT_OK(WriteWholeFile(frame, "x"));
  EXPECT_TRUE(manifest.IsDone(frame));
  fs::last_write_time(frame, fs::last_write_time(manifest.path()) - std::chrono::seconds(1));
  EXPECT_FALSE(manifest.IsDone(frame));
}

}  // namespace
}  // namespace fovea::exports
