#include "service/client/local_renderer.h"

#include <cmath>
#include <filesystem>
#include <random>
#include <vector>

#include <gmock/gmock.h>

#include "engine/wavelet/haar.h"
#include "service/client/client.h"
#include "service/coefficients/block.h"
#include "tests/unit/service/server/server_test_util.h"

namespace fovea::client {
namespace {

using ::fovea::testing::FailsWith;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr Int3 kOdd{70, 61, 53};
constexpr int64_t kOddSteps = 3;

/// Coefficients that a field of this type and these scales can hold.
void Fit(const store::FieldInfo& field, CoefficientSet* set) {
  const auto fit = [&](float scale, std::vector<float>* values) {
    for (float& value : *values) {
      value = std::nearbyint(value / scale) * scale;
    }
  };
  if (field.scales.empty() && store::IsIntegerType(field.type)) {
    set->basis.integer = true;
    fit(1, &set->coarse.values);
  }
  for (size_t level = 0; level < set->detail.size(); ++level) {
    const float scale = field.scales.empty() ? 1 : field.scales[level];
    if (store::IsIntegerType(field.type)) {
      const BrickGrid before = set->detail[level];
      for (const auto& [at, brick] : before.bricks()) {
        fit(scale, &set->detail[level].Touch({at[2], at[1], at[0]}));
      }
    }
  }
}

/// A store whose field is of this type; quantised if there are scales.
Status MakeTyped(const std::string& path, const std::string& type, std::vector<float> scales) {
  store::DatasetInfo info = store::testing::MakeInfo(kOdd, 16);
  info.fields[0].type = type;
  info.fields[0].scales = std::move(scales);
  info.fields[0].tolerance = info.fields[0].scales.empty() ? 0 : 1;
  FOVEA_ASSIGN_OR_RETURN(const auto writer, store::DatasetWriter::Create(path, info));
  for (int64_t step = 0; step < kOddSteps; ++step) {
    store::testing::StepData data = store::testing::MakeStep(kOdd, 16, static_cast<int>(step));
    Fit(info.fields[0], &data.coefficients);
    FOVEA_RETURN_IF_ERROR(writer->WriteField("density", data.coefficients, data.stats));
    FOVEA_RETURN_IF_ERROR(writer->Commit(step * 1'000'000'000, std::nullopt));
  }
  return absl::OkStatus();
}

class LocalRendererTest : public server::ServerFixture {
 protected:
  void SetUp() override {
    ServerFixture::SetUp();
    ASSERT_OK(store::testing::MakeStore(Root() + "/odd.zarr", store::testing::MakeInfo(kOdd, 16),
                                        kOddSteps));
    StartServer();
    Connect();
  }

  void Connect() {
    auto client = Client::Connect(server_->address());
    ASSERT_OK(client.status());
    client_ = *std::move(client);
  }

  static frames::FrameSpec Spec(const Vec3& fovea, const Rate& rate) {
    frames::FrameSpec spec = *wire::FromProto(SmallSpec(), "spec");
    spec.fovea = frames::Position{fovea, false};
    spec.rate = rate;
    return spec;
  }

  /// What is reached, drawn here, is what the server draws at that rate.
  void ExpectSamePicture(const LocalRenderer& local, const std::string& dataset, int64_t step) {
    ASSERT_OK_AND_ASSIGN(const frames::FrameSpec reached, local.Reached());
    ASSERT_OK_AND_ASSIGN(const frames::Frame here, local.Render(reached));
    ASSERT_OK_AND_ASSIGN(const frames::Frame there, client_->RenderFrame(dataset, step, reached));
    EXPECT_EQ(here.used, there.used);
    EXPECT_EQ(here.step, there.step);
    EXPECT_EQ(here.time_ns, there.time_ns);
    EXPECT_EQ(here.frame_number, there.frame_number);
    EXPECT_EQ(here.stats.coefficients, there.stats.coefficients);
    ASSERT_EQ(here.pixels.size(), there.pixels.size());
    EXPECT_TRUE(here.pixels == there.pixels)
        << dataset << " step " << step << " rate " << FormatRate(*reached.rate);
  }

  std::unique_ptr<Client> client_;
};

TEST_F(LocalRendererTest, APictureIsTheServersAtEveryRateOnTheWay) {
  LocalRenderer local(*client_, "odd", 2);
  std::vector<double> rates;
  ASSERT_OK(local.Fetch(1, Spec({30, 31, 20}, 40), [&](const LocalRenderer::Progress& progress) {
    if (progress.reached && (rates.empty() || rates.back() != progress.reached->x)) {
      rates.push_back(progress.reached->x);
      ExpectSamePicture(local, "odd", 1);
    }
    return true;
  }));
  EXPECT_TRUE(local.progress().complete);
  EXPECT_THAT(rates, SizeIs(::testing::Ge(6U)));
  EXPECT_EQ(rates.back(), 40);
  EXPECT_TRUE(std::is_sorted(rates.begin(), rates.end()));
}

TEST_F(LocalRendererTest, AnotherViewNeedsNothingFetched) {
  LocalRenderer local(*client_, "odd", 1);
  ASSERT_OK(local.Fetch(0, Spec({30, 31, 20}, 24)));
  ASSERT_OK_AND_ASSIGN(frames::FrameSpec spec, local.Reached());
  for (const double azimuth : {0.0, 100.0, 215.0}) {
    spec.view.azimuth_deg = azimuth;
    spec.fovea->at = {32, 30, 21};
    spec.rate = 16;  // within what is here
    spec.window = azimuth > 200 ? WindowShape::kSmooth : WindowShape::kSphere;
    ASSERT_OK_AND_ASSIGN(const frames::Frame here, local.Render(spec));
    ASSERT_OK_AND_ASSIGN(const frames::Frame there, client_->RenderFrame("odd", 0, spec));
    EXPECT_TRUE(here.pixels == there.pixels) << azimuth;
  }
  spec.rate = 25;
  EXPECT_THAT(local.Render(spec), FailsWith(absl::StatusCode::kFailedPrecondition, "fetch"));
}

TEST_F(LocalRendererTest, WhatIsHeldIsNotSentAgain) {
  LocalRenderer local(*client_, "odd", 1);
  ASSERT_OK(local.Fetch(0, Spec({30, 31, 20}, 24)));
  const uint64_t fresh = local.progress().bytes;
  ASSERT_GT(fresh, 0U);
  ASSERT_OK(local.Fetch(0, Spec({30, 31, 20}, 24)));
  EXPECT_EQ(local.progress().blocks, 0U);
  EXPECT_TRUE(local.progress().complete);
  ExpectSamePicture(local, "odd", 0);
  ASSERT_OK(local.Fetch(0, Spec({32, 31, 20}, 24)));
  EXPECT_GT(local.progress().bytes, 0U);
  EXPECT_LT(local.progress().bytes, fresh / 4);
  ExpectSamePicture(local, "odd", 0);
  ASSERT_OK(local.Fetch(0, Spec({30, 31, 20}, 20)));
  EXPECT_EQ(local.progress().blocks, 0U);
  ExpectSamePicture(local, "odd", 0);
}

TEST_F(LocalRendererTest, AStepThatIsAsTheOneBeforeCostsNextToNothing) {
  // Both steps of "still" are MakeStep(0).
  const store::DatasetInfo info = store::testing::MakeInfo(kOdd, 16);
  {
    ASSERT_OK_AND_ASSIGN(const auto writer,
                         store::DatasetWriter::Create(Root() + "/still.zarr", info));
    const store::testing::StepData data = store::testing::MakeStep(kOdd, 16, 0);
    for (const int64_t step : {0, 1}) {
      ASSERT_OK(writer->WriteField("density", data.coefficients, data.stats));
      ASSERT_OK(writer->Commit(step, std::nullopt));
    }
  }
  LocalRenderer local(*client_, "still", 1);
  ASSERT_OK(local.Fetch(0, Spec({30, 31, 20}, 30)));
  const uint64_t fresh = local.progress().bytes;
  ASSERT_OK(local.Fetch(1, Spec({30, 31, 20}, 30)));
  EXPECT_LT(local.progress().bytes, fresh / 20);
  ExpectSamePicture(local, "still", 1);
}

TEST_F(LocalRendererTest, RandomWalksAlwaysDrawTheServersPicture) {
  ASSERT_OK(MakeTyped(Root() + "/int16.zarr", "int16", {}));
  ASSERT_OK(MakeTyped(Root() + "/int32.zarr", "int32", {}));
  ASSERT_OK(MakeTyped(Root() + "/quantised.zarr", "int16", {0.125F, 0.25F, 0.5F}));
  for (const std::string dataset : {"odd", "int16", "int32", "quantised", "plume"}) {
    std::mt19937 random(7);
    const auto uniform = [&](double low, double high) {
      return std::uniform_real_distribution<double>(low, high)(random);
    };
    LocalRenderer local(*client_, dataset, 2);
    const Int3 dims = dataset == "plume" ? kDims : kOdd;
    Vec3 fovea{20, 20, 20};
    int64_t step = 0;
    for (int i = 0; i < 12; ++i) {
      if (i % 3 == 2) {
        step = static_cast<int64_t>(uniform(0, kOddSteps));
      }
      for (int axis = 0; axis < 3; ++axis) {
        fovea[axis] =
            std::clamp(fovea[axis] + uniform(-9, 9), 0.0, static_cast<double>(dims[axis]));
      }
      const Rate rate = i % 4 == 3 ? Rate(uniform(1, 30), uniform(1, 80), uniform(1, 30))
                                   : Rate(std::floor(uniform(1, 50)));
      const auto most = static_cast<uint64_t>(uniform(1, 9));
      uint64_t messages = 0;
      ASSERT_OK(local.Fetch(step, Spec(fovea, i == 7 ? Rate(80) : rate),
                            [&](const auto&) { return i % 5 != 4 || ++messages < most; }));
      if (local.progress().reached) {
        ExpectSamePicture(local, dataset, step);
      }
    }
  }
}

TEST_F(LocalRendererTest, TwoFieldsTravelTogether) {
  LocalRenderer local(*client_, "lab/other", 1);
  frames::FrameSpec spec = Spec({20, 18, 15}, 12);
  spec.color_field = "heat";
  ASSERT_OK(local.Fetch(0, spec));
  ExpectSamePicture(local, "lab/other", 0);
  spec.color_field = "density";
  ASSERT_OK(local.Fetch(0, spec));
  ExpectSamePicture(local, "lab/other", 0);
  spec.color_field.reset();
  spec.field = "heat";
  ASSERT_OK(local.Fetch(0, spec));
  ExpectSamePicture(local, "lab/other", 0);
}

TEST_F(LocalRendererTest, AnEmptyVolumeIsASmallStream) {
  {
    ASSERT_OK_AND_ASSIGN(
        const auto writer,
        store::DatasetWriter::Create(Root() + "/empty.zarr", store::testing::MakeInfo(kOdd, 16)));
    const BrickGrid nothing(kOdd, 16, 1, 0.0F);
    ASSERT_OK(writer->WriteField("density",
                                 wavelet::ForwardHaar(nothing, *Hierarchy::Make(kOdd), 1),
                                 ComputeStats(nothing)));
    ASSERT_OK(writer->Commit(0, std::nullopt));
  }
  LocalRenderer local(*client_, "empty", 1);
  ASSERT_OK(local.Fetch(0, Spec({30, 31, 20}, 70)));
  EXPECT_LT(local.progress().bytes, 6000U);
  ExpectSamePicture(local, "empty", 0);
}

TEST_F(LocalRendererTest, DamagedChunksAreSaidAndDrawnAsTheServerDoes) {
  const std::string folder = Root() + "/odd.zarr/density/detail_2";
  for (const std::string& file : store::testing::FilesBelow(folder)) {
    if (file.find("/c.1.") != std::string::npos) {
      store::testing::FlipByte(file, 40);
    }
  }
  LocalRenderer local(*client_, "odd", 1);
  ASSERT_OK(local.Fetch(1, Spec({30, 31, 20}, 40)));
  ExpectSamePicture(local, "odd", 1);
  ASSERT_OK_AND_ASSIGN(const frames::Frame here, local.Render(*local.Reached()));
  ASSERT_THAT(here.warnings, SizeIs(1));
  EXPECT_EQ(here.warnings[0].code, frames::Warning::Code::kDataLoss);
  ASSERT_OK(local.Fetch(1, Spec({30, 31, 20}, 40)));
  EXPECT_THAT(local.Render(*local.Reached())->warnings, SizeIs(1));  // still what is drawn
  // Step 2 cannot be told from a damaged step 1, and is sent as it is.
  ASSERT_OK(local.Fetch(2, Spec({30, 31, 20}, 40)));
  ExpectSamePicture(local, "odd", 2);
  EXPECT_THAT(local.Render(*local.Reached())->warnings, IsEmpty());
  frames::FrameSpec strict = Spec({30, 31, 20}, 40);
  strict.strict = true;
  LocalRenderer other(*client_, "odd", 1);
  EXPECT_THAT(other.Fetch(1, strict), FailsWith(absl::StatusCode::kDataLoss, "chunk"));
}

/// A store in the place of another, with the values of `seeds` and what else `like` says of them.
void Replace(const std::string& path, const std::vector<int>& seeds, const std::vector<int>& like) {
  const std::string next = path.substr(0, path.size() - 5) + "-next.zarr";
  {
    ASSERT_OK_AND_ASSIGN(const auto writer,
                         store::DatasetWriter::Create(next, store::testing::MakeInfo(kOdd, 16)));
    for (size_t i = 0; i < seeds.size(); ++i) {
      const store::testing::StepData data = store::testing::MakeStep(kOdd, 16, seeds[i]);
      const store::testing::StepData told = store::testing::MakeStep(kOdd, 16, like[i]);
      ASSERT_OK(writer->WriteField("density", data.coefficients, told.stats));
      const auto step = static_cast<int64_t>(i);
      ASSERT_OK(writer->Commit(step * 1'000'000'000, std::nullopt));
    }
  }
  std::filesystem::rename(path, path + ".old");
  std::filesystem::rename(next, path);
}

TEST_F(LocalRendererTest, AnotherDatasetInItsPlaceIsFetchedAnew) {
  LocalRenderer local(*client_, "odd", 1);
  ASSERT_OK(local.Fetch(0, Spec({30, 31, 20}, 40)));
  ASSERT_OK(local.Fetch(1, Spec({30, 31, 20}, 40)));
  Replace(Root() + "/odd.zarr", {5, 6, 7}, {5, 6, 7});
  ASSERT_OK(local.Fetch(1, Spec({32, 31, 20}, 40)));
  ExpectSamePicture(local, "odd", 1);
}

TEST_F(LocalRendererTest, DifferencesFromValuesThatAreNotHeldAreNoticed) {
  LocalRenderer local(*client_, "odd", 1);
  ASSERT_OK(local.Fetch(0, Spec({30, 31, 20}, 40)));
  Replace(Root() + "/odd.zarr", {6, 6, 7}, {0, 1, 2});  // nobody can tell but by the values
  ASSERT_OK(local.Fetch(1, Spec({30, 31, 20}, 40)));
  ExpectSamePicture(local, "odd", 1);
  EXPECT_TRUE(local.progress().complete);
}

/// The real client, with messages changed on the way, or lost.
class MeddlingClient final : public CoefficientStreams {
 public:
  using Meddle = std::function<Status(wire::CoefficientsMessage*)>;
  MeddlingClient(Client& client, Meddle meddle) : client_(client), meddle_(std::move(meddle)) {}

  Status StreamCoefficients(
      const wire::CoefficientsRequest& request,
      const std::function<Status(const wire::CoefficientsMessage&)>& on_message) override {
    ++calls;
    return client_.StreamCoefficients(request, [&](wire::CoefficientsMessage message) {
      FOVEA_RETURN_IF_ERROR(meddle_(&message));
      return on_message(message);
    });
  }
  int calls = 0;

 private:
  Client& client_;
  const Meddle meddle_;
};

TEST_F(LocalRendererTest, AStreamThatIsCutAgainAndAgainArrives) {
  int messages = 0;
  MeddlingClient cutting(
      *client_, [&](auto*) { return ++messages % 3 == 0 ? Unavailable("cut") : absl::OkStatus(); });
  LocalRenderer local(cutting, "odd", 1);
  LocalRenderer whole(*client_, "odd", 1);
  ASSERT_OK(local.Fetch(0, Spec({30, 31, 20}, 60)));
  ASSERT_OK(whole.Fetch(0, Spec({30, 31, 20}, 60)));
  EXPECT_GE(cutting.calls, 3);
  EXPECT_TRUE(local.progress().complete);
  EXPECT_EQ(local.progress().bytes, whole.progress().bytes);
  ExpectSamePicture(local, "odd", 0);
}

TEST_F(LocalRendererTest, AStreamThatNeverComesEnds) {
  MeddlingClient cutting(*client_, [](auto*) { return Unavailable("cut"); });
  LocalRenderer local(cutting, "odd", 1);
  EXPECT_THAT(local.Fetch(0, Spec({30, 31, 20}, 60)),
              FailsWith(absl::StatusCode::kUnavailable, "cut"));
  EXPECT_EQ(cutting.calls, 1);
}

TEST_F(LocalRendererTest, WhatAServerCannotSendIsItsFault) {
  using Message = wire::CoefficientsMessage;
  const auto outcome = [&](const std::function<void(Message&)>& change) {
    MeddlingClient hostile(*client_, [&](Message* message) {
      change(*message);
      return absl::OkStatus();
    });
    LocalRenderer local(hostile, "odd", 1);
    return local.Fetch(0, Spec({30, 31, 20}, 60));
  };
  constexpr auto kInternal = absl::StatusCode::kInternal;
  EXPECT_OK(outcome([](Message&) {}));
  EXPECT_THAT(outcome([](Message& m) { m.set.reset(); }), FailsWith(kInternal, "a set"));
  EXPECT_THAT(outcome([](Message& m) { m.index += m.index; }), FailsWith(kInternal, "block 2"));
  EXPECT_THAT(outcome([](Message& m) { m.data += "x"; }), FailsWith(kInternal, "checksum"));
  EXPECT_THAT(outcome([](Message& m) { m.data.resize(m.data.size() / 2); }),
              FailsWith(kInternal, "the server sent"));
  EXPECT_THAT(outcome([](Message& m) { m.data.clear(); }), FailsWith(kInternal, "block 1"));
  EXPECT_THAT(outcome([](Message& m) { m.reached.reset(); }), FailsWith(kInternal, "ended"));
  const auto set = [&](const std::function<void(wire::CoefficientsSummary&)>& change) {
    return outcome([&](Message& m) {
      if (m.set) {
        change(*m.set);
      }
    });
  };
  EXPECT_THAT(set([](auto& s) { s.step = 2; }), FailsWith(kInternal, "step 2"));
  EXPECT_THAT(set([](auto& s) { s.dataset.info.wavelet = "sine"; }), FailsWith(kInternal, "sine"));
  EXPECT_THAT(set([](auto& s) { s.used.rate = 1; }), FailsWith(kInternal, "more coefficients"));
  EXPECT_THAT(set([](auto& s) { s.used.fovea->at.x = 1e9; }), FailsWith(kInternal, "fovea"));
  EXPECT_THAT(set([](auto& s) {
                s.dataset.info.hierarchy = *Hierarchy::Make({9, 9, 9});
              }),
              FailsWith(kInternal, ""));
}

TEST_F(LocalRendererTest, ErrorsOfTheServerAreSaid) {
  LocalRenderer missing(*client_, "nothing", 1);
  EXPECT_THAT(missing.Fetch(0, Spec({1, 1, 1}, 8)),
              FailsWith(absl::StatusCode::kNotFound, "nothing"));
  LocalRenderer local(*client_, "odd", 1);
  EXPECT_THAT(local.Fetch(99, Spec({1, 1, 1}, 8)), FailsWith(absl::StatusCode::kOutOfRange, "99"));
  EXPECT_THAT(local.Fetch(0, Spec({999, 1, 1}, 8)),
              FailsWith(absl::StatusCode::kInvalidArgument, "fovea"));
  EXPECT_THAT(local.Reached(), FailsWith(absl::StatusCode::kFailedPrecondition, "no coefficients"));
}

}  // namespace
}  // namespace fovea::client
