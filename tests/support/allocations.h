#ifndef TESTS_SUPPORT_ALLOCATIONS_H_
#define TESTS_SUPPORT_ALLOCATIONS_H_

#include <cstddef>

namespace fovea::testing {

/// How often this program has called operator new. Link allocations.cc, which replaces it.
[[nodiscard]] size_t AllocationCount();

}  // namespace fovea::testing

#endif  // TESTS_SUPPORT_ALLOCATIONS_H_
