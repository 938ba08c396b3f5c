#include "service/cli/checks.h"

#include <cmath>
#include <string>

#include <CLI/CLI.hpp>
#include <fmt/format.h>

namespace fovea::cli {
namespace {

/// `what` the text is to be, and whether it is.
template <typename Number, typename IsGood>
CLI::Validator MustBe(const std::string& what, IsGood is_good) {
  const auto problem = [=](const std::string& text) -> std::string {
    Number value{};
    return CLI::detail::lexical_cast(text, value) && is_good(value)
               ? ""
               : fmt::format("'{}' is not {}", text, what);
  };
  return CLI::Validator(problem, "");
}

}  // namespace

CLI::Validator Whole(int64_t least, std::optional<int64_t> most) {
  return MustBe<int64_t>(
      most ? fmt::format("a whole number from {} to {}", least, *most)
           : fmt::format("a whole number, {} or more", least),
      [=](int64_t value) {  // what is too large for 64 bits is read as the largest
        return value >= least && value <= most.value_or(INT64_MAX - 1);
      });
}

CLI::Validator Within(double least, double most) {
  return MustBe<double>(fmt::format("a number from {:g} to {:g}", least, most),
                        [=](double value) { return value >= least && value <= most; });
}

CLI::Validator Positive() {
  return MustBe<double>("a number above 0",
                        [](double value) { return value > 0 && std::isfinite(value); });
}

CLI::Validator NotNegative() {
  return MustBe<double>("a number, 0 or more",
                        [](double value) { return value >= 0 && std::isfinite(value); });
}

}  // namespace fovea::cli
