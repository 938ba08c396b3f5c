#include "ingest/step_assembler.h"

#include <sys/socket.h>
#include <unistd.h>

#include <cstdint>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "engine/volume/grid.h"
#include "ingest/channel.h"
#include "tests/support/status_matchers.h"

namespace fovea::ingest {
namespace {

using ::fovea::testing::FailsWith;
constexpr auto kInternal = absl::StatusCode::kInternal;
constexpr int64_t kPlenty = int64_t{1} << 30;
const Box3 kExtent{{-10, 5, 100}, {30, 42, 133}};

Grid Dense(const BrickGrid& voxels) {
  Grid grid(Box3::OfSize(voxels.dims()));
  voxels.CopyOut(grid.box, grid.values);
  return grid;
}

/// A well-formed answer for two fields inside kExtent.
std::vector<Frame> Answer() {
  std::vector<float> values(5 * 6 * 7);
  for (size_t i = 0; i < values.size(); ++i) {
    values[i] = static_cast<float>(i) + 0.5F;
  }
  return {Encode(FieldStart{0, 0, 0}),
          EncodeBlock({{-3, 12, 110}, {2, 18, 117}}, values),
          Encode(Tile{{{10, 10, 110}, {30, 20, 120}}, 4}),
          Encode(FieldEnd{{{-3, 10, 110}, {30, 20, 120}}, 0}),
          Encode(FieldStart{1, 2, -1}),
          Encode(Tile{{{0, 5, 100}, {5, 6, 101}}, 3}),
          Encode(FieldEnd{{}, 5})};
}

TEST(StepAssemblerTest, PutsBlocksAndTilesInTheirPlaces) {
  StepAssembler assembler(kExtent, 16, 2, kPlenty);
  for (const Frame& frame : Answer()) {
    ASSERT_OK(assembler.Consume(frame));
  }
  ASSERT_OK_AND_ASSIGN(const auto fields, assembler.Finish());
  ASSERT_EQ(fields.size(), 2U);
  const Grid first = Dense(fields[0].voxels);
  ASSERT_EQ(first.box.Size(), (Int3{40, 37, 33}));
  for (int64_t z = 0; z < 7; ++z) {
    for (int64_t y = 0; y < 6; ++y) {
      for (int64_t x = 0; x < 5; ++x) {
        EXPECT_EQ(first.At(7 + x, 7 + y, 10 + z), static_cast<float>((z * 6 + y) * 5 + x) + 0.5F);
      }
    }
  }
  EXPECT_EQ(first.At(20, 5, 10), 4);
  EXPECT_EQ(first.At(39, 14, 19), 4);
  EXPECT_EQ(first.At(39, 15, 19), 0);
  EXPECT_EQ(fields[0].active, (Box3{{-3, 10, 110}, {30, 20, 120}}));
  const Grid second = Dense(fields[1].voxels);
  EXPECT_EQ(second.At(0, 0, 0), -1);  // the fill
  EXPECT_EQ(second.At(10, 0, 0), 3);
  EXPECT_EQ(fields[1].rounded, 5U);
  EXPECT_EQ(fields[1].voxels.bricks().size(), 1U);
}

TEST(StepAssemblerTest, NanAndInfinityBecomeTheBackground) {
  StepAssembler assembler(kExtent, 8, 1, kPlenty);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float infinity = std::numeric_limits<float>::infinity();
  ASSERT_OK(assembler.Consume(Encode(FieldStart{0, 2.5F, 0})));
  ASSERT_OK(assembler.Consume(
      EncodeBlock({{0, 5, 100}, {4, 6, 101}}, std::vector<float>{nan, 1, infinity, -infinity})));
  ASSERT_OK(assembler.Consume(Encode(Tile{{{10, 5, 100}, {12, 7, 102}}, nan})));
  ASSERT_OK(assembler.Consume(Encode(FieldEnd{})));
  ASSERT_OK_AND_ASSIGN(const auto fields, assembler.Finish());
  EXPECT_EQ(fields[0].nonfinite, 3U + 8U);
  const Grid grid = Dense(fields[0].voxels);
  EXPECT_EQ(grid.At(10, 0, 0), 2.5F);
  EXPECT_EQ(grid.At(11, 0, 0), 1);
  EXPECT_EQ(grid.At(13, 0, 0), 2.5F);
  EXPECT_EQ(grid.At(21, 1, 1), 2.5F);
}

TEST(StepAssemblerTest, AConstantOfTheFillTakesNoMemoryAndNoTime) {
  // 4096^3 bricks: walking through them would take minutes.
  const Box3 huge{{0, 0, 0}, {65536, 65536, 65536}};
  StepAssembler assembler(huge, 16, 1, kPlenty);
  ASSERT_OK(assembler.Consume(Encode(FieldStart{0, 0, -1})));
  ASSERT_OK(assembler.Consume(Encode(Tile{{{0, 0, 0}, {1, 1, 1}}, 2})));
  ASSERT_OK(assembler.Consume(Encode(Tile{huge, -1})));
  ASSERT_OK(assembler.Consume(Encode(FieldEnd{})));
  ASSERT_OK_AND_ASSIGN(const auto fields, assembler.Finish());
  EXPECT_EQ(fields[0].voxels.bricks().size(), 1U);
  EXPECT_EQ(fields[0].voxels.bricks().begin()->second[0], -1);
}

TEST(StepAssemblerTest, MemoryIsCountedBeforeItIsTaken) {
  const Box3 huge{{0, 0, 0}, {65536, 65536, 65536}};
  StepAssembler assembler(huge, 16, 1, 1 << 20);
  ASSERT_OK(assembler.Consume(Encode(FieldStart{})));
  EXPECT_THAT(assembler.Consume(Encode(Tile{huge, 1})),
              FailsWith(absl::StatusCode::kResourceExhausted, "memory"));
}

TEST(StepAssemblerTest, WhatIsOutOfTurnOrOutsideIsRefused) {
  const auto run = [](const std::vector<Frame>& frames) -> Status {
    StepAssembler assembler(kExtent, 16, 1, kPlenty);
    for (const Frame& frame : frames) {
      FOVEA_RETURN_IF_ERROR(assembler.Consume(frame));
    }
    return assembler.Finish().status();
  };
  const Frame start = Encode(FieldStart{});
  const Frame end = Encode(FieldEnd{});
  EXPECT_OK(run({start, end}));
  EXPECT_THAT(run({}), FailsWith(kInternal, "0 of 1"));
  EXPECT_THAT(run({start}), FailsWith(kInternal, ""));
  EXPECT_THAT(run({end}), FailsWith(kInternal, ""));
  EXPECT_THAT(run({start, start}), FailsWith(kInternal, ""));
  EXPECT_THAT(run({start, end, start, end}), FailsWith(kInternal, "out of turn"));
  EXPECT_THAT(run({Encode(FieldStart{1, 0, 0}), end}), FailsWith(kInternal, "out of turn"));
  EXPECT_THAT(run({Encode(Tile{{{0, 5, 100}, {1, 6, 101}}, 1})}), FailsWith(kInternal, ""));
  EXPECT_THAT(run({start, Encode(Tile{{{0, 5, 100}, {31, 6, 101}}, 1})}),
              FailsWith(kInternal, "outside"));
  EXPECT_THAT(run({start, Encode(Tile{{{0, 4, 100}, {1, 6, 101}}, 1})}),
              FailsWith(kInternal, "outside"));
  EXPECT_THAT(run({start, {FrameKind::kHello, ""}}), FailsWith(kInternal, "kind"));
}

std::string Bytes(const std::vector<Frame>& frames) {
  std::string bytes;
  for (const Frame& frame : frames) {
    const auto kind = static_cast<uint32_t>(frame.kind);
    const auto size = static_cast<uint32_t>(frame.payload.size());
    bytes.append(reinterpret_cast<const char*>(&kind), sizeof(kind));
    bytes.append(reinterpret_cast<const char*>(&size), sizeof(size));
    bytes += frame.payload;
  }
  return bytes;
}

/// What the program does with the bytes of a worker: it must end, with OK or an error.
Status Digest(const std::string& bytes) {
  int sockets[2];
  if (::socketpair(AF_UNIX, SOCK_STREAM, 0, sockets) != 0 ||
      ::send(sockets[1], bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size())) {
    return Internal("socketpair");
  }
  ::close(sockets[1]);
  Channel channel(sockets[0]);
  StepAssembler assembler(kExtent, 16, 2, kPlenty);
  while (true) {
    FOVEA_ASSIGN_OR_RETURN(const FrameView frame, channel.Receive(Channel::kNoDeadline));
    if (frame.kind == FrameKind::kError || frame.kind == FrameKind::kEnd) {
      return frame.kind == FrameKind::kEnd ? assembler.Finish().status() : DecodeError(frame);
    }
    FOVEA_RETURN_IF_ERROR(assembler.Consume(frame));
  }
}

TEST(HostileWorkerTest, MutatedAnswersNeverCrashTheProgram) {
  std::vector<Frame> frames = Answer();
  frames.push_back({FrameKind::kEnd, ""});
  const std::string good = Bytes(frames);
  ASSERT_OK(Digest(good));
  std::mt19937 random(20240607);
  int refused = 0;
  for (int round = 0; round < 4000; ++round) {
    std::string bad = good;
    for (int change = random() % 4; change >= 0; --change) {
      const size_t at = random() % bad.size();
      switch (random() % 4) {
        case 0:
          bad[at] = static_cast<char>(random());
          break;
        case 1:
          bad[at] = static_cast<char>(bad[at] ^ (1 << (random() % 8)));
          break;
        case 2:
          bad.erase(at, random() % 16);
          break;
        default:
          bad.insert(at, std::string(random() % 16, static_cast<char>(random())));
      }
    }
    refused += Digest(bad).ok() ? 0 : 1;
  }
  EXPECT_GT(refused, 1000);
}

TEST(HostileWorkerTest, EveryCutOfAnAnswerIsRefused) {
  std::vector<Frame> frames = Answer();
  frames.push_back({FrameKind::kEnd, ""});
  const std::string good = Bytes(frames);
  for (size_t size = 0; size < good.size(); size += size < 200 ? 1 : 37) {
    EXPECT_FALSE(Digest(good.substr(0, size)).ok()) << size;
  }
}

TEST(HostileWorkerTest, AHugeMessageIsRefusedBeforeItIsAllocated) {
  std::string bytes = Bytes({{FrameKind::kBlock, ""}});
  const uint32_t announced = 0xFFFFFFF0;
  bytes.replace(4, 4, reinterpret_cast<const char*>(&announced), 4);
  EXPECT_THAT(Digest(bytes), FailsWith(kInternal, "bytes announced"));
}

}  // namespace
}  // namespace fovea::ingest
