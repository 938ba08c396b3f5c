#ifndef TESTS_UNIT_SERVICE_SERVER_DOCUMENTED_RANGES_H_
#define TESTS_UNIT_SERVICE_SERVER_DOCUMENTED_RANGES_H_

#include <string>

/// The ranges that the comments of proto/fovea/v1 say, for ServerFixture's dataset "plume".
namespace fovea::server {

constexpr double kMost64 = 1.8446744073709552e19;  // above every uint64

enum class Is {
  kAny,       // every value is right
  kRange,     // low to high
  kAbove,     // finite, above low
  kFinite,    // any finite number
  kEnum,      // a value of the enum
  kCount,     // low to high elements
  kNeeded,    // a message that must be there
  kStep,      // below `high`: OUT_OF_RANGE
  kTime,      // not before `low`: OUT_OF_RANGE
  kName,      // of something that is there: NOT_FOUND
  kNewName,   // of a dataset that need not be there
  kWord,      // nothing else than what the good request has
  kText,      // at most `high` bytes
  kFile,      // below a root of files: NOT_FOUND
  kPowerOf2,  // 1 to high
};

/// What a field of a request may be.
struct Rule {
  const char* path;  // "METHOD:PATH" for one method, else of every method; [] for elements, * for
                     // the parts of a Vec3 or Color
  Is is;
  double low = 0, high = 0;
  const char* also = "";  // another field that the error may name
};

/// The rule of a path in a method's request, or null. Elements are "held[].step".
[[nodiscard]] const Rule* RuleOf(const std::string& method, const std::string& path);

}  // namespace fovea::server

#endif  // TESTS_UNIT_SERVICE_SERVER_DOCUMENTED_RANGES_H_
