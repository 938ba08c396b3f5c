// What an ingest needs in memory does not grow with the number of slices: a volume larger than
// memory is one with more of them.

#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "tests/support/temporary_folder.h"

namespace fovea::ingest {
namespace {

using ::fovea::testing::TemporaryFolder;

constexpr int64_t kSide = 256;

void WriteVolume(const std::string& path, int64_t slices) {
  std::ofstream file(path, std::ios::binary);
  std::vector<float> slice(kSide * kSide);
  uint32_t random = 1;
  for (int64_t z = 0; z < slices; ++z) {
    for (float& value : slice) {
      random = random * 1664525 + 1013904223;
      value = static_cast<float>(random >> 26);
    }
    file.write(reinterpret_cast<const char*>(slice.data()),
               static_cast<std::streamsize>(slice.size() * sizeof(float)));
  }
}

/// Ingests as people do; the peak of the program's memory, in MB, or -1.
int64_t PeakMegabytes(const std::string& input, int64_t slices, const std::string& output) {
  const std::string program = FOVEA_BINARY_DIR "/bin/fovea";
  const std::string raw = "256x256x" + std::to_string(slices) + ":float32";
  const pid_t pid = ::fork();
  if (pid == 0) {
    ::execl(program.c_str(), program.c_str(), "ingest", input.c_str(), "--raw", raw.c_str(), "-o",
            output.c_str(), "--json", nullptr);
    ::_exit(127);
  }
  int status = 0;
  rusage used{};
  if (::wait4(pid, &status, 0, &used) != pid || status != 0) {
    return -1;
  }
  return used.ru_maxrss / 1024;
}

TEST(IngestMemoryTest, DoesNotGrowWithTheNumberOfSlices) {
  TemporaryFolder folder;
  const std::string few = folder / "few.raw";
  const std::string many = folder / "many.raw";
  WriteVolume(few, 96);
  WriteVolume(many, 384);
  const int64_t least = PeakMegabytes(few, 96, folder / "few.zarr");
  const int64_t most = PeakMegabytes(many, 384, folder / "many.zarr");
  ASSERT_GT(least, 0);
  ASSERT_GT(most, 0);
  std::printf("%d MB for 24 MB of voxels, %d MB for 96 MB\n", static_cast<int>(least),
              static_cast<int>(most));
#ifndef FOVEA_SANITIZED  // they keep what was freed
  EXPECT_LT(most, least + 24);
#endif
}

}  // namespace
}  // namespace fovea::ingest
