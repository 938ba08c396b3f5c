#ifndef TESTS_SUPPORT_CRASH_EVERYWHERE_H_
#define TESTS_SUPPORT_CRASH_EVERYWHERE_H_

#include <functional>
#include <memory>

#include "engine/base/status.h"
#include "tests/support/simulated_disk.h"

namespace fovea::testing {

/// Runs `work` again and again, each time on what `make` makes; in run i the disk is gone from
/// changing call i on. `check` sees every different disk that is found then: after a kill, and
/// after a power cut. Ends when a run was not disturbed, or at the first failed expectation.
void CrashEverywhere(const std::function<std::unique_ptr<SimulatedDisk>()>& make,
                     const std::function<Status(SimulatedDisk*)>& work,
                     const std::function<void(SimulatedDisk*)>& check);

}  // namespace fovea::testing

#endif  // TESTS_SUPPORT_CRASH_EVERYWHERE_H_
