// Bytes that are no request, or nearly one, to every method.

#include <algorithm>
#include <atomic>
#include <fstream>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include <fmt/format.h>
#include <gmock/gmock.h>

#include "fovea/v1/ingest.pb.h"
#include "tests/unit/service/server/good_requests.h"
#include "tests/unit/service/server/raw_call.h"
#include "tests/unit/service/server/server_test_util.h"

namespace fovea::server {
namespace {

using ::fovea::testing::FailsWith;

/// Makes bytes that are a little, or altogether, wrong.
class Mutator {
 public:
  Mutator(std::mt19937_64& random, std::vector<std::string> seeds)
      : random_(random), seeds_(std::move(seeds)) {}

  std::string Mutate(std::string bytes) {
    for (uint64_t times = 1 + Below(3); times > 0; --times) {
      bytes = Once(std::move(bytes));
    }
    return bytes.substr(0, 1 << 20);
  }

 private:
  uint64_t Below(uint64_t end) { return random_() % std::max<uint64_t>(end, 1); }
  size_t Place(const std::string& bytes) { return Below(bytes.size() + 1); }

  std::string Once(std::string bytes) {
    switch (Below(10)) {
      case 0:
      case 1:
        for (uint64_t i = 1 + Below(8); i > 0 && !bytes.empty(); --i) {
          bytes[Below(bytes.size())] ^= static_cast<char>(1U << Below(8));
        }
        return bytes;
      case 2:
        return bytes.substr(0, Place(bytes));
      case 3:
        return bytes.insert(Place(bytes), Random(Below(20)));
      case 4:  // the largest number, and one that is too long
        return bytes.insert(Place(bytes), std::string(Below(2) == 0 ? 9 : 12, '\xFF') + '\x01');
      case 5:
        return bytes.insert(Place(bytes), bytes.substr(Place(bytes), Below(60)));
      case 6: {
        const std::string& other = seeds_[Below(seeds_.size())];
        return bytes.substr(0, Place(bytes)) + other.substr(Place(other));
      }
      case 7: {  // messages in messages, of this field, deeper than protobuf goes
        std::string nested;
        for (uint64_t depth = Below(300); depth > 0 && nested.size() < 60'000; --depth) {
          nested = Field(1 + Below(30), nested);
        }
        return bytes + nested;
      }
      case 8: {  // a field that nobody knows, or one thousands of times
        const bool many = Below(8) == 0;
        const std::string one = Field(1 + Below(many ? 8 : 100), Random(many ? 0 : Below(50)));
        for (uint64_t i = many ? Below(200'000) : 1; i > 0; --i) {
          bytes += one;
        }
        return bytes;
      }
      default:
        return Random(Below(200));
    }
  }
  std::string Random(uint64_t size) {
    std::string bytes(size, '\0');
    std::generate(bytes.begin(), bytes.end(), [this] { return static_cast<char>(random_()); });
    return bytes;
  }
  static std::string Varint(uint64_t number) {
    std::string bytes;
    for (; number >= 0x80; number >>= 7) {
      bytes += static_cast<char>(number | 0x80);
    }
    return bytes + static_cast<char>(number);
  }
  static std::string Field(uint64_t number, const std::string& content) {
    return Varint(number << 3 | 2) + Varint(content.size()) + content;
  }

  std::mt19937_64& random_;
  const std::vector<std::string> seeds_;
};

bool Parses(const GoodRequest& good, const std::string& bytes) {
  const std::unique_ptr<google::protobuf::Message> message(good.messages.front()->New());
  return message->ParseFromString(bytes);
}

/// Largest resident memory of this process so far, in bytes.
int64_t PeakBytes() {
  std::ifstream status("/proc/self/status");
  std::string word;
  int64_t kib = 0;
  while (status >> word && word != "VmHWM:") {
  }
  status >> kib;
  return kib << 10;
}

class FuzzedMessagesTest : public ServerFixture {
 protected:
  void SetUp() override {
    ServerFixture::SetUp();
    allow_ingest_ = keeps_jobs_ = true;
    memory_limit_ = "512MiB";
    StartServer();
  }

  /// A call of mutated messages; some have none, or more than the method takes.
  static RawCall MakeCall(const GoodRequest& good, Mutator& mutator, std::mt19937_64& random) {
    RawCall call;
    call.method = good.Path();
    call.most_replies = 3;
    call.cancel_after = std::chrono::milliseconds(100);  // some wait for what never comes
    for (const auto& message : good.messages) {
      const std::string bytes = message->SerializeAsString();
      call.messages.push_back(random() % 8 == 0 ? bytes : mutator.Mutate(bytes));
    }
    if (good.method->client_streaming()) {
      call.half_close = random() % 2 == 0;
      for (uint64_t more = random() % 4; more > 0; --more) {  // also after the last, or an error
        call.messages.push_back(mutator.Mutate(call.messages.back()));
      }
      std::rotate(call.messages.begin(),
                  call.messages.begin() + static_cast<int64_t>(random() % call.messages.size()),
                  call.messages.end());  // the first one may be missing
    }
    if (random() % 16 == 0) {
      call.messages.clear();
    } else if (random() % 16 == 0) {
      call.messages.push_back(call.messages.back());
    }
    return call;
  }

  void Check(const GoodRequest& good, const RawCall& call) {
    const RawReply reply = Send(channel_, call);
    const std::string what = fmt::format("{}: {}", call.method, reply.status.ToString());
    switch (reply.status.code()) {
      case absl::StatusCode::kUnknown:
      case absl::StatusCode::kUnavailable:
      case absl::StatusCode::kDeadlineExceeded:
      case absl::StatusCode::kAborted:
        ADD_FAILURE() << what;
        break;
      case absl::StatusCode::kInternal:       // gRPC's answers to bytes that are no message, or
      case absl::StatusCode::kUnimplemented:  // none
        EXPECT_FALSE(call.messages.size() == 1 && Parses(good, call.messages.front())) << what;
        break;
      default:
        break;
    }
  }
};

TEST_F(FuzzedMessagesTest, EveryMethodAnswersAnything) {
  constexpr int kThreads = 8, kCallsOfEach = 100;
  const int64_t before = PeakBytes();
  const std::vector<GoodRequest> goods = GoodRequests();
  std::vector<std::string> seeds;
  for (const GoodRequest& good : goods) {
    seeds.push_back(good.messages.back()->SerializeAsString());
  }
  std::atomic<size_t> next = 0;
  std::vector<std::thread> clients;
  for (int i = 0; i < kThreads; ++i) {
    clients.emplace_back([&] {
      for (size_t at = next++; at < goods.size(); at = next++) {
        std::mt19937_64 random(at);
        Mutator mutator(random, seeds);
        for (int k = 0; k < kCallsOfEach; ++k) {
          Check(goods[at], MakeCall(goods[at], mutator, random));
        }
      }
    });
  }
  for (std::thread& client : clients) {
    client.join();
  }
  Flush();  // it still serves
#ifdef FOVEA_SANITIZED  // keeps 256 MiB of what is freed, and shadows all
  constexpr int64_t kMost = int64_t{1} << 30;
#else
  constexpr int64_t kMost = int64_t{512} << 20;
#endif
  EXPECT_LT(PeakBytes() - before, kMost);
  EXPECT_EQ(server_->Drain(std::chrono::seconds(20)), 0) << "calls that never ended";
}

TEST_F(FuzzedMessagesTest, ARequestCountsWithWhatItTakesWhenItIsParsed) {
  RawCall call;
  call.method = "/fovea.v1.Coefficients/StreamCoefficients";
  for (int i = 0; i < 500'000; ++i) {
    call.messages.resize(1);
    call.messages.front() += std::string("\x2A\0", 2);  // `held`, and nothing in it
  }
  // 1 MB of them take 40 of the 32 MiB for requests.
  EXPECT_THAT(Send(channel_, call).status,
              FailsWith(absl::StatusCode::kResourceExhausted, "--memory-limit"));
}

TEST_F(FuzzedMessagesTest, ProtobufWritesToNoLogButOurs) {
  RawCall call;
  call.method = "/fovea.v1.Datasets/GetDataset";
  call.messages = {"\x0A\x01\xFF"};
  ::testing::internal::CaptureStderr();
  EXPECT_FALSE(Send(channel_, call).status.ok());
  EXPECT_THAT(::testing::internal::GetCapturedStderr(),
              ::testing::Not(::testing::HasSubstr("libprotobuf")));
}

TEST_F(FuzzedMessagesTest, APlanOfMoreThanCanBeDrawnIsNotCounted) {
  v1::StreamReadingsRequest header, batch;
  header.mutable_header()->set_dataset("vast");
  header.mutable_header()->set_step_seconds(1);
  header.mutable_header()->mutable_lower();
  for (auto* vec :
       {header.mutable_header()->mutable_upper(), header.mutable_header()->mutable_voxel()}) {
    const double size = vec == &header.header().upper() ? 65536 : 1;
    vec->set_x(size);
    vec->set_y(size);
    vec->set_z(size);
  }
  batch.mutable_batch()->set_sequence(1);
  batch.mutable_batch()->add_time_ns(1);
  batch.mutable_batch()->add_x(5);
  batch.mutable_batch()->add_value(5);
  batch.mutable_batch()->set_last(true);
  RawCall readings;
  readings.method = "/fovea.v1.Ingest/StreamReadings";
  readings.messages = {header.SerializeAsString(), batch.SerializeAsString()};
  readings.most_replies = 9;
  ASSERT_OK(Send(channel_, readings).status);

  v1::PlanFrameRequest request;
  request.set_dataset("vast");
  request.mutable_spec()->set_rate(65536);
  v1::FramePlan plan;
  grpc::ClientContext whole;
  EXPECT_THAT(wire::FromGrpc(render_->PlanFrame(&whole, request, &plan)),
              FailsWith(absl::StatusCode::kResourceExhausted, "super-voxels"));
}

}  // namespace
}  // namespace fovea::server
