// The parsers of headers, as functions of bytes: what whole files show is in
// tests/system/cli/readers_test.py.

#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "ingest/worker/headers/metaimage.h"
#include "ingest/worker/headers/npy.h"
#include "ingest/worker/headers/nrrd.h"
#include "ingest/worker/headers/sidecar.h"
#include "ingest/worker/headers/text.h"
#include "tests/support/status_matchers.h"

namespace fovea::ingest {
namespace {

using ::fovea::testing::FailsWith;
using ::testing::ElementsAre;
constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

constexpr char kNrrd[] =
    "NRRD0004\r\n# comment\r\ntype: unsigned short\r\ndimension: 4\r\nsizes: 3 5 4 2\r\n"
    "kinds: RGB-color domain domain domain\r\nspacings: nan 2 3 4\r\naxis mins: nan 10 20 30\r\n"
    "centers: none cell node cell\r\nendian: big\r\nencoding: raw\r\n\r\n";

constexpr char kMeta[] =
    "NDims = 2\nDimSize = 5 4\nElementNumberOfChannels = 3\nElementType = MET_FLOAT\n"
    "ElementDataFile = s%02d.raw 1 3 2\n";

std::string Npy(const std::string& dictionary) {
  std::string bytes("\x93NUMPY\x01\0", 8);
  bytes += static_cast<char>(dictionary.size());
  return bytes + '\0' + dictionary;
}

TEST(NrrdTest, AxesHaveRolesAndCellsBeginAtTheirMins) {
  ASSERT_OK_AND_ASSIGN(const DenseHeader header, ParseNrrd(std::string(kNrrd) + "data"));
  EXPECT_THAT(header.axes, ElementsAre(DenseAxis{AxisRole::kChannel, 3}, DenseAxis{AxisRole::kX, 5},
                                       DenseAxis{AxisRole::kY, 4}, DenseAxis{AxisRole::kZ, 2}));
  EXPECT_EQ(header.type, SampleType::kUint16);
  EXPECT_TRUE(header.big_endian);
  EXPECT_EQ(header.data_offset, static_cast<int64_t>(sizeof(kNrrd)) - 1);
  EXPECT_EQ(header.StrideOf(AxisRole::kY), 15);
  EXPECT_FALSE(header.IsInOrder());
  // Centres: of a cell half a voxel beyond its min, of a node at it.
  EXPECT_EQ(header.index_to_world.TransformPoint({0, 0, 0}), (Vec3{11, 20, 32}));
  EXPECT_EQ(header.index_to_world.Spacing(), (Vec3{2, 3, 4}));
}

TEST(NrrdTest, NumberedDataFiles) {
  EXPECT_THAT(*NumberedNames("a%03d.raw", 8, 10, 1),
              ElementsAre("a008.raw", "a009.raw", "a010.raw"));
  EXPECT_THAT(*NumberedNames("%d", 3, 1, -1), ElementsAre("3", "2", "1"));
  for (const char* bad : {"a.raw", "%s", "%d%d", "%00009d", "%"}) {
    EXPECT_THAT(NumberedNames(bad, 1, 2, 1), FailsWith(kInvalid, "number such as"));
  }
  EXPECT_THAT(NumberedNames("%d", 1, 1 << 20, 1), FailsWith(kInvalid, "files can be"));
  EXPECT_THAT(NumberedNames("%d", 1, 2, 0), FailsWith(kInvalid, "files can be"));
  EXPECT_THAT(NumberedNames("%d", 2, 1, 1), FailsWith(kInvalid, "files can be"));
}

TEST(MetaImageTest, PlanesAndChannels) {
  ASSERT_OK_AND_ASSIGN(const DenseHeader header, ParseMetaImage(kMeta));
  EXPECT_EQ(header.Dims(), (Int3{5, 4, 1}));
  EXPECT_EQ(header.SizeOf(AxisRole::kChannel), 3);
  EXPECT_THAT(header.data_files, ElementsAre("s01.raw", "s03.raw"));
  EXPECT_THAT(ParseMetaImage("NDims = 3\nDimSize = 1 2 3\nElementType = MET_UCHAR\n"
                             "BinaryData = False\nElementDataFile = LOCAL\n"),
              FailsWith(kInvalid, "as text"));
}

TEST(NpyTest, LiteralsInAnyOrderAndSpacing) {
  ASSERT_OK_AND_ASSIGN(
      const DenseHeader header,
      ParseNpy(Npy("{\"shape\":(3 , 4,), 'fortran_order' : True,'descr':'>f8'}  \n"), ""));
  EXPECT_THAT(header.axes, ElementsAre(DenseAxis{AxisRole::kY, 3}, DenseAxis{AxisRole::kX, 4}));
  EXPECT_TRUE(header.big_endian);
  const auto parse = [](const std::string& text) { return ParseNpy(Npy(text), ""); };
  EXPECT_THAT(parse("{'descr': '<c8', 'fortran_order': False, 'shape': (2,)}"),
              FailsWith(kInvalid, "dtype '<c8'"));
  EXPECT_THAT(parse("{'descr': [('a', '<f4')], 'fortran_order': False, 'shape': (2,)}"),
              FailsWith(kInvalid, "dtype"));
  EXPECT_THAT(parse("{'descr': '<f4', 'fortran_order': False, 'shape': ()}"),
              FailsWith(kInvalid, "0 axes"));
  EXPECT_THAT(parse("{'descr': '<f4', 'fortran_order': False, 'shape': (-1, 2)}"),
              FailsWith(kInvalid, "1 to 65536"));
  EXPECT_THAT(parse("{'descr': '<f4', 'fortran_order': False}"), FailsWith(kInvalid, "'shape'"));
  EXPECT_THAT(ParseNpy(Npy("{'descr': '<f4', 'fortran_order': False, 'shape': (1, 2)}"), "xx"),
              FailsWith(kInvalid, "mean the same"));
}

/// Every cut of a header, and every byte of it replaced, is a header or an error.
TEST(HeadersTest, NothingThatIsCutOrChangedCrashes) {
  const std::vector<std::pair<std::string, int>> headers{
      {kNrrd, 0},
      {kMeta, 1},
      {Npy("{'descr': '<f4', 'fortran_order': False, 'shape': (1, 2)}"), 2},
      {R"({"dims_xyz": [1, 2, 3], "type": "uint8", "times_s": [1]})", 3}};
  const auto parse = [](const std::string& bytes, int kind) -> Status {
    return kind == 0   ? ParseNrrd(bytes).status()
           : kind == 1 ? ParseMetaImage(bytes).status()
           : kind == 2 ? ParseNpy(bytes, "").status()
                       : ParseSidecar(bytes).status();
  };
  for (const auto& [bytes, kind] : headers) {
    EXPECT_OK(parse(bytes, kind));
    for (size_t i = 0; i < bytes.size(); ++i) {
      const Status cut = parse(bytes.substr(0, i), kind);
      EXPECT_FALSE(cut.ok() && i < bytes.size() / 2) << kind << " " << i;
      for (const char c : {'\0', '\n', '(', '9', '-', '%', '\xFF'}) {
        std::string changed = bytes;
        changed[i] = c;
        EXPECT_NE(parse(changed, kind).code(), absl::StatusCode::kInternal);
      }
    }
  }
}

}  // namespace
}  // namespace fovea::ingest
