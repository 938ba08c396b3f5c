#include <sys/resource.h>

#include <csignal>
#include <filesystem>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <OpenImageIO/imageio.h>
#include <gtest/gtest.h>

#include "ingest/ingest.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temporary_folder.h"

namespace fovea::ingest {
namespace {

using ::fovea::testing::FailsWith;
using ::fovea::testing::TemporaryFolder;

constexpr int kWidth = 33;
constexpr int kHeight = 17;

/// Values that half floats hold exactly, some above 1.
std::vector<float> Pixels() {
  std::vector<float> rgba(size_t{4} * kWidth * kHeight);
  for (size_t i = 0; i < rgba.size(); ++i) {
    rgba[i] = static_cast<float>(i % 97) / 64;
  }
  return rgba;
}

TEST(WritePictureFileTest, PicturesComeBackAsWritten) {
  const TemporaryFolder folder;
  const std::vector<float> rgba = Pixels();
  for (const std::string name : {"a.exr", "b.tif", "c.TIFF", "a.exr"}) {
    ASSERT_OK(WritePictureFile(folder / name, kWidth, kHeight, rgba));
    const auto input = OIIO::ImageInput::open(folder / name);
    ASSERT_NE(input, nullptr) << OIIO::geterror();
    const OIIO::ImageSpec& spec = input->spec();
    EXPECT_EQ(spec.width, kWidth);
    EXPECT_EQ(spec.height, kHeight);
    EXPECT_EQ(spec.nchannels, 4);
    EXPECT_EQ(spec.alpha_channel, 3);
    EXPECT_EQ(spec.get_int_attribute("oiio:UnassociatedAlpha", 0), 0) << name;
    EXPECT_EQ(spec.format, name[0] == 'a' ? OIIO::TypeDesc::HALF : OIIO::TypeDesc::FLOAT);
    std::vector<float> back(rgba.size());
    ASSERT_TRUE(input->read_image(0, 0, 0, 4, OIIO::TypeDesc::FLOAT, back.data()))
        << input->geterror();
    EXPECT_EQ(back, rgba) << name;
  }
  int files = 0;
  for ([[maybe_unused]] const auto& entry : std::filesystem::directory_iterator(folder.path())) {
    ++files;
  }
  EXPECT_EQ(files, 3);  // no temporary file is left
}

TEST(WritePictureFileTest, TheSamePictureIsTheSameFile) {
  const TemporaryFolder folder;
  for (const std::string format : {".exr", ".tif"}) {
    ASSERT_OK(WritePictureFile(folder / ("one" + format), kWidth, kHeight, Pixels()));
    ASSERT_OK(WritePictureFile(folder / ("two" + format), kWidth, kHeight, Pixels()));
    EXPECT_EQ(testing::ReadFile(folder / ("one" + format)),
              testing::ReadFile(folder / ("two" + format)));
    // Both were written within a second: they must not say when.
    const auto input = OIIO::ImageInput::open(folder / ("one" + format));
    ASSERT_NE(input, nullptr) << OIIO::geterror();
    EXPECT_EQ(input->spec().get_string_attribute("DateTime"), "1970:01:01 00:00:00");
  }
}

TEST(WritePictureFileTest, PicturesMayComeFromThreadsThatEnd) {
  const TemporaryFolder folder;
  for (const std::string name : {"a.exr", "b.exr", "c.exr"}) {
    Status status;
    std::thread writer(
        [&] { status = WritePictureFile(folder / name, kWidth, kHeight, Pixels()); });
    writer.join();
    EXPECT_OK(status);
  }
}

TEST(WritePictureFileTest, WhatCannotBeWrittenIsReported) {
  const TemporaryFolder folder;
  const std::vector<float> rgba = Pixels();
  constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
  EXPECT_THAT(WritePictureFile(folder / "a.gif", kWidth, kHeight, rgba),
              FailsWith(kInvalid, ".exr"));
  EXPECT_THAT(WritePictureFile(folder / "a.exr", kWidth, kHeight - 1, rgba),
              FailsWith(kInvalid, "33 x 16"));
  EXPECT_THAT(WritePictureFile(folder / "a.exr", 0, 0, {}), FailsWith(kInvalid, "0 x 0"));
  EXPECT_THAT(WritePictureFile(folder / "nowhere/a.exr", kWidth, kHeight, rgba),
              FailsWith(absl::StatusCode::kFailedPrecondition, "No such file or directory"));
}

TEST(WritePictureFileTest, AFileThatCannotBeFinishedLeavesNothing) {
  const TemporaryFolder folder;
  const std::vector<float> rgba = Pixels();
  ASSERT_OK(WritePictureFile(folder / "a.exr", kWidth, kHeight, rgba));
  rlimit before{};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &before), 0);
  const rlimit small{200, before.rlim_max};
  ::signal(SIGXFSZ, SIG_IGN);
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &small), 0);
  const Status status = WritePictureFile(folder / "b.exr", kWidth, kHeight, rgba);
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &before), 0);
  EXPECT_THAT(status, FailsWith(absl::StatusCode::kFailedPrecondition, "b.exr': File too large"));
  int files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder.path())) {
    EXPECT_EQ(entry.path().filename(), "a.exr");
    ++files;
  }
  EXPECT_EQ(files, 1);
}

}  // namespace
}  // namespace fovea::ingest
