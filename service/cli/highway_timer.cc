// Before main, Highway's library measures how fine its timer is: 2.4 ms, for benchmarks that it has
// and that nothing here runs. A definition in the program takes the place of the library's, so
// `fovea` starts that much sooner (docs/decisions/0027).

#include <cstdint>

namespace hwy::platform {

[[gnu::visibility("default")]] uint64_t TimerResolution();  // as in hwy/nanobenchmark.h

uint64_t TimerResolution() {
  return 1;
}

}  // namespace hwy::platform
