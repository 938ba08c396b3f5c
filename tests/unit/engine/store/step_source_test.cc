#include "engine/store/step_source.h"

#include <cerrno>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "engine/store/dataset.h"
#include "tests/support/simulated_disk.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/engine/store/store_test_util.h"

namespace fovea::store {
namespace {

using ::fovea::testing::FailsWith;
using ::fovea::testing::SimulatedDisk;
using Call = SimulatedDisk::Call;

constexpr Int3 kDims{200, 16, 16};  // two shards of the finest detail

/// One step of a store, open to be read.
struct OpenStore {
  SimulatedDisk disk;
  std::unique_ptr<StepSource> source;

  OpenStore() {
    EXPECT_OK(testing::MakeStore("a.zarr", testing::MakeInfo(kDims, 8), 1, disk));
    const auto dataset = Dataset::Open("a.zarr", disk);
    source = *(*dataset)->OpenStep(0, "density", OnDamage::kFail);
  }
  [[nodiscard]] Status ReadCoarse() {
    std::vector<float> values(static_cast<size_t>(source->hierarchy().DimsAt(0).Product()));
    return source->ReadCoarse(values);
  }
};

bool Contains(const Call& call, const char* part) {
  return call.path.find(part) != std::string::npos;
}

TEST(StepSource, TheReadsOfAWindowAreBegunBeforeTheFirstIsWaitedFor) {
  OpenStore store;
  std::vector<int64_t> begun;  // when each read of the finest detail was done
  store.disk.set_fault([&](const Call& call) {
    if (call.operation == SimulatedDisk::Operation::kRead && Contains(call, "/detail_2/")) {
      begun.push_back(store.disk.started_reads());
    }
    return 0;
  });
  const int finest = store.source->hierarchy().finest() - 1;
  ASSERT_OK(testing::ReadLevel(store.source.get(), finest).status());
  ASSERT_GE(begun.size(), 4U);  // two indices, then chunks of two shards
  EXPECT_EQ(begun[0], 2);
  EXPECT_EQ(begun[1], 2);
  EXPECT_GE(store.disk.started_reads(), 4);
  for (size_t i = 2; i < begun.size(); ++i) {
    EXPECT_EQ(begun[i], store.disk.started_reads());
  }
}

TEST(StepSource, TheTablesAreBegunWithTheCoarseLevelAndOpenedOnce) {
  OpenStore store;
  std::map<std::string, int> opened;
  int64_t begun = 0;
  store.disk.set_fault([&](const Call& call) {
    if (call.operation == SimulatedDisk::Operation::kOpen && Contains(call, "/chunk_max_")) {
      ++opened[call.path];
    }
    if (call.operation == SimulatedDisk::Operation::kRead && Contains(call, "/coarse/")) {
      begun = store.disk.started_reads();
    }
    return 0;
  });
  ASSERT_OK(testing::ReadEverything(store.source.get()));
  EXPECT_EQ(begun, store.source->hierarchy().finest());
  EXPECT_EQ(opened.size(), static_cast<size_t>(store.source->hierarchy().finest()));
  for (const auto& [path, times] : opened) {
    EXPECT_EQ(times, 1) << path;
  }
}

TEST(StepSource, ATableThatCouldNotBeOpenedAheadIsAnErrorOfItsLevelAndIsTriedAgain) {
  OpenStore store;
  const int finest = store.source->hierarchy().finest() - 1;
  store.disk.set_fault(
      [](const Call& call) { return Contains(call, "/chunk_max_2/") ? -EMFILE : 0; });
  ASSERT_OK(store.ReadCoarse());
  store.disk.set_fault(nullptr);
  ASSERT_OK(testing::ReadLevel(store.source.get(), finest - 1).status());
  EXPECT_THAT(testing::ReadLevel(store.source.get(), finest),
              FailsWith(absl::StatusCode::kResourceExhausted, "/chunk_max_2/"));
  EXPECT_OK(testing::ReadLevel(store.source.get(), finest).status());
}

}  // namespace
}  // namespace fovea::store
