#include "tests/support/crash_everywhere.h"

#include <algorithm>
#include <cerrno>
#include <iostream>
#include <map>
#include <random>
#include <set>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"

namespace fovea::testing {
namespace {

using Call = SimulatedDisk::Call;
using Kept = SimulatedDisk::Kept;

/// What the disk may hold after a power cut: all subsets of few changes; of many, none, all, each
/// alone, all but each, and some that chance says.
std::vector<std::vector<bool>> Subsets(size_t changes, std::mt19937* random) {
  std::vector<std::vector<bool>> subsets;
  if (changes <= 5) {
    for (size_t bits = 0; bits < (size_t{1} << changes); ++bits) {
      subsets.emplace_back(changes);
      for (size_t i = 0; i < changes; ++i) {
        subsets.back()[i] = (bits >> i & 1) != 0;
      }
    }
    return subsets;
  }
  subsets = {std::vector<bool>(changes, false), std::vector<bool>(changes, true)};
  for (size_t i = 0; i < changes; ++i) {
    subsets.emplace_back(changes, false);
    subsets.back()[i] = true;
    subsets.emplace_back(changes, true);
    subsets.back()[i] = false;
  }
  for (int i = 0; i < 5; ++i) {
    subsets.emplace_back(changes);
    std::generate(subsets.back().begin(), subsets.back().end(), [&] { return (*random)() % 2; });
  }
  return subsets;
}

/// Calls `check` with every different disk that an accident now could leave. Returns how many.
size_t ForEachWreck(const SimulatedDisk& disk, std::mt19937* random,
                    std::set<std::map<std::string, std::vector<std::byte>>>* seen,
                    const std::function<void(SimulatedDisk*)>& check) {
  size_t wrecks = 0;
  const auto one = [&](const std::unique_ptr<SimulatedDisk>& wreck) {
    if (seen->insert(wreck->Files()).second) {
      ++wrecks;
      check(wreck.get());
    }
  };
  one(disk.AfterKill());
  for (const std::vector<bool>& subset : Subsets(disk.UnflushedNames(), random)) {
    const auto kept = static_cast<Kept>((*random)() % 4);
    one(disk.AfterPowerCut([&](size_t i) { return subset[i]; }, kept));
  }
  return wrecks;
}

}  // namespace

void CrashEverywhere(const std::function<std::unique_ptr<SimulatedDisk>()>& make,
                     const std::function<Status(SimulatedDisk*)>& work,
                     const std::function<void(SimulatedDisk*)>& check) {
  std::mt19937 random(7);
  std::set<std::map<std::string, std::vector<std::byte>>> seen;
  size_t wrecks = 0;
  for (int64_t crash = 0;; ++crash) {
    const std::unique_ptr<SimulatedDisk> disk = make();
    int64_t changes = 0;
    Call last;
    disk->set_fault([&](const Call& call) {
      if (changes == crash) {
        return -EIO;
      }
      last = call;
      changes += SimulatedDisk::Changes(call.operation) ? 1 : 0;
      return 0;
    });
    const Status status = work(disk.get());
    if (changes < crash) {
      EXPECT_OK(status);
      std::cout << crash << " calls, " << wrecks << " different wrecks\n";
      return;
    }
    SCOPED_TRACE(fmt::format("after call {} ({})", crash, last.path));
    wrecks += ForEachWreck(*disk, &random, &seen, check);
    if (::testing::Test::HasFailure()) {
      return;
    }
  }
}

}  // namespace fovea::testing
