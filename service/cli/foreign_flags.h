#ifndef SERVICE_CLI_FOREIGN_FLAGS_H_
#define SERVICE_CLI_FOREIGN_FLAGS_H_

#include <string>
#include <vector>

namespace CLI {
class App;
}

/// Flags that cannot apply are refused, not passed over. Each throws a CLI::ValidationError that
/// names the flag.
namespace fovea::cli {

/// The group of the flags of AddForeignFlags.
inline constexpr const char* kForeignGroup = "Foreign files";

/// Of a verb that reads `inputs`: flags that say how to read files of other kinds than these, as
/// far as their names tell.
void RefuseFlagsOfOtherFiles(const CLI::App& verb, const std::vector<std::string>& inputs);

/// The same of a verb that takes datasets and servers as well, to which none of these flags apply.
void RefuseForeignFlags(const CLI::App& verb, const std::vector<std::string>& inputs);

}  // namespace fovea::cli

#endif  // SERVICE_CLI_FOREIGN_FLAGS_H_
