#include "engine/base/parallel.h"

#include <algorithm>
#include <atomic>
#include <vector>

#ifndef FOVEA_PARALLEL_STD
#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>
#endif

namespace fovea {

int HardwareThreads() {
  // Asked once: the answer is in a file, and every loop wants it.
  static const int threads = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  return threads;
}

#ifdef FOVEA_PARALLEL_STD

// Threads take the next piece from a counter. Slower to start than oneTBB, but every
// synchronisation is one that ThreadSanitizer sees.
void ParallelFor(int64_t begin, int64_t end, int64_t grain, int threads,
                 const std::function<void(int64_t, int64_t)>& body) {
  grain = std::max<int64_t>(grain, 1);
  const int64_t pieces = end > begin ? (end - begin + grain - 1) / grain : 0;
  const int64_t wanted = threads > 0 ? threads : HardwareThreads();
  const int64_t workers = std::min(pieces, wanted);
  std::atomic<int64_t> next{0};
  const auto work = [&] {
    for (int64_t piece = next++; piece < pieces; piece = next++) {
      const int64_t first = begin + piece * grain;
      body(first, std::min(end, first + grain));
    }
  };
  std::vector<std::thread> pool;
  for (int64_t i = 1; i < workers; ++i) {
    pool.emplace_back(work);
  }
  work();
  for (std::thread& thread : pool) {
    thread.join();
  }
}

#else

void ParallelFor(int64_t begin, int64_t end, int64_t grain, int threads,
                 const std::function<void(int64_t, int64_t)>& body) {
  grain = std::max<int64_t>(grain, 1);
  if (end <= begin) {
    return;
  }
  const int wanted = threads > 0 ? std::min(threads, HardwareThreads()) : HardwareThreads();
  if (wanted == 1 || end - begin <= grain) {
    for (int64_t first = begin; first < end; first += grain) {
      body(first, std::min(end, first + grain));
    }
    return;
  }
  const int64_t pieces = (end - begin + grain - 1) / grain;
  const auto run = [&] {
    tbb::parallel_for(int64_t{0}, pieces, [&](int64_t piece) {
      const int64_t first = begin + piece * grain;
      body(first, std::min(end, first + grain));
    });
  };
  // An arena of its own costs more than a small level's rays.
  if (wanted == HardwareThreads()) {
    run();
  } else {
    tbb::task_arena(wanted).execute(run);
  }
}

#endif

std::jthread StartScheduler() {
  return std::jthread([] { ParallelFor(0, HardwareThreads(), 1, 0, [](int64_t, int64_t) {}); });
}

}  // namespace fovea
