#include <cmath>
#include <cstring>
#include <fstream>
#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "engine/store/verify.h"
#include "ingest/ingest.h"
#include "tests/support/status_matchers.h"
#include "tests/system/ingest/ingested.h"

namespace fovea::ingest {
namespace {

using ::fovea::testing::FailsWith;
using ::fovea::testing::ReadFile;
using ::fovea::testing::StoredVoxels;
using ::fovea::testing::TemporaryFolder;

constexpr Int3 kDims{50, 41, 36};

/// Steps of waves and noise from -1 to 3 or so, written as float32.
class ToleranceTest : public ::testing::Test {
 protected:
  void SetUp() override {
    std::mt19937 random(5);
    std::normal_distribution<float> noise(0, 0.2F);
    std::ofstream file(folder_ / "a.raw", std::ios::binary);
    for (int step = 0; step < 3; ++step) {
      std::vector<float> values(static_cast<size_t>(kDims.Product()));
      for (size_t i = 0; i < values.size(); ++i) {
        values[i] = 1 + std::sin(static_cast<float>(i + 100 * step) * 0.011F) + noise(random);
      }
      file.write(reinterpret_cast<const char*>(values.data()),
                 static_cast<std::streamsize>(4 * values.size()));
      steps_.push_back(values);
    }
    options_.inputs = {folder_ / "a.raw"};
    options_.output = folder_ / "out.zarr";
    options_.raw = RawFormat{kDims, "float32", false, 0, 3};
  }

  /// The largest error of a stored step, as a reader finds it.
  StatusOr<double> ErrorOf(int64_t step, int64_t original) const {
    FOVEA_ASSIGN_OR_RETURN(const Grid voxels, StoredVoxels(options_.output, step, "density"));
    double largest = 0;
    for (size_t i = 0; i < voxels.values.size(); ++i) {
      const double was = steps_[static_cast<size_t>(original)][i];
      largest = std::max(largest, std::fabs(was - voxels.values[i]));
    }
    return largest;
  }

  TemporaryFolder folder_;
  IngestOptions options_;
  std::vector<std::vector<float>> steps_;
};

TEST_F(ToleranceTest, HoldsForEveryWaveletAndIsTold) {
  for (const Wavelet wavelet : {Wavelet::kHaar, Wavelet::kCdf53, Wavelet::kCdf97}) {
    options_.wavelet = wavelet;
    options_.tolerance = Tolerance{0.01, false};
    options_.output = folder_ / (std::string(WaveletName(wavelet)) + ".zarr");
    ASSERT_OK_AND_ASSIGN(const IngestReport report, Ingest(options_));
    double largest = 0;
    for (int64_t step = 0; step < 3; ++step) {
      ASSERT_OK_AND_ASSIGN(const double error, ErrorOf(step, step));
      EXPECT_LE(error, 0.01);
      largest = std::max(largest, error);
    }
    EXPECT_GT(largest, 0.001);  // quantised indeed
    ASSERT_EQ(report.max_errors.size(), 1U);
    EXPECT_NEAR(report.max_errors[0], largest, 1e-6);
    ASSERT_OK_AND_ASSIGN(const auto dataset, store::Dataset::Open(options_.output));
    const store::FieldInfo field = dataset->info().fields[0];
    EXPECT_EQ(field.tolerance, 0.01);
    EXPECT_EQ(field.max_error, report.max_errors[0]);
    EXPECT_EQ(field.scales.size(), 2U);
    ASSERT_OK_AND_ASSIGN(const store::VerifyReport verified, store::Verify(options_.output, 2));
    EXPECT_TRUE(verified.problems.empty());
  }
}

/// What a reader needs that knows nothing of Fovea.
TEST_F(ToleranceTest, EveryArrayOfDetailSaysItsScale) {
  options_.tolerance = Tolerance{1e-3, true};
  ASSERT_OK(Ingest(options_));
  ASSERT_OK_AND_ASSIGN(const auto dataset, store::Dataset::Open(options_.output));
  const store::FieldInfo field = dataset->info().fields[0];
  for (const auto& [array, scale] : std::vector<std::pair<std::string, float>>{
           {"detail_4", field.scales[0]}, {"detail_2", field.scales[1]}}) {
    const auto document =
        nlohmann::json::parse(ReadFile(options_.output + "/density/" + array + "/zarr.json"));
    EXPECT_EQ(document.at("data_type"), "u" + field.type);
    EXPECT_EQ(document.at("attributes").at("signs"), "folded");
    EXPECT_EQ(document.at("attributes").at("folded_scale").get<float>(), scale);
  }
  const auto coarse =
      nlohmann::json::parse(ReadFile(options_.output + "/density/coarse/zarr.json"));
  EXPECT_EQ(coarse.at("data_type"), "float32");
}

TEST_F(ToleranceTest, AppendingKeepsToIt) {
  options_.tolerance = Tolerance{0.1, false};
  ASSERT_OK(Ingest(options_));
  options_.append = true;
  EXPECT_THAT(Ingest(options_), FailsWith(absl::StatusCode::kInvalidArgument, "append"));
  options_.tolerance = std::nullopt;
  options_.lossless = true;
  EXPECT_THAT(Ingest(options_), FailsWith(absl::StatusCode::kInvalidArgument, "quantised"));
  options_.lossless = false;
  ASSERT_OK(Ingest(options_));
  for (int64_t step = 0; step < 3; ++step) {
    ASSERT_OK_AND_ASSIGN(const double error, ErrorOf(3 + step, step));
    EXPECT_LE(error, 0.1);
    EXPECT_GT(error, 0.01);
  }
}

TEST_F(ToleranceTest, RefusesWhatCannotBe) {
  options_.tolerance = Tolerance{1e-7, false};
  EXPECT_THAT(Ingest(options_), FailsWith(absl::StatusCode::kInvalidArgument, "tolerance"));
  EXPECT_FALSE(std::filesystem::exists(options_.output));
  options_.tolerance = Tolerance{0.1, false};
  options_.lossless = true;
  EXPECT_THAT(Ingest(options_), FailsWith(absl::StatusCode::kInvalidArgument, "lossless"));
}

}  // namespace
}  // namespace fovea::ingest
