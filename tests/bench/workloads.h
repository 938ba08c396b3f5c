#ifndef TESTS_BENCH_WORKLOADS_H_
#define TESTS_BENCH_WORKLOADS_H_

#include "engine/base/status.h"

/// The workloads of frame_bench that are not simply a volume at a rate. Each prints a table.
namespace fovea::bench {

/// Phases of a frame as the volume grows: n = 1024, 2048, 4096 at rate 40 and 45 degrees, with a
/// picture of 512 x 512 and with one of n x n. Yu et al., Figure 7 (c).
[[nodiscard]] Status RunGrowth(int rounds, int threads);

/// Yu et al., Figure 7: frames (reconstruction included) against the rate at 0 and 45 degrees (a),
/// the angle at rate 40 (b), both of bonsai512; and the data width at rate 40, with a picture of
/// n x n and of 512 x 512 (c).
[[nodiscard]] Status RunRates(int rounds, int threads);
[[nodiscard]] Status RunAngles(int rounds, int threads);
[[nodiscard]] Status RunWidths(int rounds, int threads);

/// What a frame holds and what it allocates, at several rates and sizes.
[[nodiscard]] Status RunMemory(int threads);

/// Smoothing and warp at 1024 x 1024, beside memset of the picture.
[[nodiscard]] Status RunSmoothing(int rounds, int threads);

}  // namespace fovea::bench

#endif  // TESTS_BENCH_WORKLOADS_H_
