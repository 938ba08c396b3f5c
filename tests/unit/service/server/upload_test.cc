// Steps of dense voxels through gRPC.

#include "service/wire/upload.h"

#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <gmock/gmock.h>

#include "engine/base/stopwatch.h"
#include "fovea/v1/ingest.grpc.pb.h"
#include "ingest/ingest.h"
#include "service/access/token_file.h"
#include "service/client/client.h"
#include "service/server/upload_stream.h"
#include "tests/unit/service/server/server_test_util.h"

namespace fovea::server {
namespace {

namespace fs = std::filesystem;
using ::fovea::testing::FailsWith;
using ::testing::HasSubstr;

constexpr Int3 kSize{21, 34, 37};  // rows, slices and chunks are cut

std::string BytesOfFile(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

class UploadTest : public ServerFixture {
 protected:
  void SetUp() override {
    ServerFixture::SetUp();
    allow_ingest_ = true;
    StartServer();
    ingest_ = v1::Ingest::NewStub(channel_);
  }

  static v1::UploadStepRequest Header(uint64_t step = 0, const std::string& type = "uint8") {
    v1::UploadStepRequest message;
    v1::UploadHeader& header = *message.mutable_header();
    header.set_dataset("made");
    header.set_step(step);
    header.set_time_ns(static_cast<int64_t>(step) * 1000);
    header.set_nx(static_cast<uint32_t>(kSize.x));
    header.set_ny(static_cast<uint32_t>(kSize.y));
    header.set_nz(static_cast<uint32_t>(kSize.z));
    v1::UploadHeader::Field* field = header.add_fields();
    field->set_name("density");
    field->set_type(type);
    return message;
  }
  static v1::UploadStepRequest Piece(uint64_t offset, const std::string& bytes,
                                     uint32_t field = 0) {
    v1::UploadStepRequest message;
    message.mutable_piece()->set_field(field);
    message.mutable_piece()->set_offset(offset);
    message.mutable_piece()->set_data(bytes);
    return message;
  }
  static std::string Voxels(int64_t value_bytes = 1, int seed = 1) {
    std::string bytes(static_cast<size_t>(kSize.Product() * value_bytes), '\0');
    uint32_t state = static_cast<uint32_t>(seed);
    for (char& byte : bytes) {
      state = state * 1664525 + 1013904223;
      byte = static_cast<char>(state >> 24);
    }
    return bytes;
  }
  /// The header, and the bytes in pieces of so many.
  static std::vector<v1::UploadStepRequest> Messages(const v1::UploadStepRequest& header,
                                                     const std::string& bytes,
                                                     size_t piece_bytes = 1000) {
    std::vector<v1::UploadStepRequest> messages = {header};
    for (size_t at = 0; at < bytes.size(); at += piece_bytes) {
      messages.push_back(Piece(at, bytes.substr(at, piece_bytes)));
    }
    return messages;
  }
  StatusOr<v1::UploadStepResponse> Send(const std::vector<v1::UploadStepRequest>& messages,
                                        const std::string& token = "") {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(60));
    if (!token.empty()) {
      context.AddMetadata("authorization", "Bearer " + token);
    }
    v1::UploadStepResponse response;
    const auto writer = ingest_->UploadStep(&context, &response);
    for (const auto& message : messages) {
      if (!writer->Write(message)) {
        break;
      }
    }
    writer->WritesDone();
    FOVEA_RETURN_IF_ERROR(wire::FromGrpc(writer->Finish()));
    return response;
  }
  [[nodiscard]] std::string Path(const std::string& name) const {
    return Root() + "/" + name + ".zarr";
  }

  /// Uploads what ingest makes a store of, as the store says it is; both must be the same, byte for
  /// byte.
  void ExpectSameStore(const std::string& type, const std::string& bytes, bool lossless,
                       Wavelet wavelet) {
    std::ofstream(folder_.Path("volume.raw"), std::ios::binary) << bytes;
    ingest::IngestOptions options;
    options.inputs = {folder_.Path("volume.raw")};
    options.output = folder_.Path("local_" + type + ".zarr");
    options.raw = ingest::RawFormat{kSize, type};
    options.lossless = lossless;
    options.wavelet = wavelet;
    options.threads = 1;
    ASSERT_OK(ingest::Ingest(options).status());
    ASSERT_OK_AND_ASSIGN(const auto local, store::Dataset::Open(options.output));

    v1::UploadStepRequest header = Header(0, type);
    v1::UploadHeader& said = *header.mutable_header();
    said.set_dataset("up/" + type);
    said.set_time_ns(*local->TimeNs(0));
    if (const auto number = *local->FrameNumber(0)) {
      said.set_frame_number(*number);
    }
    said.set_lossless(lossless);
    said.set_wavelet(std::string(WaveletName(wavelet)));
    said.mutable_series()->set_id(local->info().source->series);
    said.mutable_series()->set_steps(1);
    ASSERT_OK_AND_ASSIGN(const v1::UploadStepResponse response, Send(Messages(header, bytes, 997)));
    EXPECT_EQ(response.outcome(), v1::UploadStepResponse::COMMITTED);
    EXPECT_EQ(response.committed_steps(), 1U);
    size_t files = 0;
    for (const auto& entry : fs::recursive_directory_iterator(options.output)) {
      const std::string name = fs::relative(entry.path(), options.output).string();
      if (entry.is_regular_file() && name != ".fovea.lock") {
        EXPECT_TRUE(BytesOfFile(entry.path().string()) ==
                    BytesOfFile(Path("up/" + type) + "/" + name))
            << type << ": " << name;
        ++files;
      }
    }
    EXPECT_GT(files, 10U);
    size_t sent_files = 0;
    for (const auto& entry : fs::recursive_directory_iterator(Path("up/" + type))) {
      sent_files += entry.is_regular_file() && entry.path().filename() != ".fovea.lock" ? 1 : 0;
    }
    EXPECT_EQ(sent_files, files);
  }

  std::unique_ptr<v1::Ingest::Stub> ingest_;
};

TEST_F(UploadTest, TheStoreIsWhatIngestMakesOfTheSameFile) {
  ExpectSameStore("uint8", Voxels(), /*lossless=*/true, Wavelet::kCdf53);
  ExpectSameStore("int16", Voxels(2), /*lossless=*/false, Wavelet::kHaar);
  std::vector<float> floats(static_cast<size_t>(kSize.Product()));
  for (size_t i = 0; i < floats.size(); ++i) {
    floats[i] = std::sin(static_cast<float>(i) * 0.01F);
  }
  floats[5] = std::numeric_limits<float>::quiet_NaN();
  floats[1234] = -std::numeric_limits<float>::infinity();
  std::string bytes(floats.size() * 4, '\0');
  std::memcpy(bytes.data(), floats.data(), bytes.size());
  ExpectSameStore("float32", bytes, /*lossless=*/false, Wavelet::kCdf97);
  v1::UploadStepRequest header = Header(0, "float32");
  ASSERT_OK_AND_ASSIGN(const v1::UploadStepResponse response,
                       Send(Messages(header, bytes, 50'000)));
  EXPECT_EQ(response.nonfinite_values(), 2U);
}

TEST_F(UploadTest, AStepIsSentAgainAndOnlyTheNextOneIsTaken) {
  ASSERT_OK(Send(Messages(Header(0), Voxels())).status());
  ASSERT_OK(Send(Messages(Header(1), Voxels(1, 2))).status());
  ASSERT_OK_AND_ASSIGN(const v1::UploadStepResponse again, Send(Messages(Header(0), Voxels())));
  EXPECT_EQ(again.outcome(), v1::UploadStepResponse::ALREADY);
  EXPECT_EQ(again.step(), 0U);
  EXPECT_EQ(again.committed_steps(), 2U);
  EXPECT_THAT(Send(Messages(Header(3), Voxels())).status(),
              FailsWith(absl::StatusCode::kFailedPrecondition, "next step of made.zarr is 2"));
  v1::UploadStepRequest other = Header(1);
  other.mutable_header()->set_time_ns(7);
  EXPECT_THAT(Send(Messages(other, Voxels())).status(),
              FailsWith(absl::StatusCode::kFailedPrecondition, "another time"));
  other = Header(2);
  other.mutable_header()->set_nx(22);
  EXPECT_THAT(Send({other}).status(),
              FailsWith(absl::StatusCode::kFailedPrecondition, "its size is 21 x 34 x 37"));
  other = Header(2);
  other.mutable_header()->mutable_fields(0)->set_name("smoke");
  EXPECT_THAT(Send({other}).status(), FailsWith(absl::StatusCode::kFailedPrecondition, "density"));
  other = Header(2);
  other.mutable_header()->set_lossless(true);
  EXPECT_THAT(Send({other}).status(), FailsWith(absl::StatusCode::kFailedPrecondition, "lossless"));
  const auto dataset = store::Dataset::Open(Path("made"));
  ASSERT_OK(dataset.status());
  EXPECT_EQ((*dataset)->info().committed_steps, 2);
}

TEST_F(UploadTest, SeveralFieldsComeOneAfterAnother) {
  v1::UploadStepRequest header = Header();
  v1::UploadHeader::Field* heat = header.mutable_header()->add_fields();
  heat->set_name("heat");
  heat->set_type("int16");
  std::vector<v1::UploadStepRequest> messages = Messages(header, Voxels(), 100'000);
  messages.push_back(Piece(0, Voxels(2), 1));
  ASSERT_OK(Send(messages).status());
  ASSERT_OK_AND_ASSIGN(const auto dataset, store::Dataset::Open(Path("made")));
  ASSERT_OK_AND_ASSIGN(const FieldStats stats, dataset->Stats(0, "heat"));
  EXPECT_LT(stats.minimum, -30'000);
}

TEST_F(UploadTest, WhatIsOutOfTurnIsRefusedAndLeavesNothing) {
  const std::string voxels = Voxels();
  const auto refused = [&](const std::vector<v1::UploadStepRequest>& messages) {
    const Status status = Send(messages).status();
    EXPECT_FALSE(fs::exists(Path("made")));
    return status;
  };
  constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
  EXPECT_THAT(refused({Piece(0, "x")}), FailsWith(kInvalid, "header: is missing"));
  EXPECT_THAT(refused({}), FailsWith(kInvalid, "no message came"));
  EXPECT_THAT(refused({Header(), Header()}), FailsWith(kInvalid, "header: came twice"));
  EXPECT_THAT(refused({Header(), Piece(0, "")}), FailsWith(kInvalid, "piece.data: has 0 bytes"));
  EXPECT_THAT(refused({Header(), Piece(1, "x")}),
              FailsWith(kInvalid, "piece.offset: is 1, where byte 0"));
  EXPECT_THAT(refused({Header(), Piece(0, "x", 1)}),
              FailsWith(kInvalid, "piece.field: is 1, where field 0"));
  EXPECT_THAT(refused({Header(), Piece(0, voxels + "x")}),
              FailsWith(kInvalid, "missing of field 0"));
  EXPECT_THAT(refused({Header(), Piece(0, voxels.substr(1))}),
              FailsWith(kInvalid, "ended 1 bytes before"));
  EXPECT_THAT(refused({Header(), Piece(0, std::string(600'000, 'x'))}),
              FailsWith(kInvalid, "less data"));
  v1::UploadStepRequest header = Header();
  header.mutable_header()->mutable_index_to_world()->Resize(16, 1);
  EXPECT_THAT(refused({header}), FailsWith(kInvalid, "header.index_to_world"));
  header.mutable_header()->mutable_index_to_world()->Resize(15, 1);
  EXPECT_THAT(refused({header}), FailsWith(kInvalid, "header.index_to_world"));
}

TEST_F(UploadTest, SizesAreCheckedBeforeMemoryIsTaken) {
  v1::UploadStepRequest header = Header(0, "float32");
  v1::UploadHeader& said = *header.mutable_header();
  said.set_nx(65536);
  said.set_ny(65536);
  said.set_nz(65536);
  EXPECT_THAT(Send({header}).status(),
              FailsWith(absl::StatusCode::kInvalidArgument, "header.nx: 65536 x 65536 x 65536"));
  said.set_nz(32);
  EXPECT_THAT(Send({header}).status(),
              FailsWith(absl::StatusCode::kResourceExhausted, "--memory-limit"));
  said.set_nz(65537);
  EXPECT_THAT(Send({header}).status(), FailsWith(absl::StatusCode::kInvalidArgument, "header.nz"));
  EXPECT_FALSE(fs::exists(Path("made")));
}

TEST_F(UploadTest, OnlyWhoMayWriteUploadsAndOnlyAsFast) {
  access::Token reader;
  reader.name = "reader";
  reader.digest = access::DigestOf("r");
  access::Token slow;
  slow.name = "slow";
  slow.digest = access::DigestOf("s");
  slow.prefix = "made";
  slow.right = access::Right::kWrite;
  slow.quotas.bytes_in_per_second = 20'000;
  ASSERT_OK(access::WriteTokenFile(folder_.Path("tokens.json"), {reader, slow}));
  StartServer(2, 64, folder_.Path("tokens.json"));
  ingest_ = v1::Ingest::NewStub(channel_);
  EXPECT_THAT(Send({Header()}, "r").status(),
              FailsWith(absl::StatusCode::kPermissionDenied, "reader"));
  v1::UploadStepRequest elsewhere = Header();
  elsewhere.mutable_header()->set_dataset("plume");
  EXPECT_THAT(Send({elsewhere}, "s").status(), FailsWith(absl::StatusCode::kNotFound, "plume"));
  const Stopwatch watch;
  EXPECT_OK(Send(Messages(Header(), Voxels()), "s").status());
  // A second's worth at once, and one message; the rest as it may.
  const double left = static_cast<double>(kSize.Product()) - 20'000 - 1000;
  EXPECT_GT(watch.ElapsedMs(), 1000 * left / 20'000);
}

TEST_F(UploadTest, AClientThatVanishesLetsGoOfItsDataset) {
  {
    grpc::ClientContext context;
    v1::UploadStepResponse response;
    const auto writer = ingest_->UploadStep(&context, &response);
    writer->Write(Header());
    writer->Write(Piece(0, "abc"));
    while (!fs::exists(Path("made") + "/zarr.json")) {  // the server works on it
    }
    EXPECT_THAT(Send({Header()}).status(),
                FailsWith(absl::StatusCode::kFailedPrecondition, "is being written by"));
    context.TryCancel();
    EXPECT_FALSE(writer->Finish().ok());
  }
  Status status;
  do {  // it hears of the end a little later
    status = Send(Messages(Header(), Voxels())).status();
  } while (absl::IsFailedPrecondition(status));
  EXPECT_OK(status);
}

TEST_F(UploadTest, TheClientCutsAStepIntoPieces) {
  ASSERT_OK_AND_ASSIGN(const auto client, client::Client::Connect(server_->address()));
  client::UploadSpec spec;
  spec.dataset = "made";
  spec.dims = {300, 200, 20};
  spec.fields = {{"density", client::UploadSpec::Type::kUint8, "K"}};
  const std::vector<std::byte> voxels(300 * 200 * 20, std::byte{7});
  const auto give = [&](const client::SendVoxels& send) { return send(voxels); };
  ASSERT_OK_AND_ASSIGN(const client::UploadAnswer made, client->UploadStep(spec, give));
  EXPECT_FALSE(made.already);
  EXPECT_EQ(made.committed_steps, 1);
  ASSERT_OK_AND_ASSIGN(const client::UploadAnswer again, client->UploadStep(spec, give));
  EXPECT_TRUE(again.already);
  spec.step = 1;
  EXPECT_THAT(client->UploadStep(spec, [](const auto&) { return DataLoss("no voxels"); }),
              FailsWith(absl::StatusCode::kDataLoss, "no voxels"));
  ASSERT_OK_AND_ASSIGN(const auto dataset, client->GetDataset("made"));
  EXPECT_EQ(dataset.info.fields[0].value_unit, "K");
  EXPECT_EQ(dataset.info.committed_steps, 1);
}

/// A client that says nothing.
struct SilentPeer final : UploadPeer {
  void Read() override { ++reads; }
  void Finish(const Status& status, const v1::UploadStepResponse& /*response*/) override {
    end = status;
  }
  int reads = 0;
  std::optional<Status> end;
};

TEST(UploadStream, ASilentClientIsEnded) {
  store::testing::TemporaryFolder folder;
  fs::create_directories(folder.Path("root"));
  Services services(*Catalogue::Open(folder.Path("root"), std::chrono::milliseconds(0)),
                    *access::Gate::Open(""), INT64_MAX, {}, {}, /*may_write=*/true);
  SilentPeer peer;
  const auto stream = std::make_shared<UploadStream>(services, peer);
  stream->Start(absl::OkStatus(), *services.gate->Identify({}));
  EXPECT_EQ(peer.reads, 1);
  const auto now = UploadStream::Clock::now();
  EXPECT_TRUE(stream->OnTick(now + UploadStream::kMostIdle / 2));
  EXPECT_FALSE(peer.end.has_value());
  stream->OnTick(now + UploadStream::kMostIdle * 2);
  ASSERT_TRUE(peer.end.has_value());
  EXPECT_THAT(*peer.end, FailsWith(absl::StatusCode::kDeadlineExceeded, "nothing came for 30 s"));
  EXPECT_FALSE(stream->OnTick(now));
  EXPECT_EQ(services.live_streams, 0);
}

}  // namespace
}  // namespace fovea::server
