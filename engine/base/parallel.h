#ifndef ENGINE_BASE_PARALLEL_H_
#define ENGINE_BASE_PARALLEL_H_

#include <cstdint>
#include <functional>
#include <thread>

namespace fovea {

/// The number of processors this process may use, at least 1.
[[nodiscard]] int HardwareThreads();

/// Calls `body(first, last)` over pieces that cover [begin, end) once, each of at most `grain`
/// items, on at most `threads` threads (0, or more than there are: all processors). Returns when
/// every piece is done. Which thread runs which piece varies; results must not depend on it. `body`
/// must not throw. The only door to the scheduler: nothing else of the project includes oneTBB.
void ParallelFor(int64_t begin, int64_t end, int64_t grain, int threads,
                 const std::function<void(int64_t first, int64_t last)>& body);

/// Starts the threads of ParallelFor ahead of its first call, which else takes 3 ms for it. On a
/// thread of its own, which is joined when the result goes.
[[nodiscard]] std::jthread StartScheduler();

}  // namespace fovea

#endif  // ENGINE_BASE_PARALLEL_H_
