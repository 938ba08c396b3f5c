#ifndef SERVICE_CLI_CHECKS_H_
#define SERVICE_CLI_CHECKS_H_

#include <cstdint>
#include <optional>

namespace CLI {
class Validator;
}

/// Checks of the numbers that options take (`option->check(...)`). What is wrong is told in a few
/// words: "--step: '1.5' is not a whole number, 0 or more".
namespace fovea::cli {

/// A whole number, `least` or more, and at most `most` if it is given.
[[nodiscard]] CLI::Validator Whole(int64_t least, std::optional<int64_t> most = std::nullopt);
/// Both included.
[[nodiscard]] CLI::Validator Within(double least, double most);
/// Finite and above 0.
[[nodiscard]] CLI::Validator Positive();
/// Finite, 0 or more.
[[nodiscard]] CLI::Validator NotNegative();

}  // namespace fovea::cli

#endif  // SERVICE_CLI_CHECKS_H_
