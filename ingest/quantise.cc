#include "ingest/quantise.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <set>
#include <string>

#include "engine/base/parallel.h"
#include "engine/fovea/coefficient_source.h"
#include "engine/fovea/reconstruct.h"
#include "engine/store/stored_type.h"
#include "engine/wavelet/gain.h"

namespace fovea::ingest {
namespace {

/// What float arithmetic of both transforms may add to an error, in units of the last place of the
/// largest value; a tolerance must be at least four times as much.
constexpr double kFloatUlps = 16;
/// Coefficients of later steps may be so much larger than those of the first: at least, rather, and
/// with int16, which is to be had for those only that surely fit.
constexpr float kRoom = 4;
constexpr float kMuchRoom = 64;
constexpr float kShortRoom = 16;
/// Blocks of voxels that are reconstructed at once.
constexpr int64_t kBlock = 64;

/// The share of the tolerance that each level gets, coarsest first. A level has an eighth of the
/// coefficients of the next finer one, so that a step four times as fine costs little; at most
/// `most` times by four.
std::vector<double> Shares(int levels, int most) {
  std::vector<double> shares;
  double sum = 0;
  for (int level = 0; level < levels; ++level) {
    shares.push_back(std::pow(4.0, -std::min(levels - 1 - level, most)));
    sum += shares.back();
  }
  for (double& share : shares) {
    share /= sum;
  }
  return shares;
}

/// Rounded down, so that the bound holds.
float BelowOrEqual(double value) {
  const auto rounded = static_cast<float>(value);
  return rounded <= value ? rounded : std::nextafter(rounded, 0.0F);
}

std::vector<float> LargestOfLevels(const CoefficientSet& set) {
  std::vector<float> largest;
  for (const BrickGrid& level : set.detail) {
    largest.push_back(0);
    for (const auto& [at, brick] : level.bricks()) {
      largest.back() = std::max(largest.back(), store::LargestMagnitude(brick));
    }
  }
  return largest;
}

}  // namespace

StatusOr<Tolerance> ParseTolerance(const std::string& text) {
  Tolerance tolerance;
  const char* end = text.data() + text.size();
  const auto [rest, error] = std::from_chars(text.data(), end, tolerance.value);
  const std::string unit(rest, end);
  tolerance.relative = unit == "r" || unit == "%";
  if (unit == "%") {
    tolerance.value /= 100;
  }
  if (error != std::errc() || (!unit.empty() && !tolerance.relative) || !(tolerance.value > 0) ||
      !std::isfinite(tolerance.value) || (tolerance.relative && tolerance.value >= 1)) {
    return InvalidArgument(
        "tolerance '{}': it must be a number above 0 in data units (0.01), or a part of the range "
        "below 1 (1e-3r, 0.1%)",
        text.substr(0, 100));
  }
  return tolerance;
}

namespace {

/// Scales that keep `bound`, and the type that holds coefficients `room` times `largest`. False if
/// there is none.
bool FindScales(double bound, const std::vector<double>& gains, const std::vector<float>& largest,
                float room, store::FieldInfo* field) {
  for (int most = 3; most >= 0; --most) {
    const std::vector<double> shares = Shares(static_cast<int>(gains.size()), most);
    field->scales.clear();
    float number = 0;
    for (size_t level = 0; level < shares.size(); ++level) {
      field->scales.push_back(BelowOrEqual(2 * bound * shares[level] / gains[level]));
      number = std::max(number, largest[level] / field->scales.back());
    }
    const auto fits = [&](const char* type, float times) {
      field->type = type;
      return number * times <= static_cast<float>(store::MostOfType(type)) && number > 0;
    };
    if (fits("int16", kShortRoom) || number == 0 || fits("int32", room)) {
      field->type = number == 0 ? "int32" : field->type;
      return true;
    }
  }
  return false;
}

}  // namespace

Status ChooseScales(const CoefficientSet& set, const FieldStats& stats, const Tolerance& tolerance,
                    store::FieldInfo* field) {
  const double range = stats.maximum - stats.minimum;
  if (set.hierarchy.finest() == 0 || (tolerance.relative && range == 0)) {
    return absl::OkStatus();
  }
  const double bound = tolerance.relative ? tolerance.value * range : tolerance.value;
  const double magnitude = std::max(std::fabs(stats.minimum), std::fabs(stats.maximum));
  const double float_error = kFloatUlps * magnitude * std::numeric_limits<float>::epsilon();
  if (bound < 4 * float_error) {
    return InvalidArgument(
        "--tolerance: {:.3g} is too near to what float32 itself is off by in field '{}': give "
        "{:.3g} "
        "or more, or none",
        bound, field->name, 4 * float_error);
  }
  std::vector<double> gains;
  for (int level = 0; level < set.hierarchy.finest(); ++level) {
    gains.push_back(wavelet::DetailGain(set.basis.wavelet, set.hierarchy, level));
  }
  const std::vector<float> largest = LargestOfLevels(set);
  field->tolerance = bound;
  for (const float room : {kMuchRoom, kRoom}) {
    if (FindScales(bound - float_error, gains, largest, room, field)) {
      return absl::OkStatus();
    }
  }
  const double numbers = *std::max_element(largest.begin(), largest.end()) / field->scales.front();
  return InvalidArgument(
      "--tolerance: {:.3g} needs larger numbers in field '{}' than a store holds: give {:.3g} or "
      "more, or none",
      bound, field->name, bound * 1.01 * kRoom * numbers / store::MostOfType("int32"));
}

Status Quantise(const store::FieldInfo& field, CoefficientSet* set, int threads) {
  for (size_t level = 0; level < field.scales.size(); ++level) {
    const store::Coding coding{field.type, field.scales[level]};
    std::vector<Int3> bricks;
    for (const auto& [key, brick] : set->detail[level].bricks()) {
      bricks.push_back({key[2], key[1], key[0]});
    }
    std::vector<Status> results(bricks.size());
    std::vector<BrickGrid::Brick*> values;
    values.reserve(bricks.size());
    for (const Int3& at : bricks) {
      values.push_back(&set->detail[level].Touch(at));
    }
    ParallelFor(0, std::ssize(values), 8, threads, [&](int64_t first, int64_t last) {
      for (auto i = static_cast<size_t>(first); i < static_cast<size_t>(last); ++i) {
        results[i] = store::RoundToStored(coding, *values[i]);
      }
    });
    for (const Status& result : results) {
      FOVEA_RETURN_IF_ERROR(Annotate(
          result,
          fmt::format(
              "--tolerance: field '{}' is quantised for coefficients up to {} times those of its "
              "first step; ingest it again, with a larger tolerance or none",
              field.name, kRoom)));
    }
  }
  return absl::OkStatus();
}

StatusOr<double> LargestError(const BrickGrid& voxels, const CoefficientSet& set, int threads) {
  const int64_t bricks_across = std::max<int64_t>(1, kBlock / voxels.edge());
  std::set<std::array<int64_t, 3>> found;
  for (const auto& [key, brick] : voxels.bricks()) {
    found.insert({key[0] / bricks_across, key[1] / bricks_across, key[2] / bricks_across});
  }
  const std::vector<std::array<int64_t, 3>> blocks(found.begin(), found.end());
  std::vector<StatusOr<double>> results(blocks.size(), 0.0);
  MemorySource source(set);
  ParallelFor(0, std::ssize(blocks), 1, threads, [&](int64_t first, int64_t last) {
    std::vector<float> original;
    for (auto i = static_cast<size_t>(first); i < static_cast<size_t>(last); ++i) {
      const int64_t edge = bricks_across * voxels.edge();
      const Int3 lo{blocks[i][2] * edge, blocks[i][1] * edge, blocks[i][0] * edge};
      const Box3 box =
          Intersect({lo, {lo.x + edge, lo.y + edge, lo.z + edge}}, Box3::OfSize(voxels.dims()));
      const StatusOr<Grid> back = ExtractVoxels(source, box);
      if (!back.ok()) {
        results[i] = back.status();
        continue;
      }
      original.resize(back->values.size());
      voxels.CopyOut(box, original);
      double largest = 0;
      for (size_t k = 0; k < original.size(); ++k) {
        largest = std::max<double>(largest, std::fabs(double{original[k]} - back->values[k]));
      }
      results[i] = largest;
    }
  });
  double largest = 0;
  for (const StatusOr<double>& result : results) {
    FOVEA_RETURN_IF_ERROR(result.status());
    largest = std::max(largest, *result);
  }
  return largest;
}

}  // namespace fovea::ingest
