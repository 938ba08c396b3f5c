// Writes a float32 volume as a detector would give it: something smooth that moves with the frame,
// and a little noise in steps of 1/4096. For ingest_bench.py.
//   dense_frames EDGE FRAME FILE

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <vector>

int main(int argc, char** argv) {
  if (argc != 4) {
    std::fprintf(stderr, "usage: dense_frames EDGE FRAME FILE\n");
    return 2;
  }
  const int64_t n = std::atoll(argv[1]);
  const double frame = std::atof(argv[2]);
  std::FILE* file = std::fopen(argv[3], "wb");
  if (n < 1 || file == nullptr) {
    std::fprintf(stderr, "dense_frames: cannot write '%s'\n", argv[3]);
    return 1;
  }
  std::vector<float> waves(static_cast<size_t>(n));
  for (int64_t i = 0; i < n; ++i) {
    waves[static_cast<size_t>(i)] = static_cast<float>(
        std::sin(20.0 * static_cast<double>(i) / static_cast<double>(n) + 0.3 * frame));
  }
  std::vector<float> row(static_cast<size_t>(n));
  uint32_t random = 12345 + static_cast<uint32_t>(frame);
  bool is_written = true;
  for (int64_t z = 0; z < n; ++z) {
    for (int64_t y = 0; y < n; ++y) {
      const float smooth = waves[static_cast<size_t>(z)] * waves[static_cast<size_t>(y)];
      for (int64_t x = 0; x < n; ++x) {
        random = random * 1664525 + 1013904223;
        const auto noise = static_cast<float>(random >> 26) / 4096;  // 64 steps
        row[static_cast<size_t>(x)] =
            std::round(4096 * smooth * waves[static_cast<size_t>(x)]) / 4096 + noise;
      }
      is_written =
          is_written && std::fwrite(row.data(), sizeof(float), row.size(), file) == row.size();
    }
  }
  is_written = std::fclose(file) == 0 && is_written;
  return is_written ? 0 : 1;
}
