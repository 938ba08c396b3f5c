#include "ingest/raw_format.h"

#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"

namespace fovea::ingest {
namespace {

using ::fovea::testing::FailsWith;

TEST(ParseRawFormatTest, ReadsSizeTypeAndOrder) {
  ASSERT_OK_AND_ASSIGN(const RawFormat plain, ParseRawFormat("256x128x225:uint8"));
  EXPECT_EQ(plain, (RawFormat{{256, 128, 225}, "uint8", false, 0, 1}));
  ASSERT_OK_AND_ASSIGN(const RawFormat big, ParseRawFormat("103x94x161:uint16:be"));
  EXPECT_EQ(big, (RawFormat{{103, 94, 161}, "uint16", true, 0, 1}));
  ASSERT_OK_AND_ASSIGN(const RawFormat steps, ParseRawFormat("64x64x21x60:float64:le"));
  EXPECT_EQ(steps, (RawFormat{{64, 64, 21}, "float64", false, 0, 60}));
}

TEST(ParseRawFormatTest, RefusesWhatMakesNoSense) {
  for (const std::string text :
       {"", ":", "256x256x225", "256x256:uint8", "axbxc:uint8", "0x1x1:uint8", "-1x1x1:uint8",
        "1x1x1x0:uint8", "1x1x1:uint9", "1x1x1:uint8:xe", "1x1x1:uint8:le:be", "1x1x1x1x1:uint8",
        "99999999999999999999x1x1:uint8", "65537x1x1:uint8", "1 x1x1:uint8",
        "65536x65536x65536x4611686018427387904:uint8"}) {
    EXPECT_THAT(ParseRawFormat(text), FailsWith(absl::StatusCode::kInvalidArgument, "")) << text;
  }
  EXPECT_THAT(ParseRawFormat("1x1x1:uint9"),
              FailsWith(absl::StatusCode::kInvalidArgument, "float64"));
}

TEST(RawFormatTest, FileSizeIsHeaderAndSteps) {
  const RawFormat format{{2, 3, 4}, "int16", false, 62, 5};
  EXPECT_OK(CheckRawFormat(format));
  EXPECT_EQ(BytesPerFile(format), 62 + 5 * 2 * 3 * 4 * 2);
  EXPECT_EQ(DescribeFileSize(format),
            "62 header bytes + 5 steps x 2 x 3 x 4 voxels x 2 bytes (int16)");
  EXPECT_THAT(CheckRawFormat({{2, 3, 4}, "int16", false, -1, 5}),
              FailsWith(absl::StatusCode::kInvalidArgument, "header"));
}

}  // namespace
}  // namespace fovea::ingest
