#include "tests/unit/engine/store/store_test_util.h"

#include <stdlib.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <random>

#include <gtest/gtest.h>

#include "engine/store/file.h"
#include "engine/store/metadata.h"
#include "engine/store/stored_type.h"
#include "engine/wavelet/haar.h"

namespace fovea::store::testing {

namespace fs = std::filesystem;

TemporaryFolder::TemporaryFolder() {
  std::string pattern = fs::path(::testing::TempDir()) / "fovea_store_XXXXXX";
  path_ = mkdtemp(pattern.data());
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;
  fs::remove_all(path_, ignored);
}

StepData MakeStep(const Int3& dims, int64_t chunk_edge, int seed) {
  std::mt19937 random(static_cast<unsigned>(seed));
  std::uniform_real_distribution<float> noise(-0.25F, 0.25F);
  BrickGrid voxels(dims, chunk_edge, 1, 0.0F);
  const double radius = 0.3 * static_cast<double>(dims.Max());
  const Vec3 centre{0.5 * static_cast<double>(dims.x) + seed, 0.5 * static_cast<double>(dims.y),
                    0.4 * static_cast<double>(dims.z)};
  for (int64_t z = 0; z < dims.z; ++z) {
    for (int64_t y = 0; y < dims.y; ++y) {
      std::vector<float> row(static_cast<size_t>(dims.x));
      bool any = false;
      for (int64_t x = 0; x < dims.x; ++x) {
        const Vec3 at{static_cast<double>(x), static_cast<double>(y), static_cast<double>(z)};
        const double inside = 1 - Length(at - centre) / radius;
        if (inside > 0) {
          row[static_cast<size_t>(x)] = static_cast<float>(10 * inside) + noise(random);
          any = true;
        }
      }
      if (any) {
        voxels.CopyIn({{0, y, z}, {dims.x, y + 1, z + 1}}, row);
      }
    }
  }
  return {wavelet::ForwardHaar(voxels, *Hierarchy::Make(dims), 1), ComputeStats(voxels)};
}

DatasetInfo MakeInfo(const Int3& dims, int64_t chunk_edge, const std::vector<std::string>& fields) {
  DatasetInfo info;
  info.hierarchy = *Hierarchy::Make(dims);
  info.origin = {-3, 5, 7};
  info.index_to_world.m = {0.5, 0, 0, -1.25, 0, 0.5, 0, 3, 0, 0, 0.75, 0, 0, 0, 0, 1};
  info.world_unit = "mm";
  info.clock = "from the first step";
  info.chunk_edge = chunk_edge;
  info.default_field = fields.front();
  for (const std::string& name : fields) {
    info.fields.push_back({name});
  }
  return info;
}

StepData WholeStep(const Int3& dims, int64_t chunk_edge, int seed) {
  StepData data = MakeStep(dims, chunk_edge, seed);
  const auto round = [](std::vector<float>* values) {
    for (float& value : *values) {
      value = std::clamp(std::round(100 * value), -32767.0F, 32767.0F);
    }
  };
  data.coefficients.basis.integer = true;
  round(&data.coefficients.coarse.values);
  for (BrickGrid& detail : data.coefficients.detail) {
    const BrickGrid before = detail;
    for (const auto& [at, brick] : before.bricks()) {
      round(&detail.Touch({at[2], at[1], at[0]}));
    }
  }
  return data;
}

Status WriteSteps(DatasetWriter* writer, int64_t steps) {
  const DatasetInfo info = writer->info();
  for (int64_t i = 0; i < steps; ++i) {
    const int64_t step = writer->info().committed_steps;
    for (const FieldInfo& field : info.fields) {
      const auto make = IsIntegerType(field.type) ? WholeStep : MakeStep;
      const StepData data = make(info.hierarchy.dims(), info.chunk_edge, static_cast<int>(step));
      FOVEA_RETURN_IF_ERROR(writer->WriteField(field.name, data.coefficients, data.stats));
    }
    const auto frame_number = step % 2 == 0 ? std::optional(100 + step) : std::nullopt;
    FOVEA_RETURN_IF_ERROR(writer->Commit(step * 1'000'000'000, frame_number));
  }
  return absl::OkStatus();
}

Status MakeStore(const std::string& path, const DatasetInfo& info, int64_t steps,
                 FileSystem& files) {
  FOVEA_ASSIGN_OR_RETURN(const auto writer, DatasetWriter::Create(path, info, files));
  return WriteSteps(writer.get(), steps);
}

StatusOr<std::vector<float>> ReadLevel(CoefficientSource* source, int level) {
  const Box3 all = Box3::OfSize(source->hierarchy().DimsAt(level));
  std::vector<float> values(static_cast<size_t>(7 * all.Volume()));
  FOVEA_RETURN_IF_ERROR(source->ReadDetail(level, all, values));
  return values;
}

Status ReadEverything(CoefficientSource* source) {
  std::vector<float> coarse(static_cast<size_t>(source->hierarchy().DimsAt(0).Product()));
  FOVEA_RETURN_IF_ERROR(source->ReadCoarse(coarse));
  for (int level = 0; level < source->hierarchy().finest(); ++level) {
    FOVEA_RETURN_IF_ERROR(ReadLevel(source, level).status());
  }
  return absl::OkStatus();
}

std::vector<std::string> FilesBelow(const std::string& path) {
  std::vector<std::string> files;
  for (const auto& entry : fs::recursive_directory_iterator(path)) {
    if (entry.is_regular_file() && entry.path().filename() != kLockName &&
        entry.path().filename() != kGroupCopyName) {
      files.push_back(entry.path().string());
    }
  }
  std::sort(files.begin(), files.end());
  return files;
}

void FlipByte(const std::string& path, int64_t offset, int mask) {
  std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
  ASSERT_TRUE(file.is_open()) << path;
  const auto from = offset < 0 ? std::ios::end : std::ios::beg;
  file.seekg(offset, from);
  const int byte = file.get();
  ASSERT_NE(byte, EOF) << path;
  file.seekp(offset, from);
  file.put(static_cast<char>(byte ^ mask));
  ASSERT_TRUE(file.good()) << path;
}

}  // namespace fovea::store::testing
