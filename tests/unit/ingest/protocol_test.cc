#include "ingest/protocol.h"

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"

namespace fovea::ingest {
namespace {

using ::fovea::testing::FailsWith;
constexpr auto kInternal = absl::StatusCode::kInternal;

TEST(ProtocolTest, RequestsComeBackAsSent) {
  const ReaderHints hints{RawFormat{{3, 4, 5}, "uint16", true, 7, 2}, "red", "zyx", 9};
  ASSERT_OK_AND_ASSIGN(
      const auto scan,
      DecodeScanRequest(Encode(ScanRequest{{"a.raw", "a.raw.json"}, hints, true})));
  EXPECT_EQ(scan.paths, (std::vector<std::string>{"a.raw", "a.raw.json"}));
  EXPECT_EQ(scan.hints, hints);
  EXPECT_TRUE(scan.from_voxels);
  const ReadRequest request{{"b", "c"}, {}, 3, {{-5, 0, 1}, {6, 7, 8}}, {"x", "y[1]"}};
  ASSERT_OK_AND_ASSIGN(const auto read, DecodeReadRequest(Encode(request)));
  EXPECT_EQ(read.paths, request.paths);
  EXPECT_EQ(read.extent, request.extent);
  EXPECT_EQ(read.grids, request.grids);
  EXPECT_EQ(read.step_in_file, 3);
  EXPECT_EQ(read.hints, ReaderHints{});
  ASSERT_OK_AND_ASSIGN(const auto picture,
                       DecodePictureRequest(Encode(PictureRequest{"exr", 9, 8})));
  EXPECT_EQ(picture.format, "exr");
  EXPECT_EQ(picture.height, 8);
}

TEST(ProtocolTest, RepliesComeBackAsSent) {
  const FileInfo file{7, "mm", true, 2, {0.5, 3}, {"a.raw"}, {"odd"}};
  ASSERT_OK_AND_ASSIGN(const FileInfo about, DecodeFileInfo(Encode(file)));
  EXPECT_EQ(about.world_unit, "mm");
  EXPECT_TRUE(about.is_dense);
  EXPECT_EQ(about.times_s, file.times_s);
  EXPECT_EQ(about.needs, file.needs);
  EXPECT_EQ(about.warnings, file.warnings);
  GridInfo grid{"density", "float", "", {{-3, -2, -1}, {4, 5, 6}}, {}, 1234, "K"};
  grid.index_to_world.m[3] = 2.5;
  ASSERT_OK_AND_ASSIGN(const GridInfo back, DecodeGridInfo(Encode(grid)));
  EXPECT_EQ(back.name, grid.name);
  EXPECT_EQ(back.box, grid.box);
  EXPECT_EQ(back.index_to_world, grid.index_to_world);
  EXPECT_EQ(back.declared_bytes, 1234);
  EXPECT_EQ(back.value_unit, "K");
  const std::vector<float> values{1, 2, 3, 4, 5, 6};
  const Frame frame = EncodeBlock({{0, 0, 0}, {1, 2, 3}}, values);
  ASSERT_OK_AND_ASSIGN(const Block block, DecodeBlock(frame));
  EXPECT_EQ(block.values, std::string_view(reinterpret_cast<const char*>(values.data()), 24));
  ASSERT_OK_AND_ASSIGN(const FieldEnd end, DecodeFieldEnd(Encode(FieldEnd{{}, 17})));
  EXPECT_TRUE(end.active.IsEmpty());
  EXPECT_EQ(end.rounded, 17U);
  EXPECT_THAT(DecodeError(EncodeError(NotFound("no grid"))),
              FailsWith(absl::StatusCode::kNotFound, "no grid"));
}

TEST(ProtocolTest, FilesComeInAsManyFramesAsTheyTake) {
  EXPECT_TRUE(EncodeFiles({}).empty());
  std::vector<std::string> paths{"", "a.vdb"};
  for (int i = 0; i < 3000; ++i) {
    paths.push_back(std::to_string(i) + std::string(4000, 'x'));
  }
  std::vector<std::string> back;
  const std::vector<Frame> frames = EncodeFiles(paths);
  for (const Frame& frame : frames) {
    EXPECT_LE(frame.payload.size(), kMaxPayloadBytes);
    ASSERT_OK_AND_ASSIGN(const auto some, DecodeFiles(frame));
    back.insert(back.end(), some.begin(), some.end());
  }
  EXPECT_GT(frames.size(), 1U);
  EXPECT_EQ(back, paths);
  EXPECT_THAT(DecodeFiles(Frame{FrameKind::kFiles, "xyz"}), FailsWith(kInternal, "malformed"));
}

TEST(ProtocolTest, TheGreetingTellsHowTheWorkerIsConfined) {
  ASSERT_OK_AND_ASSIGN(const Hello hello,
                       DecodeHello(Encode(Hello{kProtocolVersion, 7, true, "10.0", "2.4"})));
  EXPECT_EQ(hello.landlock_abi, 7U);
  EXPECT_TRUE(hello.system_calls_filtered);
  EXPECT_EQ(hello.openvdb, "10.0");
  EXPECT_EQ(hello.openimageio, "2.4");
  ASSERT_OK_AND_ASSIGN(const BeginRequest begin, DecodeBeginRequest(Encode(BeginRequest{true})));
  EXPECT_TRUE(begin.pictures);
  // Of another version, the rest of the greeting may be anything.
  EXPECT_THAT(DecodeHello(Frame{FrameKind::kHello, std::string("\1\0\0\0", 4)}),
              FailsWith(absl::StatusCode::kFailedPrecondition, "protocol 1"));
}

TEST(ProtocolTest, ACountThatTheMessageDoesNotHoldTakesNoMemory) {
  // Wherever a count stands, 4 billion are announced, and too few bytes follow for one.
  const FileInfo info;
  const Frame frame = Encode(info);
  for (size_t at = 0; at + 4 <= frame.payload.size(); ++at) {
    Frame hostile = frame;
    hostile.payload.replace(at, 4, "\xFF\xFF\xFF\xFF");
    EXPECT_LT(DecodeFileInfo(hostile).value_or(info).warnings.size(), 10U);
    hostile.payload += "1234567";
    EXPECT_THAT(DecodeFileInfo(hostile), FailsWith(kInternal, "malformed"));
  }
  const Frame scan = Encode(ScanRequest{});
  for (size_t at = 0; at + 4 <= scan.payload.size(); ++at) {
    Frame hostile = scan;
    hostile.payload.replace(at, 4, "\xFF\xFF\xFF\xFF");
    hostile.payload += "1";
    EXPECT_THAT(DecodeScanRequest(hostile), FailsWith(kInternal, "malformed"));
  }
}

TEST(ProtocolTest, AnErrorIsNeverOk) {
  Frame frame = EncodeError(NotFound("x"));
  frame.payload[0] = 0;  // the code of OK
  EXPECT_THAT(DecodeError(frame), FailsWith(kInternal, ""));
  EXPECT_THAT(DecodeError({FrameKind::kError, ""}), FailsWith(kInternal, "malformed"));
}

TEST(ProtocolTest, BoxesMustMakeSense) {
  const auto tile = [](const Box3& box) { return DecodeTile(Encode(Tile{box, 1})).status(); };
  EXPECT_OK(tile({{-2147483648, 0, 0}, {2147483648, 1, 1}}));
  EXPECT_THAT(tile({{0, 0, 0}, {0, 1, 1}}), FailsWith(kInternal, "box"));
  EXPECT_THAT(tile({{5, 0, 0}, {4, 1, 1}}), FailsWith(kInternal, "box"));
  EXPECT_THAT(tile({{0, 0, 0}, {2147483649, 1, 1}}), FailsWith(kInternal, "box"));
  EXPECT_THAT(tile({{std::numeric_limits<int64_t>::min(), 0, 0},
                    {std::numeric_limits<int64_t>::max(), 1, 1}}),
              FailsWith(kInternal, "box"));
}

TEST(ProtocolTest, ABlockHoldsWhatItsBoxSays) {
  const std::vector<float> values(8);
  EXPECT_THAT(DecodeBlock(EncodeBlock({{0, 0, 0}, {2, 2, 3}}, values)), FailsWith(kInternal, ""));
  EXPECT_THAT(DecodeBlock(EncodeBlock({{0, 0, 0}, {2, 2, 1}}, values)), FailsWith(kInternal, ""));
  // A size whose product overflows 64 bits to something small.
  EXPECT_THAT(DecodeBlock(EncodeBlock({{0, 0, 0}, {1 << 30, 1 << 30, 1 << 30}}, values)),
              FailsWith(kInternal, "size of a block"));
}

TEST(ProtocolTest, TransformsMustBeUsable) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const double bad : {nan, std::numeric_limits<double>::infinity(), 0.0}) {
    GridInfo grid;
    grid.index_to_world.m[0] = bad;
    EXPECT_THAT(DecodeGridInfo(Encode(grid)), FailsWith(kInternal, "transform")) << bad;
  }
}

TEST(ProtocolTest, StepsOfAFileMakeSense) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const FileInfo& bad :
       {FileInfo{3, "", true, 0, {}, {}, {}}, FileInfo{3, "", true, -1, {}, {}, {}},
        FileInfo{3, "", true, 1 << 30, {}, {}, {}}, FileInfo{3, "", true, 2, {1.0}, {}, {}},
        FileInfo{3, "", true, 1, {nan}, {}, {}}}) {
    EXPECT_THAT(DecodeFileInfo(Encode(bad)), FailsWith(kInternal, "steps of a file"));
  }
  EXPECT_THAT(DecodeScanRequest(Encode(ScanRequest{})), FailsWith(kInternal, "no file"));
}

TEST(ProtocolTest, BackgroundsAreFinite) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THAT(DecodeFieldStart(Encode(FieldStart{0, nan, 0})), FailsWith(kInternal, "background"));
  EXPECT_THAT(DecodeFieldStart(Encode(FieldStart{0, 0, nan})), FailsWith(kInternal, "background"));
}

TEST(ProtocolTest, EveryCutAndEveryExtensionIsRefused) {
  const std::vector<float> values(8, 1.0F);
  const GridInfo grid{"density", "float", "none", {{0, 0, 0}, {1, 1, 1}}, {}, 1};
  const std::vector<Frame> frames{Encode(ScanRequest{{"a"}, {RawFormat{}, "", "", 0}, false}),
                                  Encode(ReadRequest{{"a"}, {}, 0, {{0, 0, 0}, {1, 1, 1}}, {"g"}}),
                                  Encode(FileInfo{3, "m", true, 1, {2.0}, {"n"}, {"w"}}),
                                  Encode(grid),
                                  Encode(FieldStart{0, 1, 2}),
                                  Encode(FieldEnd{{{0, 0, 0}, {1, 1, 1}}, 0}),
                                  EncodeBlock({{0, 0, 0}, {2, 2, 2}}, values),
                                  Encode(Tile{{{0, 0, 0}, {1, 1, 1}}, 1})};
  const auto decode = [](const Frame& frame) -> Status {
    switch (frame.kind) {
      case FrameKind::kScan:
        return DecodeScanRequest(frame).status();
      case FrameKind::kRead:
        return DecodeReadRequest(frame).status();
      case FrameKind::kFile:
        return DecodeFileInfo(frame).status();
      case FrameKind::kGrid:
        return DecodeGridInfo(frame).status();
      case FrameKind::kField:
        return DecodeFieldStart(frame).status();
      case FrameKind::kFieldEnd:
        return DecodeFieldEnd(frame).status();
      case FrameKind::kBlock:
        return DecodeBlock(frame).status();
      default:
        return DecodeTile(frame).status();
    }
  };
  for (const Frame& frame : frames) {
    EXPECT_OK(decode(frame));
    for (size_t size = 0; size < frame.payload.size(); ++size) {
      EXPECT_FALSE(decode({frame.kind, frame.payload.substr(0, size)}).ok()) << size;
    }
    EXPECT_FALSE(decode({frame.kind, frame.payload + "x"}).ok());
  }
}

TEST(PrintableTest, KeepsTextAndReplacesWhatCouldHarmATerminal) {
  EXPECT_EQ(Printable("Dichte \xC3\xBC \xE2\x82\xAC \xF0\x9F\x98\x80"),
            "Dichte \xC3\xBC \xE2\x82\xAC \xF0\x9F\x98\x80");
  EXPECT_EQ(Printable("a\x1B[2Jb\n\x7F"), "a?[2Jb??");
  EXPECT_EQ(Printable("\xC3"), "?");                 // cut short
  EXPECT_EQ(Printable("\xC0\x80"), "??");            // overlong
  EXPECT_EQ(Printable("\xED\xA0\x80"), "???");       // a surrogate
  EXPECT_EQ(Printable("\xF4\x90\x80\x80"), "????");  // beyond Unicode
  EXPECT_EQ(Printable("\xC2\x9B"), "?");             // a control character of two bytes
  EXPECT_LE(Printable(std::string(5000, 'x')).size(), 1000U);
}

}  // namespace
}  // namespace fovea::ingest
