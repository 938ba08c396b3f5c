// The bytes of a FOVEATED frame, docs/formats/foveated-frame.md, and what is made of damaged ones.
#include "service/frames/foveated_codec.h"

#include <cmath>
#include <cstring>
#include <limits>
#include <string>
#include <vector>

#include "engine/render/leaf_scale.h"
#include "service/frames/deflate.h"
#include "tests/support/status_matchers.h"

namespace fovea::frames {
namespace {

using ::fovea::testing::FailsWith;
using render::FrameLevel;
using render::PixelKind;
using render::Rgba;

/// Two pixels two voxels wide, of which the left one is split.
std::vector<FrameLevel> TinyLevels() {
  FrameLevel coarse;
  coarse.width = 2;
  coarse.rect = {-1, 1, 0, 1};
  coarse.crossing = {0, 1, 0, 1};
  coarse.void_u0 = coarse.void_v0 = coarse.void_v1 = false;
  coarse.kinds = {PixelKind::kSplit, PixelKind::kLeaf};
  coarse.values = {{9, 9, 9, 9}, {0.25F, 0.5F, 1.0F, 1.0F}};
  FrameLevel fine;
  fine.width = 1;
  fine.rect = {-2, 0, 0, 2};
  fine.kinds.assign(4, PixelKind::kLeaf);
  fine.values = {{0, 0, 0, 0}, {0.1F, 0.1F, 0.1F, 0.5F}, {0.5F, 0.25F, 0, 0.75F}, {2, 0, 0, 1}};
  return {coarse, fine};
}

FoveatedPicture TinyPicture() {
  render::FoveatedFrame frame;
  frame.levels = TinyLevels();
  frame.sheet = {-2, 2, 0, 2};
  frame.warp = {0.5, 0, -1.75, 0, 0.5, 0.25};
  frame.width_px = 8;
  frame.height_px = 4;
  FoveatedPicture picture;
  picture.frame = std::move(frame);
  picture.background = {0, 0.5F, 1};
  picture.marker = {2.5, 1.5};
  return picture;
}

FoveatedPicture TinyPerspective() {
  render::PerspectiveFrame frame;
  frame.pinhole = {{-5, 1, 1}, {1, -0.25, -0.25}, {0, 0.125, 0}, {0, 0, 0.125}, 5, 4};
  render::FaceFrame face;
  face.face.eye = frame.pinhole.eye;
  face.face.axis_k = 0;
  face.face.axis_u = 1;
  face.face.axis_v = 2;
  face.face.reference_z = 1;
  face.face.common_path = 1.25;
  face.face.world_u = {0, 1, 0};
  face.face.world_v = {0, 0, 1};
  face.face.world_k = {1, 0, 0};
  face.sheet = {-2, 2, 0, 2};
  face.levels = TinyLevels();
  frame.faces.push_back(face);
  FoveatedPicture picture;
  picture.frame = std::move(frame);
  picture.smoothing = render::Smoothing::kNone;
  picture.basis = render::Basis::kBspline;
  return picture;
}

std::string Bytes(const FoveatedPicture& picture) {
  return EncodeFoveated(picture).value();
}

/// With a checksum that holds.
std::string Sealed(std::string bytes) {
  const uint32_t crc = Crc32(bytes.substr(0, bytes.size() - 4));
  std::memcpy(bytes.data() + bytes.size() - 4, &crc, sizeof(crc));
  return bytes;
}

std::string FromHex(const std::string& text) {
  std::string bytes;
  for (size_t i = 0; i + 1 < text.size(); i += 2) {
    bytes.push_back(static_cast<char>(std::stoi(text.substr(i, 2), nullptr, 16)));
  }
  return bytes;
}

std::string ToHex(const std::string& bytes) {
  std::string text;
  for (const char byte : bytes) {
    text += fmt::format("{:02x}", static_cast<uint8_t>(byte));
  }
  return text;
}

// As the page says, by hand, but for the zlib stream, which another zlib may write differently: the
// bytes in it are the next constant.
const std::string kTinyHead =
    "46564652"
    "01"
    "00"
    "02"
    "00"
    "0b"
    "01"
    "01"
    "00"
    "08000000"
    "04000000"
    "00000000"
    "0000003f"
    "0000803f"
    "0000000000000440"
    "000000000000f83f"
    // m0 to m5
    "000000000000e03f"
    "0000000000000000"
    "000000000000fcbf"
    "0000000000000000"
    "000000000000e03f"
    "000000000000d03f"
    // sheet, two levels, two voxels wide
    "feffffff"
    "02000000"
    "00000000"
    "02000000"
    "02"
    "01"
    "000000000000"
    "ffffffff"
    "01000000"
    "00000000"
    "01000000"
    "00000000"
    "01000000"
    "00000000"
    "01000000"
    "02"
    "000000"
    "feffffff"
    "00000000"
    "00000000"
    "02000000"
    "00000000"
    "00000000"
    "00000000"
    "00000000"
    "0f"
    "000000";

// Kinds: split, leaf. Then the five leaves as numbers (red, green, blue, transmittance), as
// differences d, and what predicts them, p:
//   1024 1448 2048    0   d -424 1448   600    0   p 0 0 0 0: alone on its level
//      0    0    0 2048   d    0    0     0 2048   p 0 0 0 0
//    648  648  648 1448   d    0  648     0 1448   p 0 0 0 2048: to the left
//   1448 1024    0 1024   d  424 1024 -1024 1024   p 0 0 0 2048: above
//   2896    0    0    0   d 2896    0     0    0   p 424 1024 -1024 1024: left, above and corner
// Residuals d - p, folded, in hexadecimal: 034f 0b50 04b0 0000, 0000 0000 0000 1000,
// 0000 0510 0000 04af, 0350 0800 07ff 07ff, 1350 07ff 0800 07ff.
const std::string kTinyStream =
    "0100"
    "0300000313"
    "0b00050807"
    "0400000708"
    "0010040707"
    "4f00005050"
    "50001000ff"
    "b00000ff00"
    "0000afffff";

TEST(FoveatedCodecTest, TheBytesOfATinyFrame) {
  const std::string bytes = Bytes(TinyPicture());
  const std::string head = FromHex(kTinyHead);
  const std::string raw = FromHex(kTinyStream);
  EXPECT_EQ(ToHex(bytes.substr(0, head.size())), kTinyHead);
  const std::string stream = bytes.substr(head.size(), bytes.size() - head.size() - 4);
  ASSERT_OK_AND_ASSIGN(Inflater inflater, Inflater::Make(stream));
  std::string inflated(raw.size(), '\0');
  ASSERT_OK(inflater.Read({reinterpret_cast<uint8_t*>(inflated.data()), inflated.size()}));
  EXPECT_OK(inflater.Finish());
  EXPECT_EQ(ToHex(inflated), kTinyStream);
  EXPECT_EQ(ToHex(Sealed(bytes)), ToHex(bytes));
}

TEST(FoveatedCodecTest, WhatWasEncodedComesBackRounded) {
  for (const int bits : {render::kLeastLeafBits, render::kLeafBits, render::kMostLeafBits}) {
    for (const FoveatedPicture& sent : {TinyPicture(), TinyPerspective()}) {
      ASSERT_OK_AND_ASSIGN(const std::string bytes, EncodeFoveated(sent, bits));
      ASSERT_OK_AND_ASSIGN(const FoveatedPicture got, DecodeFoveated(bytes));
      EXPECT_EQ(got.width_px(), sent.width_px());
      EXPECT_EQ(got.height_px(), sent.height_px());
      EXPECT_EQ(got.smoothing, sent.smoothing);
      EXPECT_EQ(got.basis, sent.basis);
      EXPECT_EQ(got.marker, sent.marker);
      EXPECT_EQ(got.background.green, sent.background.green);
      const auto* flat = std::get_if<render::FoveatedFrame>(&got.frame);
      const std::vector<FrameLevel>& levels =
          flat != nullptr ? flat->levels
                          : std::get<render::PerspectiveFrame>(got.frame).faces[0].levels;
      const std::vector<FrameLevel> expected = TinyLevels();
      ASSERT_EQ(levels.size(), expected.size());
      for (size_t l = 0; l < levels.size(); ++l) {
        EXPECT_EQ(levels[l].width, expected[l].width);
        EXPECT_EQ(levels[l].rect, expected[l].rect);
        EXPECT_EQ(levels[l].crossing, expected[l].crossing);
        EXPECT_EQ(levels[l].void_u0, expected[l].void_u0);
        EXPECT_EQ(levels[l].void_u1, expected[l].void_u1);
        EXPECT_EQ(levels[l].void_v0, expected[l].void_v0);
        EXPECT_EQ(levels[l].void_v1, expected[l].void_v1);
        EXPECT_EQ(levels[l].kinds, expected[l].kinds);
        for (size_t i = 0; i < levels[l].kinds.size(); ++i) {
          if (levels[l].kinds[i] == PixelKind::kLeaf) {
            const Rgba rounded =
                render::FromNumbers(render::ToNumbers(expected[l].values[i], bits), bits);
            EXPECT_EQ(std::memcmp(&levels[l].values[i], &rounded, sizeof(Rgba)), 0);
            EXPECT_NEAR(rounded.red, expected[l].values[i].red, 1.5 * std::ldexp(1.0, -bits));
          }
        }
      }
    }
  }
}

TEST(FoveatedCodecTest, NumbersStayWhatTheyAre) {
  for (int bits = render::kLeastLeafBits; bits <= render::kMostLeafBits; ++bits) {
    for (int32_t q = 0; q <= render::kMostLeafNumber; ++q) {
      const render::LeafNumbers sent{q, q, q, std::min(q, 1 << bits)};
      const render::LeafNumbers got = render::ToNumbers(render::FromNumbers(sent, bits), bits);
      ASSERT_EQ(got.red, q);
      ASSERT_EQ(got.transmittance, sent.transmittance);
    }
  }
}

TEST(FoveatedCodecTest, ACrossingFarOutsideContainsTheSamePixels) {
  FoveatedPicture picture = TinyPerspective();
  auto& levels = std::get<render::PerspectiveFrame>(picture.frame).faces[0].levels;
  levels[0].crossing = {int64_t{5} << 40, 0, -(int64_t{1} << 33), 1};
  levels[1].crossing = {-(int64_t{1} << 33), -1, 0, int64_t{1} << 21};
  const auto got = DecodeFoveated(Bytes(picture));
  ASSERT_OK(got.status());
  const auto& came = std::get<render::PerspectiveFrame>(got->frame).faces[0].levels;
  for (size_t l = 0; l < levels.size(); ++l) {
    for (int64_t u = -9; u < 9; ++u) {
      for (int64_t v = -9; v < 9; ++v) {
        EXPECT_EQ(came[l].crossing.Contains(u, v), levels[l].crossing.Contains(u, v));
      }
    }
  }
}

TEST(FoveatedCodecTest, ValuesOutOfRangeAreHeldToIt) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float inf = std::numeric_limits<float>::infinity();
  const render::LeafNumbers n = render::ToNumbers({nan, -1, inf, nan}, 11);
  EXPECT_EQ(n.red, 0);
  EXPECT_EQ(n.green, 0);
  EXPECT_EQ(n.blue, render::kMostLeafNumber);
  EXPECT_EQ(n.transmittance, 0);
  EXPECT_EQ(render::ToNumbers({0, 0, 0, -0.5F}, 11).transmittance, 2048);
}

TEST(FoveatedCodecTest, EveryTruncationAndBitFlipIsAnError) {
  for (const FoveatedPicture& picture : {TinyPicture(), TinyPerspective()}) {
    const std::string bytes = Bytes(picture);
    for (size_t size = 0; size < bytes.size(); ++size) {
      EXPECT_THAT(DecodeFoveated(bytes.substr(0, size)),
                  FailsWith(absl::StatusCode::kDataLoss, "FOVEATED"));
    }
    for (size_t bit = 0; bit < 8 * bytes.size(); ++bit) {
      std::string damaged = bytes;
      damaged[bit / 8] = static_cast<char>(damaged[bit / 8] ^ (1 << (bit % 8)));
      EXPECT_THAT(DecodeFoveated(damaged), FailsWith(absl::StatusCode::kDataLoss, "FOVEATED"));
    }
    EXPECT_FALSE(DecodeFoveated(bytes + '\0').ok());
  }
}

/// What a checksum cannot find: whoever wrote the bytes meant them.
TEST(FoveatedCodecTest, WhatIsMeantToHarmIsAnErrorOrAPicture) {
  int pictures = 0;
  int errors = 0;
  for (const FoveatedPicture& picture : {TinyPicture(), TinyPerspective()}) {
    const std::string bytes = Bytes(picture);
    const auto use = [&](const std::string& damaged) {
      const auto got = DecodeFoveated(damaged);
      if (got.ok() && got->width_px() <= 64 && got->height_px() <= 64) {
        (void)ExpandImage(*got, 1);
        ++pictures;
      } else {
        ++errors;
      }
    };
    for (size_t at = 0; at < bytes.size(); ++at) {
      for (const int value : {0, 1, 2, 0x7f, 0x80, 0xff}) {
        std::string damaged = bytes;
        damaged[at] = static_cast<char>(value);
        use(Sealed(damaged));
      }
    }
    for (size_t size = 5; size < bytes.size(); ++size) {
      use(Sealed(bytes.substr(0, size)));
    }
  }
  EXPECT_GT(pictures, 100);
  EXPECT_GT(errors, 100);
}

TEST(FoveatedCodecTest, NamesWhatIsWrong) {
  const std::string bytes = Bytes(TinyPicture());
  const auto with = [&](size_t at, const std::string& replacement) {
    std::string changed = bytes;
    changed.replace(at, replacement.size(), replacement);
    return Sealed(changed);
  };
  const auto fails = [](const std::string& text) {
    return FailsWith(absl::StatusCode::kDataLoss, text);
  };
  EXPECT_THAT(DecodeFoveated(""), fails("does not begin like one"));
  EXPECT_THAT(DecodeFoveated(with(4, "\x02")), fails("version 2 is not known here, 1 is"));
  std::string flipped = bytes;
  flipped[20] ^= 1;
  EXPECT_THAT(DecodeFoveated(flipped), fails("checksum"));
  EXPECT_THAT(DecodeFoveated(with(8, "\x0f")), fails("outside its range"));
  EXPECT_THAT(DecodeFoveated(with(8, "\x04")), fails("leaf value"));  // 2048 where 16 is whole
  EXPECT_THAT(DecodeFoveated(with(11, "\x01")), fails("outside its range"));  // padding
  // The last level, a row shorter: a split pixel's children are not all in it.
  EXPECT_THAT(DecodeFoveated(with(48 + 48 + 24 + 36 + 12, "\x01")), fails("children outside"));
  // A level of 2^20 x 2^20 pixels in a few bytes.
  EXPECT_THAT(DecodeFoveated(with(48 + 48 + 24 + 36, std::string("\0\0\xf0\xff\0\0\x10\0"
                                                                 "\0\0\xf0\xff\0\0\x10\0",
                                                                 16))),
              fails("more than a frame may have"));
}

TEST(FoveatedCodecTest, RefusesAPyramidThatNoFrameMayHave) {
  FoveatedPicture picture = TinyPicture();
  FrameLevel& level = std::get<render::FoveatedFrame>(picture.frame).levels[1];
  level.rect = {-2, 4094, 0, 4096};
  level.kinds.assign(size_t{4096} * 4096, PixelKind::kAbsent);
  level.values.resize(level.kinds.size());
  for (const size_t at : {0, 1, 4096, 4097}) {
    level.kinds[at] = PixelKind::kLeaf;
  }
  EXPECT_THAT(EncodeFoveated(picture),
              FailsWith(absl::StatusCode::kResourceExhausted, "ask for a lower rate"));
}

}  // namespace
}  // namespace fovea::frames
