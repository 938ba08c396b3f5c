#include <bit>
#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "ingest/ingest.h"
#include "ingest/raw_format.h"
#include "tests/support/status_matchers.h"
#include "tests/system/ingest/ingested.h"

namespace fovea::ingest {
namespace {

using ::fovea::testing::FailsWith;
using ::fovea::testing::FourUlp;
using ::fovea::testing::StoredVoxels;
using ::fovea::testing::TemporaryFolder;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

template <typename T>
void Append(double value, bool big_endian, std::string* bytes) {
  const T typed = static_cast<T>(value);
  char raw[sizeof(T)];
  std::memcpy(raw, &typed, sizeof(T));
  for (size_t i = 0; i < sizeof(T); ++i) {
    *bytes += raw[big_endian ? sizeof(T) - 1 - i : i];
  }
}

void AppendAs(const std::string& type, double value, bool big_endian, std::string* bytes) {
  if (type == "uint8") {
    Append<uint8_t>(value, big_endian, bytes);
  } else if (type == "int8") {
    Append<int8_t>(value, big_endian, bytes);
  } else if (type == "uint16") {
    Append<uint16_t>(value, big_endian, bytes);
  } else if (type == "int16") {
    Append<int16_t>(value, big_endian, bytes);
  } else if (type == "uint32") {
    Append<uint32_t>(value, big_endian, bytes);
  } else if (type == "int32") {
    Append<int32_t>(value, big_endian, bytes);
  } else if (type == "uint64") {
    Append<uint64_t>(value, big_endian, bytes);
  } else if (type == "int64") {
    Append<int64_t>(value, big_endian, bytes);
  } else if (type == "float32") {
    Append<float>(value, big_endian, bytes);
  } else {
    Append<double>(value, big_endian, bytes);
  }
}

class RawTest : public ::testing::Test {
 protected:
  void Write(const std::string& name, const std::string& bytes) const {
    std::ofstream(folder_ / name, std::ios::binary) << bytes;
  }
  [[nodiscard]] IngestOptions Options(const std::string& input, const RawFormat& format) const {
    IngestOptions options;
    options.inputs = {folder_ / input};
    options.output = folder_ / "out.zarr";
    options.raw = format;
    return options;
  }

  TemporaryFolder folder_;
};

struct TypeAndOrder {
  std::string type;
  bool big_endian;
  double least, greatest;
};

class RawTypeTest : public RawTest, public ::testing::WithParamInterface<TypeAndOrder> {};

TEST_P(RawTypeTest, VoxelsComeBack) {
  const TypeAndOrder& param = GetParam();
  const Int3 dims{19, 6, 35};
  RawFormat format{dims, param.type, param.big_endian, 13, 2};
  std::mt19937 random(7);
  std::uniform_real_distribution<double> uniform(param.least, param.greatest);
  std::string bytes(13, 'h');
  std::vector<double> values;
  for (int64_t i = 0; i < 2 * dims.Product(); ++i) {
    const double value = param.type == "float32" || param.type == "float64"
                             ? static_cast<double>(static_cast<float>(uniform(random)))
                             : std::floor(uniform(random));
    values.push_back(i == 0 ? param.least : i == 1 ? param.greatest : value);
    AppendAs(param.type, values.back(), param.big_endian, &bytes);
  }
  Write("a.raw", bytes);
  IngestOptions options = Options("a.raw", format);
  options.field = "ct";
  ASSERT_OK_AND_ASSIGN(const IngestReport report, Ingest(options));
  EXPECT_EQ(report.steps, 2);
  EXPECT_EQ(report.dims, dims);
  EXPECT_EQ(report.input_bytes, bytes.size());
  for (int64_t step = 0; step < 2; ++step) {
    ASSERT_OK_AND_ASSIGN(const Grid voxels, StoredVoxels(options.output, step, "ct"));
    for (int64_t i = 0; i < dims.Product(); ++i) {
      ASSERT_NEAR(voxels.values[static_cast<size_t>(i)],
                  values[static_cast<size_t>(step * dims.Product() + i)],
                  FourUlp(param.greatest - param.least))
          << step << " " << i;
    }
  }
}

std::vector<TypeAndOrder> AllTypes() {
  std::vector<TypeAndOrder> all;
  for (const bool big : {false, true}) {
    all.push_back({"uint8", big, 0, 255});
    all.push_back({"int8", big, -128, 127});
    all.push_back({"uint16", big, 0, 65535});
    all.push_back({"int16", big, -32768, 32767});
    all.push_back({"uint32", big, 0, 4294967295.0});
    all.push_back({"int32", big, -2147483648.0, 2147483647});
    all.push_back({"uint64", big, 0, 9007199254740991.0});
    all.push_back({"int64", big, -9007199254740991.0, 9007199254740991.0});
    all.push_back({"float32", big, -3.5, 7.25});
    all.push_back({"float64", big, -3.5, 7.25});
  }
  return all;
}

INSTANTIATE_TEST_SUITE_P(All, RawTypeTest, ::testing::ValuesIn(AllTypes()), [](const auto& tested) {
  return tested.param.type + (tested.param.big_endian ? "be" : "le");
});

TEST_F(RawTest, SlicesTooLargeForOneMessageAreSentInPieces) {
  const Int3 dims{1500, 1100, 3};  // 1.65 million voxels a slice
  std::string bytes(static_cast<size_t>(dims.Product()), '\0');
  const auto at = [&](int64_t x, int64_t y, int64_t z) {
    return static_cast<size_t>((z * dims.y + y) * dims.x + x);
  };
  bytes[at(1499, 1099, 2)] = 1;
  bytes[at(0, 699, 1)] = 2;
  bytes[at(7, 700, 0)] = 3;
  Write("a.raw", bytes);
  const IngestOptions options = Options("a.raw", {dims, "uint8", false, 0, 1});
  ASSERT_OK(Ingest(options));
  ASSERT_OK_AND_ASSIGN(const Grid voxels, StoredVoxels(options.output, 0, "density"));
  for (size_t i = 0; i < bytes.size(); ++i) {
    ASSERT_NEAR(voxels.values[i], bytes[i], 1e-6) << i;
  }
}

TEST_F(RawTest, ValuesThatFloatCannotHoldAreSaid) {
  std::string bytes;
  for (const double value : {0.0, 16777217.0, 3.0, 4294967295.0}) {
    AppendAs("uint32", value, false, &bytes);
  }
  Write("a.raw", bytes);
  ASSERT_OK_AND_ASSIGN(const IngestReport report,
                       Ingest(Options("a.raw", {{4, 1, 1}, "uint32", false, 0, 1})));
  EXPECT_THAT(report.warnings, Contains(HasSubstr("2 values are not exact in float32")));
}

TEST_F(RawTest, NanBecomesZero) {
  std::string bytes;
  for (const double value : {1.0, std::nan(""), 1e300, -2.0}) {
    AppendAs("float64", value, true, &bytes);
  }
  Write("a.raw", bytes);
  const IngestOptions options = Options("a.raw", {{2, 2, 1}, "float64", true, 0, 1});
  ASSERT_OK_AND_ASSIGN(const IngestReport report, Ingest(options));
  EXPECT_EQ(report.nonfinite_values, 2U);
  ASSERT_OK_AND_ASSIGN(const Grid voxels, StoredVoxels(options.output, 0, "density"));
  EXPECT_NEAR(voxels.values[1], 0, 1e-6);
  EXPECT_NEAR(voxels.values[2], 0, 1e-6);
}

TEST_F(RawTest, TheWrongSizeIsReportedWithTheSum) {
  Write("a.raw", std::string(99, 'x'));
  EXPECT_THAT(
      Ingest(Options("a.raw", {{5, 5, 2}, "uint16", false, 0, 1})),
      FailsWith(absl::StatusCode::kInvalidArgument,
                "a.raw: has 99 bytes, but the raw format needs 100 = 0 header bytes + 1 step "
                "x 5 x 5 x 2 voxels x 2 bytes (uint16)"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "out.zarr"));
}

TEST_F(RawTest, AFileOfTheWrongSizeInTheMiddleOfASeriesIsNamedBeforeAnythingIsWritten) {
  Write("t000.raw", std::string(8, 'a'));
  Write("t001.raw", std::string(7, 'b'));
  EXPECT_THAT(Ingest(Options("t###.raw", {{2, 2, 2}, "uint8", false, 0, 1})),
              FailsWith(absl::StatusCode::kInvalidArgument, "t001.raw: has 7 bytes"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "out.zarr"));
}

TEST_F(RawTest, SpacingBecomesTheMatrix) {
  Write("a.raw", std::string(8, 'a'));
  IngestOptions options = Options("a.raw", {{2, 2, 2}, "uint8", false, 0, 1});
  options.spacing = {1, 0.5, 2};
  ASSERT_OK(Ingest(options));
  ASSERT_OK_AND_ASSIGN(const auto dataset, store::Dataset::Open(options.output));
  EXPECT_EQ(dataset->info().index_to_world.TransformPoint({2, 2, 2}), (Vec3{2, 1, 4}));
  EXPECT_EQ(dataset->info().origin, (Int3{0, 0, 0}));
}

TEST_F(RawTest, EveryWaveletGivesTheVoxelsBackThroughTheStore) {
  std::mt19937 random(6);
  std::string bytes;
  std::vector<float> values;
  for (int i = 0; i < 45 * 38 * 21; ++i) {
    values.push_back(static_cast<float>(random() % 60000) - 20000);
    AppendAs("float32", values.back(), false, &bytes);
  }
  Write("a.raw", bytes);
  for (const Wavelet wavelet : {Wavelet::kHaar, Wavelet::kCdf53, Wavelet::kCdf97}) {
    IngestOptions options = Options("a.raw", {{45, 38, 21}, "float32", false, 0, 1});
    options.wavelet = wavelet;
    options.output = folder_ / (std::string(WaveletName(wavelet)) + ".zarr");
    ASSERT_OK(Ingest(options));
    ASSERT_OK_AND_ASSIGN(const auto dataset, store::Dataset::Open(options.output));
    EXPECT_EQ(dataset->info().wavelet, WaveletName(wavelet));
    ASSERT_OK_AND_ASSIGN(const Grid voxels, StoredVoxels(options.output, 0, "density"));
    for (size_t i = 0; i < values.size(); ++i) {
      ASSERT_NEAR(voxels.values[i], values[i], 60000 * 2e-6) << i;
    }
    options.append = true;
    options.wavelet = std::nullopt;
    ASSERT_OK(Ingest(options));
    ASSERT_OK_AND_ASSIGN(const Grid again, StoredVoxels(options.output, 1, "density"));
    EXPECT_EQ(again.values, voxels.values);
    options.wavelet = wavelet == Wavelet::kHaar ? Wavelet::kCdf53 : Wavelet::kHaar;
    EXPECT_THAT(Ingest(options),
                FailsWith(absl::StatusCode::kInvalidArgument,
                          std::string("of the wavelet ") + std::string(WaveletName(wavelet))));
  }
}

TEST_F(RawTest, LosslessIsLossless) {
  for (const char* type : {"uint8", "int8", "uint16", "int16"}) {
    const bool is_signed = type[0] == 'i';
    const double range = std::string(type).ends_with("8") ? 256 : 65536;
    std::mt19937 random(8);
    std::string bytes;
    std::vector<float> values;
    for (int i = 0; i < 45 * 38 * 21; ++i) {  // extremes: the largest coefficients there can be
      const double value = random() % 3 == 0
                               ? random() % 2 * (range - 1)
                               : static_cast<double>(random() % static_cast<uint64_t>(range));
      values.push_back(static_cast<float>(value - (is_signed ? range / 2 : 0)));
      AppendAs(type, values.back(), false, &bytes);
    }
    Write("a.raw", bytes);
    for (const Wavelet wavelet : {Wavelet::kHaar, Wavelet::kCdf53}) {
      IngestOptions options = Options("a.raw", {{45, 38, 21}, type, false, 0, 1});
      options.wavelet = wavelet;
      options.lossless = true;
      options.output = folder_ / (std::string(WaveletName(wavelet)) + type + ".zarr");
      ASSERT_OK(Ingest(options));
      options.append = true;
      options.lossless = false;
      ASSERT_OK(Ingest(options));
      ASSERT_OK_AND_ASSIGN(const auto dataset, store::Dataset::Open(options.output));
      EXPECT_EQ(dataset->info().fields[0].type, range == 256 ? "int16" : "int32");
      for (const int64_t step : {0, 1}) {
        ASSERT_OK_AND_ASSIGN(const Grid voxels, StoredVoxels(options.output, step, "density"));
        EXPECT_EQ(voxels.values, values) << type << " step " << step;
      }
    }
  }
}

TEST_F(RawTest, LosslessIsRefusedWhereItCannotBe) {
  Write("a.raw", std::string(32, 'a'));
  const auto expect_refused = [&](const IngestOptions& options, const std::string& text) {
    EXPECT_THAT(Ingest(options), FailsWith(absl::StatusCode::kInvalidArgument, text));
  };
  IngestOptions options = Options("a.raw", {{2, 2, 2}, "float32", false, 0, 1});
  options.lossless = true;
  expect_refused(options, "voxels of 8 or 16 bits, not of float32");
  options.raw->type = "uint16";
  options.raw->steps_per_file = 2;
  options.wavelet = Wavelet::kCdf97;
  expect_refused(options, "cdf97 has no reversible integer form");
  EXPECT_FALSE(std::filesystem::exists(options.output));
  options.wavelet = Wavelet::kCdf53;
  options.raw = RawFormat{{2, 2, 2}, "uint8", false, 0, 4};
  ASSERT_OK(Ingest(options));
  options.append = true;
  options.raw = RawFormat{{2, 2, 2}, "uint16", false, 0, 2};
  expect_refused(options, "voxels of 16 bits do not fit");
  options.raw = RawFormat{{2, 2, 2}, "float32", false, 0, 1};
  expect_refused(options, "not of float32");
}

TEST_F(RawTest, ASidecarSaysHowTheVoxelsLie) {
  Write("a.raw", std::string("\0\1\0\2\0\3\0\4\1\0\2\0\3\0\4\0", 16));
  Write("a.raw.json",
        R"({"dims_xyz": [4, 1, 1], "type": "uint16", "byte_order": "big", "steps": 2,
            "spacing_xyz": [1, 2, 4], "origin_xyz": [10, 20, 30], "world_unit": "mm",
            "value_unit": "HU", "times_s": [0.5, 2], "colour": ["any", {"thing": null}]})");
  IngestOptions options = Options("a.raw*", {});
  options.raw.reset();
  ASSERT_OK(Ingest(options));
  ASSERT_OK_AND_ASSIGN(const auto dataset, store::Dataset::Open(options.output));
  const store::DatasetInfo info = dataset->info();
  EXPECT_EQ(info.index_to_world.TransformPoint({0, 0, 0}), (Vec3{10, 20, 30}));
  EXPECT_EQ(info.index_to_world.Spacing(), (Vec3{1, 2, 4}));
  EXPECT_EQ(info.world_unit, "mm");
  EXPECT_EQ(info.fields[0].value_unit, "HU");
  ASSERT_OK_AND_ASSIGN(const int64_t time, dataset->TimeNs(1));
  EXPECT_EQ(time, 2'000'000'000);
  ASSERT_OK_AND_ASSIGN(const Grid voxels, StoredVoxels(options.output, 1, "density"));
  EXPECT_EQ(voxels.values, (std::vector<float>{256, 512, 768, 1024}));
}

TEST_F(RawTest, AFormatThatIsGivenWinsOverTheSidecarAndAContradictionIsSaid) {
  Write("a.raw", std::string(8, 'a'));
  Write("a.raw.json", R"({"dims_xyz": [2, 2, 2], "type": "uint8", "spacing_xyz": [2, 2, 2]})");
  IngestOptions options = Options("a.raw", {{4, 2, 1}, "uint8", false, 0, 1});
  ASSERT_OK_AND_ASSIGN(const IngestReport report, Ingest(options));
  EXPECT_EQ(report.dims, (Int3{4, 2, 1}));
  EXPECT_THAT(report.warnings, Contains(HasSubstr("a.raw.json' says 2x2x2x1:uint8")));
  options = Options("a.raw", {{2, 2, 2}, "uint8", true, 0, 1});  // one byte has no order
  options.output = folder_ / "same.zarr";
  options.spacing = Vec3{1, 1, 3};
  ASSERT_OK_AND_ASSIGN(const IngestReport same, Ingest(options));
  EXPECT_THAT(same.warnings, IsEmpty());
  ASSERT_OK_AND_ASSIGN(const auto dataset, store::Dataset::Open(options.output));
  EXPECT_EQ(dataset->info().index_to_world.Spacing(), (Vec3{1, 1, 3}));
}

TEST_F(RawTest, HeaderlessVoxelsNeedSomebodyToSayWhatTheyAre) {
  Write("a.raw", std::string(8, 'a'));
  Write("a.xyz", std::string(8, 'a'));
  IngestOptions options = Options("a.raw", {});
  options.raw.reset();
  EXPECT_THAT(Ingest(options), FailsWith(absl::StatusCode::kInvalidArgument, "with --raw, e.g."));
  options.inputs = {folder_ / "a.xyz"};
  EXPECT_THAT(Ingest(options),
              FailsWith(absl::StatusCode::kInvalidArgument, "can be read: OpenVDB"));
  options.inputs = {folder_ / "a.raw"};
  for (const auto& [text, says] : std::vector<std::pair<std::string, std::string>>{
           {"{", "not a JSON object"},
           {"[1]", "not a JSON object"},
           {"{}", "'dims_xyz' is not a list of 3"},
           {R"({"dims_xyz": [2, 2, 2], "type": "u7"})", "raw type 'u7'"},
           {R"({"dims_xyz": [2, 2, 1e99], "type": "uint8"})", "whole number"},
           {R"({"dims_xyz": [2, 2, 3], "type": "uint8"})", "has 8 bytes"}}) {
    Write("a.raw.json", text);
    EXPECT_THAT(Ingest(options), FailsWith(absl::StatusCode::kInvalidArgument, says));
  }
  EXPECT_FALSE(std::filesystem::exists(options.output));
}

TEST_F(RawTest, StepsOfSeveralFilesAreAppended) {
  Write("a.raw", std::string(16, 'a'));
  Write("b.raw", std::string(16, 'b'));
  IngestOptions options = Options("a.raw", {{2, 2, 2}, "uint8", false, 0, 2});
  ASSERT_OK(Ingest(options));
  options.append = true;
  options.inputs = {folder_ / "b.raw"};
  ASSERT_OK(Ingest(options));
  ASSERT_OK_AND_ASSIGN(const auto dataset, store::Dataset::Open(options.output));
  EXPECT_EQ(dataset->info().committed_steps, 4);
  ASSERT_OK_AND_ASSIGN(const int64_t time, dataset->TimeNs(3));
  EXPECT_EQ(time, 125'000'000);
  options.raw->dims = {1, 2, 2};
  options.raw->steps_per_file = 4;
  EXPECT_THAT(Ingest(options), FailsWith(absl::StatusCode::kInvalidArgument, "not the 1 x 2 x 2"));
}

}  // namespace
}  // namespace fovea::ingest
