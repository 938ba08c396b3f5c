// Live readings through gRPC.

#include <atomic>
#include <cmath>
#include <filesystem>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <gmock/gmock.h>

#include "fovea/v1/ingest.grpc.pb.h"
#include "service/access/token_file.h"
#include "tests/unit/service/server/server_test_util.h"

namespace fovea::server {
namespace {

using ::fovea::testing::FailsWith;
using ::testing::HasSubstr;

constexpr int64_t kStep = 100'000'000;  // nanoseconds

class IngestTest : public ServerFixture {
 protected:
  void SetUp() override {
    ServerFixture::SetUp();
    allow_ingest_ = true;
    StartServer();
    ingest_ = v1::Ingest::NewStub(channel_);
  }

  static v1::StreamReadingsRequest Header(const std::string& dataset = "live") {
    v1::StreamReadingsRequest message;
    v1::ReadingsHeader& header = *message.mutable_header();
    header.set_dataset(dataset);
    header.set_step_seconds(0.1);
    for (auto* vec : {header.mutable_lower(), header.mutable_upper(), header.mutable_voxel()}) {
      const double size = vec == &header.lower() ? 0 : vec == &header.upper() ? 32 : 1;
      vec->set_x(size);
      vec->set_y(size);
      vec->set_z(size);
    }
    return message;
  }
  /// A batch of `count` readings of one time, each of this value.
  static v1::StreamReadingsRequest Batch(uint64_t sequence, int64_t time_ns, float value = 1,
                                         int count = 10) {
    v1::StreamReadingsRequest message;
    v1::ReadingBatch& batch = *message.mutable_batch();
    batch.set_sequence(sequence);
    for (int i = 0; i < count; ++i) {
      batch.add_time_ns(time_ns);
      batch.add_x(i % 32 + 0.5);
      batch.add_y(i / 32 % 32 + 0.5);
      batch.add_z(i / 1024 % 32 + 0.5);
      batch.add_value(value);
    }
    return message;
  }
  static v1::StreamReadingsRequest Last(v1::StreamReadingsRequest message) {
    message.mutable_batch()->set_last(true);
    return message;
  }

  /// One call, driven by hand.
  struct Call {
    explicit Call(v1::Ingest::Stub& stub, const std::string& token = "") {
      context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(60));
      if (!token.empty()) {
        context.AddMetadata("authorization", "Bearer " + token);
      }
      stream = stub.StreamReadings(&context);
    }
    void Send(const v1::StreamReadingsRequest& message) { stream->Write(message); }
    /// The next answer in which everything up to `sequence` is acknowledged.
    v1::StreamReadingsResponse ReadUntil(uint64_t sequence) {
      v1::StreamReadingsResponse response;
      do {
        if (!stream->Read(&response)) {
          ADD_FAILURE() << "ended before " << sequence << " was acknowledged";
          break;
        }
      } while (response.acknowledged() < sequence);
      return response;
    }
    /// Whatever comes, up to the end.
    Status End() {
      stream->WritesDone();
      v1::StreamReadingsResponse response;
      while (stream->Read(&response)) {
        last = response;
      }
      return wire::FromGrpc(stream->Finish());
    }
    grpc::ClientContext context;
    std::unique_ptr<grpc::ClientReaderWriter<v1::StreamReadingsRequest, v1::StreamReadingsResponse>>
        stream;
    v1::StreamReadingsResponse last;
  };

  /// How a call of these messages ends.
  Status Send(const std::vector<v1::StreamReadingsRequest>& messages) {
    Call call(*ingest_);
    for (const auto& message : messages) {
      call.Send(message);
    }
    return call.End();
  }
  [[nodiscard]] std::string Path(const std::string& name) const {
    return Root() + "/" + name + ".zarr";
  }
  int64_t StepsOf(const std::string& name) {
    const auto dataset = store::Dataset::Open(Path(name));
    return dataset.ok() ? (*dataset)->info().committed_steps : -1;
  }

  std::unique_ptr<v1::Ingest::Stub> ingest_;
};

TEST_F(IngestTest, ReadingsBecomeStepsAndAcknowledgedOnesAreCommitted) {
  Call call(*ingest_);
  call.Send(Header());
  EXPECT_EQ(call.ReadUntil(0).committed_steps(), 0U);
  EXPECT_EQ(StepsOf("live"), 0);  // there at once, and empty
  for (uint64_t i = 1; i <= 4; ++i) {
    call.Send(Batch(i, static_cast<int64_t>(i) * kStep, static_cast<float>(i)));
    const v1::StreamReadingsResponse response = call.ReadUntil(i - 1);  // the last is still open
    EXPECT_EQ(response.acknowledged(), i - 1);
    EXPECT_EQ(response.committed_steps(), i - 1);
    EXPECT_EQ(StepsOf("live"), static_cast<int64_t>(i - 1));
  }
  call.Send(Last(Batch(5, 5 * kStep, 5)));
  EXPECT_EQ(call.ReadUntil(5).committed_steps(), 5U);
  EXPECT_OK(call.End());
  ASSERT_OK_AND_ASSIGN(const auto dataset, store::Dataset::Open(Path("live")));
  for (int64_t step = 0; step < 5; ++step) {
    ASSERT_OK_AND_ASSIGN(const FieldStats stats, dataset->Stats(step, "value"));
    EXPECT_EQ(stats.minimum, step + 1);
    EXPECT_EQ(stats.maximum, step + 1);
    EXPECT_EQ(*dataset->TimeNs(step), (step + 1) * kStep);
    EXPECT_EQ(*dataset->FrameNumber(step), step + 1);
  }
}

TEST_F(IngestTest, CountsSayWhatBecameOfReadings) {
  Call call(*ingest_);
  v1::StreamReadingsRequest header = Header();
  header.mutable_header()->set_greatest_value(10);
  call.Send(header);
  call.Send(Batch(1, 0, 1, 4));
  call.Send(Batch(2, 0, 2, 2));  // the same places and times
  call.Send(Batch(3, 0, NAN, 3));
  call.Send(Batch(4, 0, 11, 5));
  call.Send(Batch(5, kStep, 1, 1));
  call.Send(Batch(6, 0, 1, 6));  // late
  auto outside = Batch(7, kStep, 1, 1);
  outside.mutable_batch()->set_x(0, -1);
  call.Send(outside);
  call.Send(Batch(8, 5000 * kStep, 1, 2));  // too far ahead
  call.Send(Last(Batch(9, kStep, 1, 0)));
  const v1::ReadingCounts counts = call.ReadUntil(9).counts();
  EXPECT_OK(call.End());
  EXPECT_EQ(counts.read(), 24U);
  EXPECT_EQ(counts.used(), 5U);
  EXPECT_EQ(counts.duplicates(), 2U);
  EXPECT_EQ(counts.not_finite(), 3U);
  EXPECT_EQ(counts.out_of_range(), 5U);
  EXPECT_EQ(counts.late(), 6U);
  EXPECT_EQ(counts.outside(), 1U);
  EXPECT_EQ(counts.ahead(), 2U);
  EXPECT_EQ(counts.pending(), 0U);
}

TEST_F(IngestTest, ReceivedIsAcknowledgedBeforeItIsCommitted) {
  Call call(*ingest_);
  v1::StreamReadingsRequest header = Header();
  header.mutable_header()->set_durability(v1::ReadingsHeader::RECEIVED);
  call.Send(header);
  call.Send(Batch(1, 0));
  const v1::StreamReadingsResponse response = call.ReadUntil(1);
  EXPECT_EQ(response.committed_steps(), 0U);
  EXPECT_EQ(response.counts().pending(), 10U);
  call.Send(Last(Batch(2, 0, 1, 0)));
  EXPECT_OK(call.End());
  EXPECT_EQ(StepsOf("live"), 1);
}

TEST_F(IngestTest, ATimeBeforeWhichAllHasComeCommitsAtOnce) {
  Call call(*ingest_);
  call.Send(Header());
  auto batch = Batch(1, 3 * kStep);
  batch.mutable_batch()->set_complete_before_ns(4 * kStep);
  call.Send(batch);
  EXPECT_EQ(call.ReadUntil(1).committed_steps(), 1U);
  EXPECT_OK(call.End());  // nothing is open, so no batch needs to be the last
}

TEST_F(IngestTest, MessagesThatEndWithoutALastOneDropWhatIsOpen) {
  EXPECT_THAT(Send({Header(), Batch(1, 0), Batch(2, kStep)}),
              FailsWith(absl::StatusCode::kFailedPrecondition, "`last`"));
  EXPECT_EQ(StepsOf("live"), 1);
}

TEST_F(IngestTest, ALostClientGoesOnWhereItsAcknowledgementsEnd) {
  {
    Call call(*ingest_);
    call.Send(Header());
    for (uint64_t i = 1; i <= 3; ++i) {
      call.Send(Batch(i, static_cast<int64_t>(i) * kStep));
    }
    EXPECT_EQ(call.ReadUntil(2).acknowledged(), 2U);
    call.context.TryCancel();
    EXPECT_FALSE(call.End().ok());
  }
  Status status = FailedPrecondition("not tried");
  while (absl::IsFailedPrecondition(status)) {  // until the server has heard of the cancel
    status = Send({Header(), Batch(3, 3 * kStep), Last(Batch(4, 4 * kStep))});
  }
  EXPECT_OK(status);
  EXPECT_EQ(StepsOf("live"), 4);
  // All again: everything is late, nothing counts twice.
  Call again(*ingest_);
  again.Send(Header());
  again.Send(Last(Batch(1, 4 * kStep)));
  EXPECT_EQ(again.ReadUntil(1).counts().late(), 10U);
  EXPECT_OK(again.End());
  EXPECT_EQ(StepsOf("live"), 4);
}

TEST_F(IngestTest, OneWriterAtATime) {
  Call first(*ingest_);
  first.Send(Header());
  first.ReadUntil(0);
  EXPECT_THAT(Send({Header()}), FailsWith(absl::StatusCode::kFailedPrecondition, "writ"));
  first.Send(Last(Batch(1, 0)));
  EXPECT_OK(first.End());
  EXPECT_OK(Send({Header(), Last(Batch(1, kStep))}));  // at the end of a call its lock is free
}

TEST_F(IngestTest, ADatasetWithoutAStepGoesWithItsCall) {
  EXPECT_OK(Send({Header()}));
  EXPECT_FALSE(std::filesystem::exists(Path("live")));
  EXPECT_OK(Send({Header(), Last(Batch(1, 0))}));  // a box that was wrong does no harm
  EXPECT_EQ(StepsOf("live"), 1);
}

TEST_F(IngestTest, AReaderSeesAllOfADatasetThatGoesOrNothing) {
  std::atomic<bool> done = false;
  std::atomic<int> damaged = 0;
  std::thread reader([&] {
    while (!done) {
      damaged += absl::IsDataLoss(store::Dataset::Open(Path("live")).status()) ? 1 : 0;
    }
  });
  for (int i = 0; i < 30; ++i) {
    EXPECT_OK(Send({Header()}));
  }
  done = true;
  reader.join();
  EXPECT_EQ(damaged, 0);
  EXPECT_FALSE(std::filesystem::exists(Path("live")));
}

TEST_F(IngestTest, ADatasetThatIsThereKeepsItsBoxAndFields) {
  ASSERT_OK(Send({Header("lab/deep/live"), Last(Batch(1, 0))}));
  v1::StreamReadingsRequest header = Header("lab/deep/live");
  header.mutable_header()->mutable_upper()->set_x(33);
  EXPECT_THAT(Send({header}), FailsWith(absl::StatusCode::kFailedPrecondition, "another box"));
  header = Header("lab/deep/live");
  header.mutable_header()->add_fields("temperature");
  EXPECT_THAT(Send({header}), FailsWith(absl::StatusCode::kFailedPrecondition, "other fields"));
  header.mutable_header()->Clear();
  header.mutable_header()->set_dataset("lab/deep/live");
  header.mutable_header()->set_step_seconds(0.1);
  EXPECT_OK(Send({header, Last(Batch(1, kStep))}));
  header.mutable_header()->set_dataset("new");
  EXPECT_THAT(Send({header}), FailsWith(absl::StatusCode::kInvalidArgument, "header.voxel"));
  EXPECT_THAT(Send({Header("plume")}),  // voxels of a file, no coverage
              FailsWith(absl::StatusCode::kFailedPrecondition, "readings"));
}

TEST_F(IngestTest, FieldsKeepTheirMeaningWhateverTheirOrder) {
  v1::StreamReadingsRequest header = Header();
  header.mutable_header()->add_fields("wind");
  header.mutable_header()->add_fields("heat");
  auto batch = Last(Batch(1, 0, 1));
  batch.mutable_batch()->clear_value();
  for (int i = 0; i < 10; ++i) {
    batch.mutable_batch()->add_value(3);  // wind
    batch.mutable_batch()->add_value(7);
  }
  EXPECT_OK(Send({header, batch}));
  for (int i = 0; i < 10; ++i) {
    batch.mutable_batch()->set_time_ns(i, kStep);
  }
  EXPECT_OK(Send({header, batch}));  // a store lists its fields by name
  ASSERT_OK_AND_ASSIGN(const auto dataset, store::Dataset::Open(Path("live")));
  for (int64_t step = 0; step < 2; ++step) {
    EXPECT_EQ(dataset->Stats(step, "wind")->maximum, 3);
    EXPECT_EQ(dataset->Stats(step, "heat")->maximum, 7);
  }
}

TEST_F(IngestTest, WrongMessagesNameTheirField) {
  const auto named = [&](const std::vector<v1::StreamReadingsRequest>& messages) {
    const Status status = Send(messages);
    EXPECT_TRUE(absl::IsInvalidArgument(status)) << status;
    return wire::FieldOf(status);
  };
  EXPECT_EQ(named({Batch(1, 0)}), "header");
  EXPECT_EQ(named({v1::StreamReadingsRequest()}), "header");
  EXPECT_EQ(named({Header("../up")}), "header.dataset");
  EXPECT_EQ(named({Header(), Header()}), "header");
  EXPECT_EQ(named({Header(), v1::StreamReadingsRequest()}), "batch");
  EXPECT_EQ(named({Header(), Batch(0, 0)}), "batch.sequence");
  EXPECT_EQ(named({Header(), Batch(1, 0), Batch(3, 0)}), "batch.sequence");
  EXPECT_EQ(named({Header(), Last(Batch(1, 0)), Batch(2, 0)}), "batch.last");
  auto batch = Batch(1, 0);
  batch.mutable_batch()->add_value(1);
  EXPECT_EQ(named({Header(), batch}), "batch.value");
  EXPECT_EQ(named({Header(), Batch(1, 0, 1, 20'000)}), "batch");  // above 512 KiB
}

TEST_F(IngestTest, WatchersAndFollowersSeeEachStep) {
  grpc::ClientContext watching, following;
  v1::WatchDatasetRequest watch;
  watch.set_dataset("live");
  watch.set_wait(true);
  const auto events = datasets_->WatchDataset(&watching, watch);
  v1::DatasetEvent event;
  ASSERT_TRUE(events->Read(&event));
  EXPECT_EQ(event.state(), v1::DatasetEvent::ABSENT);
  Call call(*ingest_);
  call.Send(Header());
  call.ReadUntil(0);
  ASSERT_TRUE(events->Read(&event));
  EXPECT_EQ(event.state(), v1::DatasetEvent::PRESENT);
  call.Send(Batch(1, 0));
  call.Send(Batch(2, kStep));
  ASSERT_TRUE(events->Read(&event));
  EXPECT_EQ(event.committed_steps(), 1U);
  v1::RenderSequenceRequest follow;
  follow.set_dataset("live");
  *follow.mutable_spec() = SmallSpec(v1::PNG, 16);
  follow.set_follow(true);
  const auto frames = render_->RenderSequence(&following, follow);
  v1::Frame frame;
  ASSERT_TRUE(frames->Read(&frame));
  EXPECT_EQ(frame.step(), 0U);
  call.Send(Last(Batch(3, 2 * kStep)));
  while (frame.step() < 2) {
    ASSERT_TRUE(frames->Read(&frame));
  }
  EXPECT_EQ(frame.time_ns(), 2 * kStep);
  EXPECT_OK(call.End());
  watching.TryCancel();
  following.TryCancel();
}

/// Readings that come faster than they can be committed are held back, and all become steps.
TEST_F(IngestTest, AFastClientIsHeldBackAndLosesNothing) {
  constexpr uint64_t kBatches = 30;
  Call call(*ingest_);
  call.Send(Header());
  std::thread writer([&] {
    for (uint64_t i = 1; i <= kBatches; ++i) {
      auto batch = Batch(i, static_cast<int64_t>(i) * kStep, static_cast<float>(i), 1000);
      batch.mutable_batch()->set_last(i == kBatches);
      call.Send(batch);
    }
  });
  const v1::StreamReadingsResponse response = call.ReadUntil(kBatches);
  writer.join();
  EXPECT_EQ(response.committed_steps(), kBatches);
  EXPECT_EQ(response.counts().used(), kBatches * 1000);
  EXPECT_OK(call.End());
}

TEST_F(IngestTest, DrainingEndsAStreamAfterItsCommits) {
  Call call(*ingest_);
  call.Send(Header());
  call.Send(Batch(1, 0));
  call.Send(Batch(2, kStep));
  EXPECT_EQ(call.ReadUntil(1).acknowledged(), 1U);
  EXPECT_EQ(server_->Drain(std::chrono::seconds(30)), 0);
  v1::StreamReadingsResponse response;
  while (call.stream->Read(&response)) {
  }
  EXPECT_THAT(wire::FromGrpc(call.stream->Finish()),
              FailsWith(absl::StatusCode::kUnavailable, "shutting down"));
  EXPECT_EQ(StepsOf("live"), 1);
}

TEST_F(IngestTest, NobodyWritesWhereIngestIsNotAllowed) {
  allow_ingest_ = false;
  StartServer();
  ingest_ = v1::Ingest::NewStub(channel_);
  EXPECT_THAT(Send({Header()}), FailsWith(absl::StatusCode::kPermissionDenied, "--allow-ingest"));
}

TEST_F(IngestTest, TokensDecideWhoWritesWhat) {
  const auto token = [](const std::string& name, access::Right right) {
    access::Token entry;
    entry.name = name;
    entry.digest = access::DigestOf(name);
    entry.prefix = "lab";
    entry.right = right;
    return entry;
  };
  const std::string file = folder_.Path("tokens.json");
  ASSERT_OK(access::WriteTokenFile(
      file, {token("reader", access::Right::kRead), token("writer", access::Right::kWrite)}));
  allow_ingest_ = false;
  StartServer(2, 64, file);
  ingest_ = v1::Ingest::NewStub(channel_);
  const auto as = [&](const std::string& name, const std::string& dataset) {
    Call call(*ingest_, name);
    call.Send(Header(dataset));
    call.Send(Last(Batch(1, 0)));
    return call.End();
  };
  EXPECT_THAT(as("reader", "lab/live"), FailsWith(absl::StatusCode::kPermissionDenied, "write"));
  EXPECT_THAT(as("writer", "live"), FailsWith(absl::StatusCode::kNotFound, "live"));
  EXPECT_FALSE(std::filesystem::exists(Path("live")));
  EXPECT_OK(as("writer", "lab/live"));
}

}  // namespace
}  // namespace fovea::server
